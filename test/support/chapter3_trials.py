"""Made-up trials of chapter 3: modes and errors of models that were never identified."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexarm_ident.models.modes import Mode
from reproduction.chapter3.examples import (
    ReductionTrial,
    Stage,
    thesis_rows,
)
from reproduction.framework.findings import thesis_table

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.chapter3.examples import ThesisRow

    Levels = Mapping[tuple[str, str], Sequence[float]]
NO_STAGES: Mapping[str, Stage] = MappingProxyType({})


def mode(states: Sequence[int], hz: float, damping: float, mrm: int, msv: int) -> Mode:
    return Mode(
        eigenvalue=0.9 + 0.1j * (len(states) - 1),
        frequency_hz=hz,
        damping_ratio=damping,
        states=tuple(states),
        msv=1.0 / msv,
        mrm=1.0 / mrm,
        msv_rank=msv,
        mrm_rank=mrm,
    )


def modes_like_the_thesis(*, swapped: bool = False) -> tuple[Mode, ...]:
    """Make three bending modes and two rigid ones; by MSV the bending ones come first."""
    ranks = ((3, 1), (4, 2), (5, 3), (1, 4), (2, 5))
    if swapped:
        ranks = tuple((msv, mrm) for mrm, msv in ranks)  # type: ignore[assignment]
    places = (((0, 1), 46.0, 0.03), ((2, 3), 23.0, 0.04), ((4, 5), 9.0, 0.03))
    bending = [mode(*place, *rank) for place, rank in zip(places, ranks[:3], strict=True)]
    return (*bending, mode((6,), 0.0, 1.0, *ranks[3]), mode((7,), 0.0, 1.0, *ranks[4]))


def trial(
    levels: Levels, seed: int = 1, stages: Mapping[str, Stage] = NO_STAGES, **changed: object
) -> ReductionTrial:
    made = dict(stages)
    for name in {stage for stage, _ in levels}:
        dmv = levels.get((name, "dmv"), (1.0,) * 4)
        made[name] = Stage(
            10, (), (9.0, 23.0, 46.0), tuple(dmv), tuple(levels.get((name, "sfv"), ()))
        )
    values: dict[str, Any] = {
        "seed": seed,
        "modes": modes_like_the_thesis(),
        "bending": ("5/6", "3/4", "1/2"),
        "rigid": ("7", "8"),
        "moved": (),
        "stages": made,
        "realisation_difference": 1e-12,
        "models": {},
        "curves": None,
    }
    return ReductionTrial(**values | changed)


def printed_levels(rows: Sequence[ThesisRow]) -> dict[tuple[str, str], Sequence[float]]:
    """Return the thesis's own errors, and some for what it does not print."""
    levels: dict[tuple[str, str], Sequence[float]] = {
        (row.stage, row.validation): row.delta for row in rows
    }
    levels["balanced", "dmv"] = (0.5,) * 4
    for name in ("updated_c", "updated_msv", "updated_msv_c"):
        levels[name, "dmv"] = levels[name, "sfv"] = (0.4,) * 4
    return levels


def rows_of(number: str) -> tuple[ThesisRow, ...]:
    return thesis_rows(thesis_table(f"table_{number.replace('-', '_')}b"))
