"""Findings about the sampling: runs, holes and late samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import counted, instant
from flexarm_ident.reading.grid import LATEST
from flexarm_ident.records.data_warning import LOST_SAMPLES, PARTIAL_RECORD, SAMPLING, Grade
from flexarm_ident.records.holes import holes_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_ident.reading.grid import Grid
    from flexarm_ident.records.data_warning import DataWarning

# Instants that scatter by this part of the period, RMS, matter to a model of even ones.
JITTER_TOLERANCE = 0.1
CUT = 0.05
"""Part of a record that may be left out without harm."""


@dataclass(frozen=True)
class Run:
    """The longest run of samples with rising numbers.

    Attributes
    ----------
    messages : slice
        Its messages.
    restarts : int
        Restarts of the numbering on the topic.
    """

    messages: slice
    restarts: int


def longest_run(sequence: NDArray[np.int64]) -> Run:
    """Return the longest run in which the numbers, (samples,), go up; of equal ones the first."""
    cuts = np.flatnonzero(np.diff(sequence) < 1) + 1
    edges = np.concatenate(([0], cuts, [len(sequence)]))
    longest = int(np.argmax(np.diff(edges)))
    return Run(slice(int(edges[longest]), int(edges[longest + 1])), len(cuts))


def notices(run: Run, grid: Grid, messages: int) -> tuple[DataWarning, ...]:
    """Return what is reported of restarts, holes and late samples, each where it applies.

    Parameters
    ----------
    run : Run
        The run that is used.
    grid : Grid
        Its samples on the grid.
    messages : int
        Messages on the topic.
    """
    return (*_restarted(run, messages), *_lost_samples(grid), *_clock_jitter(grid))


def _restarted(run: Run, messages: int) -> tuple[DataWarning, ...]:
    if not run.restarts:
        return ()
    first, last = run.messages.start, run.messages.stop - 1
    text = (
        f"the numbering starts again at {counted(run.restarts, 'place')}: used messages {first} "
        f"to {last} of {messages}, the longest run"
    )
    figures = {
        "places": float(run.restarts),
        "first": float(first),
        "last": float(last),
        "messages": float(messages),
    }
    return (PARTIAL_RECORD(text, figures),)


def _lost_samples(grid: Grid) -> tuple[DataWarning, ...]:
    if not grid.missing.any():
        return ()
    text, figures = holes_text(grid.missing, grid.period_s, lost=grid.lost)
    for pause_s in grid.pauses_s:
        text += (
            f"; a pause of {pause_s:.6g} s counts as one of {grid.samples * grid.period_s:.6g} s"
        )
    harmless = figures["left_out"] <= CUT * grid.rows
    grade = Grade.INFORMATION if harmless else Grade.CAUTION
    return (LOST_SAMPLES(text, figures, grade=grade),)


def _clock_jitter(grid: Grid) -> tuple[DataWarning, ...]:
    off = grid.instants - np.rint(grid.instants)
    late = np.abs(off) > LATEST
    deviation = float(np.sqrt(np.mean(off**2)))
    if not late.any() and deviation <= JITTER_TOLERANCE:
        return ()
    worst = int(np.argmax(np.abs(off)))
    row = int(np.rint(grid.instants[worst]))
    period_ms = 1e3 * grid.period_s
    text = (
        f"{int(late.sum())} of {len(off)} samples were taken more than {LATEST:g} periods off "
        f"their instants, the worst by {period_ms * off[worst]:+.3f} ms at "
        f"{instant(row, grid.period_s)} (all {period_ms * deviation:.3f} ms RMS, the period is "
        f"{period_ms:.3f} ms): they were referred to their instants by their neighbours"
    )
    figures = {
        "late": float(late.sum()),
        "samples": float(len(off)),
        "worst_s": grid.period_s * float(off[worst]),
        "row": float(row),
        "period_s": grid.period_s,
        "deviation_s": grid.period_s * deviation,
    }
    return (SAMPLING(text, figures),)
