"""When samples were taken: gaps in their numbering and the period of their stamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.data_warning import DataWarning
from flexarm_ident.errors import DataError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# A rate this near to a whole number of hertz is that number.
WHOLE_RATE_TOLERANCE = 1e-3
# A step further from the usual one than this part of it is irregular.
STEP_TOLERANCE = 0.5
# Intervals that scatter by this part of the period, RMS, matter to a model of even ones.
JITTER_TOLERANCE = 0.1
_NS = 1_000_000_000


@dataclass(frozen=True)
class Run:
    """The longest stretch of samples whose sequence numbers follow each other.

    Attributes
    ----------
    rows
        Its messages.
    breaks
        Number of places where the sequence jumps or starts again.
    lost
        Samples missing in all jumps.
    """

    rows: slice
    breaks: int
    lost: int


def longest_run(sequence: NDArray[np.int64]) -> Run:
    """Find the longest stretch without a gap; of equal ones the first.

    Parameters
    ----------
    sequence : (samples,)
        Counts samples; a jump means lost samples, a step back a restart.

    Returns
    -------
    Run
        Where it is, and what the gaps are.
    """
    steps = np.diff(sequence)
    cuts = np.flatnonzero(steps != 1) + 1
    edges = np.concatenate(([0], cuts, [len(sequence)]))
    longest = int(np.argmax(np.diff(edges)))
    lost = int(np.sum(steps[steps > 1] - 1))
    return Run(slice(int(edges[longest]), int(edges[longest + 1])), len(cuts), lost)


def lost_samples(run: Run, samples: int) -> tuple[DataWarning, ...]:
    """Return the warning ``lost_samples`` about gaps in the numbering; nothing without a gap.

    Parameters
    ----------
    run : Run
        The part that is used.
    samples : int
        Samples that were recorded.

    Returns
    -------
    tuple of DataWarning
        With the figures lost, places, first_row, last_row (of the used part) and samples.
    """
    if run.breaks == 0:
        return ()
    first, last = run.rows.start, run.rows.stop - 1
    what = f"{run.lost} samples lost" if run.lost else "the numbering starts again"
    text = (
        f"{what} at {run.breaks} places: used rows {first} to {last} of {samples}, the longest part"
        " without a gap"
    )
    counts = (run.lost, run.breaks, first, last, samples)
    names = ("lost", "places", "first_row", "last_row", "samples")
    figures = dict(zip(names, map(float, counts), strict=True))
    return (DataWarning("lost_samples", text, figures),)


def sampling_period_s(stamps_ns: NDArray[np.int64]) -> tuple[float, tuple[DataWarning, ...]]:
    """Return the usual step between stamps and what is odd about the others.

    Parameters
    ----------
    stamps_ns : (samples,)
        Of samples that follow each other, at least two.

    Returns
    -------
    float
        Period in seconds, of a whole number of hertz when within 0.1 % of it.
    tuple of DataWarning
        ``clock_jitter``, where a step is off by half a period or all scatter by a tenth, RMS.

    Raises
    ------
    DataError
        If the stamps do not advance.
    """
    jitter = Jitter()
    usual_s = jitter.add(np.diff(stamps_ns))
    rate_hz = 1 / usual_s
    whole = round(rate_hz)
    period_s = 1 / whole if abs(rate_hz - whole) <= WHOLE_RATE_TOLERANCE * rate_hz else usual_s
    return period_s, jitter.warnings(usual_s)


class Jitter:
    """How far sampling intervals are from the usual one; takes them in pieces."""

    def __init__(self) -> None:
        self._count = self._irregular = 0
        self._squares_s2 = self._worst_s = self._off_s = 0.0
        self._worst_row = 0

    def add(self, steps_ns: NDArray[np.int64]) -> float:
        """Take some intervals, one or more, and return their median in seconds.

        Raises
        ------
        DataError
            If the stamps do not advance.
        """
        steps_s = steps_ns / _NS
        usual_s = float(np.median(steps_s))
        if usual_s <= 0:
            raise DataError(
                "the stamps do not advance; set the clock of the recording machine right"
            )
        off_s = np.abs(steps_s - usual_s)
        worst = int(np.argmax(off_s))
        if off_s[worst] > self._off_s:
            self._off_s, self._worst_s = float(off_s[worst]), float(steps_s[worst])
            self._worst_row = self._count + worst
        self._count += len(steps_s)
        self._irregular += int(np.count_nonzero(off_s > STEP_TOLERANCE * usual_s))
        self._squares_s2 += float(off_s @ off_s)
        return usual_s

    def warnings(self, usual_s: float) -> tuple[DataWarning, ...]:
        """Return the warning ``clock_jitter``; nothing for a steady clock.

        Its figures are irregular, intervals, worst_s, row (of the worst), usual_s and deviation_s.
        """
        deviation_s = float(np.sqrt(self._squares_s2 / max(self._count, 1)))
        if not self._irregular and deviation_s <= JITTER_TOLERANCE * usual_s:
            return ()
        text = (
            f"{self._irregular} of {self._count} sampling intervals are irregular, the worst"
            f" {1e3 * self._worst_s:.3f} ms after row {self._worst_row} (usually"
            f" {1e3 * usual_s:.3f} ms, {1e3 * deviation_s:.3f} ms RMS off)"
        )
        figures = {
            "irregular": float(self._irregular),
            "intervals": float(self._count),
            "worst_s": self._worst_s,
            "row": float(self._worst_row),
            "usual_s": usual_s,
            "deviation_s": deviation_s,
        }
        return (DataWarning("clock_jitter", text, figures),)
