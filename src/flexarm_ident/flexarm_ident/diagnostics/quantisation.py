"""Quantisation: outputs of few levels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.diagnostics.check import Check, each_record
from flexarm_ident.records.data_warning import Kind
from flexarm_ident.records.signals import CONSTANT_SHARE, constant_share

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

_LOOK = 8192
# Rounding to steps q adds an error of q / sqrt(12), uniform over a step: no model gets below it.
# It is named when it is half of what a good model may miss. A signal has less than 18 levels within
# three deviations to both sides then, and hardly more than ten times as many in all.
_LARGEST_ERROR = 0.1
_MOST_LEVELS = 200
_SAME_LEVEL = 1e-6
_OFF_GRID = 0.05
_ON_GRID = 0.9
_FEWEST = 100


def quantisation(record: IoData) -> Iterator[DataWarning]:
    """Yield the outputs of a record whose rounding to levels alone is a large error."""
    for name, y in zip(record.outputs, record.y.T, strict=True):
        if len(y) < _FEWEST or constant_share(y) > CONSTANT_SHARE:
            continue
        step, levels = _step(y)
        error = step / np.sqrt(12.0) / float(y.std())
        if error > _LARGEST_ERROR:
            yield _KIND(
                f"{name} moves in steps of {step:.3g}, over {levels} levels: the rounding alone is "
                f"{100.0 * error:.2g} % of its deviation; amplify the signal, or convert it finer",
                {"step": step, "levels": float(levels), "error": error},
                channel=name,
            )


def _step(y: FloatArray) -> tuple[float, int]:
    """Return the distance of neighbouring levels and their number; zero for many levels."""
    levels = np.unique(y[:: max(1, len(y) // _LOOK)])
    levels = levels[np.concatenate([[True], np.diff(levels) > _SAME_LEVEL * np.ptp(levels)])]
    if not 1 < len(levels) <= min(_MOST_LEVELS, len(y) // 4):
        return 0.0, len(levels)
    # Levels that were not visited leave gaps, and a filled hole may lie between two.
    step = float(np.quantile(np.diff(levels), 0.25))
    off = (levels - levels[0]) / step
    on_grid = np.abs(off - np.rint(off)) < _OFF_GRID
    return (step, len(levels)) if on_grid.mean() > _ON_GRID else (0.0, len(levels))


_KIND = Kind(
    "quantisation",
    "Quantisation",
    "rounding to the levels alone, q / sqrt(12), is a tenth of the deviation",
    "amplify the signal, or convert it finer",
)
CHECKS = (Check(each_record(quantisation), (_KIND,)),)
