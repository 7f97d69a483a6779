"""Benchmark of the learning of a command: differences of the position over those of the first run.

A square wave, steps and a smooth curve with 0, 200 and 400 g. From nothing, the first run gets
no command of the model; with the model's, the motor of the rig has 20 % more gain. All figures are
noise-free, those of the learning itself are not.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click
import numpy as np

from bench.tools import count_option, json_option, make_table, run_trials, write_json, write_table
from flexarm_bringup.console import terminal
from flexarm_control import build_law
from flexarm_control.laws.gains import CompensationLevel, TunedPdpGains
from flexarm_control.laws.registry import LAWS
from flexarm_control.learning.repetition import best, improved, learned, without_model
from flexarm_control.learning.trajectory import FollowingLaw, bending_hub, planned_trajectory
from flexarm_control.planning.flat_arm import ArmFigures
from flexarm_control.planning.move import MoveSettings
from flexarm_daq import RigParameters
from reproduction.framework.rig import RATE_HZ, run_law

if TYPE_CHECKING:
    from flexarm_control.learning.trajectory import Trajectory
    from flexarm_core.arrays import FloatArray

PAYLOADS_KG = (0.0, 0.2, 0.4)
NOTHING, MODEL = "from nothing", "model, gain +20 %"
REPETITIONS = 8
_GAIN = 1.2
_PAGE = Path(__file__).parents[2] / "docs" / "moves.md"
_LENGTH_S = 20.0
_EARLY = 3
_HEADS = (
    "start",
    "reference",
    "first mV",
    "at 3",
    "at 8",
    "kept",
    "gauge kept",
    "runs",
    "worse",
)


class Case(NamedTuple):
    """One learning."""

    start: str
    reference: str
    payload_kg: float
    law: str
    seed: int


@dataclass(frozen=True)
class Learning:
    """Root mean squares of the differences by run, V, noise-free, and the run that is kept."""

    case: Case
    position_rms_v: tuple[float, ...]
    gauge_rms_v: tuple[float, ...]
    kept: int

    def ratio(self, run: int) -> float:
        """Return the position's difference of a run over the first; past the last, the kept."""
        at = run if run < len(self.position_rms_v) else self.kept
        return self.position_rms_v[at] / self.position_rms_v[0]


@click.command()
@count_option("--seeds", 3)
@click.option("--law", type=click.Choice(("planned", "pdpc")), default="planned", show_default=True)
@json_option
@click.option("--docs", is_flag=True, help="Write the table of docs/moves.md.")
def main(*, seeds: int, law: str, json_file: Path | None, docs: bool) -> None:
    """Learn every reference with every payload, and print what is left of the first run."""
    grid = product((NOTHING, MODEL), references(), PAYLOADS_KG, (law,), range(seeds))
    made = run_trials(learning, [Case(*each) for each in grid])
    rows = [
        (start, reference, *figures([m for m in made if m.case[:2] == (start, reference)]))
        for start, reference in product((NOTHING, MODEL), references())
    ]
    table = make_table(*_HEADS, title="mean / worst, of the first run", words=2)
    for row in rows:
        table.add_row(*row)
    terminal.show_table(table)
    write_json(json_file, [asdict(each) for each in made])
    if docs:
        write_table(_PAGE, "learning", _HEADS, rows)


def references() -> dict[str, FloatArray]:
    """Return the references, V, by their names."""
    time_s = np.arange(round(_LENGTH_S * RATE_HZ)) / RATE_HZ
    squares = np.searchsorted([1.0, 4.0, 8.0, 12.0, 16.0], time_s, side="right")
    steps = np.searchsorted([1.0, 5.0, 10.0, 15.0], time_s, side="right")
    curve_v = 2.0 * np.sin(0.5 * np.pi * time_s) * np.sin(np.pi * time_s / _LENGTH_S) ** 2
    return {
        "square": np.array([0.0, 1.5, -1.5, 1.5, -1.5, 1.5])[squares],
        "steps": np.array([0.0, 1.0, 3.0, 2.0, 0.0])[steps],
        "curve": curve_v,
    }


def learning(case: Case) -> Learning:
    """Learn a reference once."""
    arm, gains = bending_hub(ArmFigures().at(case.payload_kg)), TunedPdpGains()
    reference_v = references()[case.reference]
    first = planned_trajectory(reference_v, arm, MoveSettings().peak_v, RATE_HZ)
    rig = RigParameters(payload_kg=case.payload_kg)
    if case.start == NOTHING:
        first = without_model(first, gains)
    else:
        rig = replace(rig, motor_gain_nm_per_v=_GAIN * rig.motor_gain_nm_per_v)
    plays = LAWS[case.law].plays
    assert plays is not None  # noqa: S101 - the choice of laws
    rms_v: list[tuple[float, float]] = []

    def play(number: int, played: Trajectory) -> FloatArray:
        law = FollowingLaw(
            plays(build_law(case.law)),
            played,
            compensation_v=CompensationLevel().compensation_v,
            full_speed_v=MoveSettings().full_speed_v,
        )
        seed = 100 * case.seed + number
        made = run_law(law, played.position_v, arm=rig, seed=seed)
        asked_v = np.column_stack([played.position_v, played.middle_strain_v])
        left_v = asked_v - made.true_y[:, [0, 2]]
        position_v, gauge_v = np.sqrt(np.mean(left_v**2, axis=0)).tolist()
        rms_v.append((position_v, gauge_v))
        return made.y

    improve = partial(improved, arm=arm, gains=gains, delay_s=0.5 / RATE_HZ)
    done = learned(play, first, improve, repetitions=REPETITIONS)
    positions_v, gauges_v = zip(*rms_v, strict=True)
    return Learning(case, positions_v, gauges_v, best(done))


def figures(some: list[Learning]) -> tuple[str, ...]:
    """Return the cells of a row: ratios to the first run, and how often the kept one is worse."""
    kept = [each.ratio(each.kept) for each in some]
    gauge = [each.gauge_rms_v[each.kept] / each.gauge_rms_v[0] for each in some]
    first_mv = [1e3 * each.position_rms_v[0] for each in some]
    runs = [len(each.position_rms_v) - 1 for each in some]
    return (
        f"{np.mean(first_mv):.0f}",
        *(
            f"{np.mean(ratios):.3f} / {max(ratios):.3f}"
            for ratios in (*([each.ratio(n) for each in some] for n in (_EARLY, REPETITIONS)), kept)
        ),
        f"{np.mean(gauge):.3f} / {max(gauge):.3f}",
        f"{min(runs)} to {max(runs)}",
        f"{sum(ratio > 1.0 for ratio in kept)} of {len(some)}",
    )


if __name__ == "__main__":
    main()
