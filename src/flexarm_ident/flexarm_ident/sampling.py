"""When samples were taken: gaps in their numbering and the period of their stamps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.errors import DataError

if TYPE_CHECKING:
    from numpy.typing import NDArray

# A rate this near to a whole number of hertz is that number.
WHOLE_RATE_TOLERANCE = 1e-3
# A step further from the usual one than this part of it is irregular.
STEP_TOLERANCE = 0.5
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


def sampling_period_s(stamps_ns: NDArray[np.int64]) -> tuple[float, tuple[str, ...]]:
    """Return the usual step between stamps and what is odd about the others.

    Parameters
    ----------
    stamps_ns : (samples,)
        Of samples that follow each other, at least two.

    Returns
    -------
    tuple
        Period in seconds, of a whole number of hertz when within 0.1 % of it, and warnings.

    Raises
    ------
    DataError
        If the stamps do not advance.
    """
    steps_s = np.diff(stamps_ns) / _NS
    usual_s = float(np.median(steps_s))
    if usual_s <= 0:
        raise DataError("the stamps do not advance; set the clock of the recording machine right")
    deviation = np.abs(steps_s - usual_s)
    irregular = int(np.count_nonzero(deviation > STEP_TOLERANCE * usual_s))
    warnings: tuple[str, ...] = ()
    if irregular:
        worst = int(np.argmax(deviation))
        warning = (
            f"{irregular} of {len(steps_s)} sampling intervals are irregular, the worst"
            f" {1e3 * steps_s[worst]:.3f} ms after row {worst} (usually {1e3 * usual_s:.3f} ms)"
        )
        warnings = (warning,)
    rate_hz = 1 / usual_s
    whole = round(rate_hz)
    if abs(rate_hz - whole) <= WHOLE_RATE_TOLERANCE * rate_hz:
        return 1 / whole, warnings
    return usual_s, warnings
