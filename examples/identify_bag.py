"""Modes of an arm from a recorded bag, without ROS: `python examples/identify_bag.py [BAG]`."""

from __future__ import annotations

import sys
from pathlib import Path

from flexarm_ident import identify, preprocess, read_bag, reduce_model, validate_dmv

BAG = Path(__file__).parents[1] / "bags" / "c_dat3_0g"


def main(bag: Path = BAG) -> None:
    """Identify on the first half of the record, reduce, and validate on all of it."""
    data = preprocess(read_bag(bag))
    training = data.head(len(data) // 2)
    full = identify(training, order=20)
    reduced = reduce_model(full, training, ranking="mrm", order=10)

    print(f"{len(data)} samples, order {full.order} by {full.method}, reduced to {reduced.order}")
    for mode in sorted(reduced.modes, key=lambda each: each.frequency_hz):
        if mode.is_pair:
            kept = "kept" if mode.kept else "left out"
            print(f"{mode.frequency_hz:8.3f} Hz  damping {mode.damping_ratio:.4f}  {kept}")
    errors = validate_dmv(reduced.model, data)
    for name, error in zip(data.outputs, errors.delta, strict=True):
        print(f"relative error of {name}: {error:.3f}")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
