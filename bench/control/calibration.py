"""Calibration of the study's rig: what each of its parameters does to the thesis's figures.

A rig is as good as its figures lie near the thesis's, chapter by chapter. From a start, each
parameter in turn goes to the value next to its own on a grid while that pays. Rigs on which the
study is not defined are refused. The points are kept, so that the same command goes on where it
stood and gives the same table.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from bench.tools import count_option, json_option, make_table, write_json, write_table
from flexarm_bringup.console import terminal
from flexarm_core.workers import Workers
from flexarm_daq import RigParameters
from flexarm_daq.rigs.rig_parameters import THESIS_NOISE_V
from reproduction.calibration.figures import (
    CHAPTERS,
    NOISES,
    Point,
    parts,
    summed,
    unstable_order_of,
)
from reproduction.chapter4.pdpc import ZERO_ERROR_V
from reproduction.framework.computing import Store, computed
from reproduction.framework.findings import SEEDS, Call
from reproduction.framework.study_rig import STUDY_RIG

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from reproduction.calibration.figures import Changes, Value

CACHE = Path("out/calibration")
PAGE = Path(__file__).parents[2] / "docs" / "rig.md"
WORTH = 0.005
"""A step pays when the mean distance falls by more."""
_GAUGE_NOISE_V = ((0.2, 0.1), (0.4, 0.2), (0.7, 0.45), (1.0, 0.7))
_GAUGE_HUM_V = ((0.0, 0.0), (0.2, 0.1))
GRID: Mapping[str, tuple[Value, ...]] = {
    "base_gauge_v_per_nm": (1.6, 2.4),
    "middle_gauge_v_per_nm": (1.1, 1.7),
    "noise_v": tuple((THESIS_NOISE_V[0], *gauges, THESIS_NOISE_V[3]) for gauges in _GAUGE_NOISE_V),
    "coulomb_friction_nm": tuple(0.55 * volts for volts in (0.5, 0.64, 0.7)),
    "breakaway_ratio": (1.0, 1.1),
    "viscous_friction_nm_s_per_rad": (0.05, 0.1, 0.2),
    "mass_damping_per_s": (0.5, 1.0, 2.0),
    "stiffness_damping_s": (1.5e-4, 4e-4),
    "backlash_deg": (0.05, 0.2),
    "hum_v": tuple((0.0, *gauges, 0.0) for gauges in _GAUGE_HUM_V),
}
"""Values of each parameter: inertia and beam stay as the modes fix them."""
_START = RigParameters(noise_v=THESIS_NOISE_V)


def search(
    start: Mapping[str, Value],
    measure: Callable[[Mapping[str, Value]], Point | None],
    is_defined: Callable[[Mapping[str, Value]], bool],
    grid: Mapping[str, Sequence[Value]],
    passes: int,
) -> tuple[Point, list[Point]]:
    """Let one parameter after the other go along its grid while that pays.

    Parameters
    ----------
    start : dict
        Values of the parameters of the grid.
    measure : callable
        Gives the point of a rig, or None for one that is refused.
    is_defined : callable
        Tells whether the study is defined on a rig that would be taken.
    grid : dict
        Values of each parameter, in their order.
    passes : int
        Most passes over all parameters; fewer when one brings nothing.

    Returns
    -------
    tuple of Point and list of Point
        The best point, and all that were measured, the start first, each once.

    Raises
    ------
    ValueError
        If the start is refused.
    """
    best = measure(start)
    if best is None:
        raise ValueError("the rig that the search starts from is refused")
    measured = [best]
    for _ in range(passes):
        before = best
        for name, values in grid.items():
            here = values.index(best.changes[name])
            for way in (values[here + 1 :], values[:here][::-1]):
                found, points = _along(name, way, best, measure, is_defined)
                measured += [point for point in points if point not in measured]
                if found is not best:
                    best = found
                    break
        if best is before:
            break
    return best, measured


def _along(
    name: str,
    way: Sequence[Value],
    best: Point,
    measure: Callable[[Mapping[str, Value]], Point | None],
    is_defined: Callable[[Mapping[str, Value]], bool],
) -> tuple[Point, list[Point]]:
    """Give a parameter one value after the other while that pays."""
    points = []
    for value in way:
        point = measure({**best.changes, name: value})
        if point is None:
            break
        points.append(point)
        if point.distance > best.distance - WORTH or not is_defined(point.changes):
            break
        best = point
    return best, points


class Bench:
    """Measures rigs, and keeps what it has measured."""

    def __init__(self, seeds: int, jobs: int | None) -> None:
        self._seeds = SEEDS[:seeds]
        self._store, self._workers = Store(CACHE), Workers(jobs or -1)

    def measure(self, changes: Mapping[str, Value]) -> Point | None:
        """Return the point of a rig, or None for one without a study or with a poor tracking."""
        key = differing(changes)
        found = self._computed(parts(key, self._seeds))
        if found is None:
            return None
        point = summed(changes, [each for part in found for each in part])
        terminal.CONSOLE.print(f"{point.total} within, distance {point.distance:.3f}: {dict(key)}")
        return point if point.tracking_v <= ZERO_ERROR_V else None

    def is_defined(self, changes: Mapping[str, Value]) -> bool:
        """Return whether each record of the unstable example has an unstable order."""
        key = differing(changes)
        calls = [Call(unstable_order_of, (key, noise, seed)) for noise in NOISES for seed in SEEDS]
        return self._computed(calls) is not None

    def _computed(self, calls: Sequence[Call]) -> list[Any] | None:
        results = self._store.find(calls)
        failed = False
        missing = [call for call in calls if call not in results]
        for call, result, failure in computed(missing, self._workers):
            if failure:
                terminal.CONSOLE.print(f"refused: {failure}")
                failed = True
                continue
            self._store.keep(call, result)
            results[call] = result
        return None if failed else [results[call] for call in calls]


def differing(changes: Mapping[str, Value]) -> Changes:
    """Return the parameters that differ from those of the study's rig, in order."""
    return tuple(
        (name, value)
        for name, value in sorted(changes.items())
        if value != getattr(STUDY_RIG, name)
    )


@click.command()
@count_option("--passes", 4)
@count_option("--seeds", 1)
@click.option("--only", "names", multiple=True, type=click.Choice(tuple(GRID)), help="Parameters.")
@click.option("--jobs", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--docs", is_flag=True, help="Write the table into docs/rig.md.")
@json_option
def main(
    *,
    passes: int,
    seeds: int,
    names: tuple[str, ...],
    jobs: int | None,
    docs: bool,
    json_file: Path | None,
) -> None:
    """Look for a better rig from the default one, and print what each parameter does."""
    bench = Bench(seeds, jobs)
    grid = {name: values for name, values in GRID.items() if name in (names or GRID)}
    start = {name: getattr(_START, name) for name in GRID}
    best, measured = search(start, bench.measure, bench.is_defined, grid, passes)
    rows = effects(best, measured)
    table = make_table(*HEADINGS, words=2)
    for row in rows:
        table.add_row(*row)
    terminal.show_table(table)
    if docs:
        write_table(PAGE, "calibration", HEADINGS, rows)
    write_json(json_file, {"best": best, "measured": measured})


HEADINGS = (
    *("parameter", "value"),
    *(f"{'appendix' if each == 'B' else 'chapter'} {each}" for each in CHAPTERS),
    *("all", "distance"),
)


def effects(best: Point, measured: Sequence[Point]) -> list[tuple[str, ...]]:
    """Return rows of the start, the best rig, and those beside it: each has one other parameter."""
    rows = [
        _row("start: the default rig, with noise", "", measured[0]),
        _row("best found", "", best),
    ]
    for name in best.changes:
        others = {key: value for key, value in best.changes.items() if key != name}
        rows += [
            _row(name, _text(point.changes[name]), point)
            for point in measured
            if point != best and others.items() <= point.changes.items()
        ]
    return rows


def _row(name: str, value: str, point: Point) -> tuple[str, ...]:
    counts = (f"{point.within[each]} of {point.figures[each]}" for each in CHAPTERS)
    whole = f"{point.total} of {sum(point.figures.values())}"
    return (name, value, *counts, whole, f"{point.distance:.2f}")


def _text(value: Value) -> str:
    return " ".join(f"{each:g}" for each in np.atleast_1d(value))


if __name__ == "__main__":
    main()
