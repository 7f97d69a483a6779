"""Verb replay: recorded samples through the recorded law, compared command by command."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.quantity import FiniteRange
from flexarm_bringup.console.verb_group import examples
from flexarm_control.replaying.comparison import read_loop
from flexarm_control.replaying.comparison import replay as replayed
from flexarm_core.errors import BagError, SettingError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_control.replaying.comparison import Difference, Place, Replay

_SHOWN = 5
# Differences up to this much may be those of another machine's arithmetic.
_ROUNDING_V = 1e-9


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option(
    "--tolerance",
    "tolerance_v",
    type=FiniteRange(0.0, 20.0),
    default=0.0,
    show_default="every bit",
    help="Largest difference that counts as none, V: another machine may round otherwise.",
)
@click.option("--topic", help="Topic of the samples, where several arms are in the bag.")
@examples("replay out/experiments/C_dat3", "replay out/run1 --tolerance 1e-9")
def replay(bag: Path, tolerance_v: float, topic: str | None) -> None:
    """Compare recorded commands with those of the recorded law.

    The recorded samples run through the law. Law, parameters, set-points and what the law had in
    memory come from the bag. Exit code 1 when a command differs.
    """
    try:
        outcome = replayed(read_loop(bag, topic), tolerance_v=tolerance_v)
    except SettingError as error:
        raise BagError(f"{bag}: {error}") from error
    if not outcome.compared:
        raise BagError(
            f"{bag}: no command can be compared: none comes after a recorded control law, with its "
            "sample and all commands between them"
        )
    for line in (f"{bag}: {_verdict(outcome, tolerance_v)}", *_details(outcome)):
        terminal.CONSOLE.print(line, soft_wrap=True)
    sys.exit(1 if outcome.differences else 0)


def _verdict(outcome: Replay, tolerance_v: float) -> str:
    """Return the outcome in one line."""
    count = len(outcome.differences)
    laws = ", ".join(outcome.laws)
    extent = f"{laws}, {outcome.samples} samples, {outcome.compared} commands"
    if count:
        return f"{extent}: {count} differ, by {outcome.largest_v:.3g} V at most"
    if outcome.largest_v:
        return f"{extent}: equal within {tolerance_v:g} V, by {outcome.largest_v:.3g} V at most"
    return f"{extent}: equal to the bit"


def _details(outcome: Replay) -> Iterator[str]:
    """Yield changes, differences and what was not compared, one line each."""
    if left := outcome.commands - outcome.compared:
        yield (
            f"  not compared: {left} commands before the first recorded control law, or after a "
            "sample or command that is not in the bag"
        )
    for change in outcome.changes:
        yield f"  change at {_at(change.place)}: {change.text}"
    for difference in outcome.differences[:_SHOWN]:
        yield f"  difference at {_difference(difference)}"
    if len(outcome.differences) > _SHOWN:
        yield f"  and {len(outcome.differences) - _SHOWN} more"
    if outcome.differences and outcome.largest_v <= _ROUNDING_V:
        yield (
            f"  another machine may round so: --tolerance {_ROUNDING_V:g} compares up to that, in V"
        )


def _difference(difference: Difference) -> str:
    parts = (
        f"{name} {recorded!r} V recorded, {recomputed!r} V recomputed"
        for name, recorded, recomputed in zip(
            ("effort", "compensation"),
            difference.recorded.tolist(),
            difference.recomputed.tolist(),
            strict=True,
        )
        if repr(recorded) != repr(recomputed)
    )
    change = difference.change
    after = f"; after {change.text} at {_at(change.place)}" if change else ""
    return f"{_at(difference.place)}: {', '.join(parts)}{after}"


def _at(place: Place) -> str:
    return f"sample {place.sequence} ({place.time_s:.4f} s)"
