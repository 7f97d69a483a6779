"""Progress of a whole identification from the progress of its stages."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    Progress = Callable[[str, float], None]

# Where each stage ends, as a part of the whole: rough shares of the time.
_ENDS = {
    "reading": 0.05,
    "gram": 0.1,
    "range space": 0.12,
    "order": 0.3,
    "fit": 0.35,
    "friction": 0.6,
    "refinement": 0.75,
    "reduction": 0.85,
    "validation": 0.92,
    "writing": 1.0,
}
_STARTS = dict(zip(_ENDS, (0.0, *_ENDS.values()), strict=False))


def whole(progress: Progress) -> Progress:
    """Return a callback for stages that reports the part of the whole.

    Parameters
    ----------
    progress : callable
        Called with the name of the stage and the part of the whole that is done: from 0 to 1,
        never less than before. A stage of unknown share leaves the part as it is.

    Returns
    -------
    callable
        To be called with the name of a stage and the part of that stage that is done.
    """
    done = 0.0

    def report(stage: str, fraction: float) -> None:
        nonlocal done
        if stage in _ENDS:
            start, end = _STARTS[stage], _ENDS[stage]
            done = max(done, start + (end - start) * min(max(fraction, 0.0), 1.0))
        progress(stage, done)

    return report
