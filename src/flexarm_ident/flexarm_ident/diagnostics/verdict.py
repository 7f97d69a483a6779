"""Verdict on an identification: good, usable, poor or useless, with two figures and the next step.

A control engineer rests on two figures. The first is the error of a free simulation, of data that
the model has not seen if there are any, in units of the outputs' deviation: 1 is no better than the
mean. The second is the part of this error that still follows the inputs. It tells missing dynamics,
which another model can have, from noise and friction, which no linear model of these inputs can.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.diagnostics.innovations import innovations_of
from flexarm_ident.diagnostics.spectra import spectra

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

# A loop whose complementary sensitivity stays below 1 / e stands a relative error e of its plant
# (small-gain theorem). Peaks of up to 2 are usual, so half the output is the most that a design may
# miss; a fifth leaves room for a peak of 5, beyond all that is built.
_GOOD = 0.2
_USABLE = 0.5
# Less than a fifth of the power is explained: 1 - 0.9**2 = 0.19.
_POOR = 0.9
# Larger by what three digits show.
_WORSE = 1.005
# Part of the error's power that follows the inputs: with more, most of it can be avoided.
_AVOIDABLE = 0.5
_VALIDATE = "validate it on another record, or fit a leading part of this one (train_fraction)"

_KEEP_UNSTABLE = (
    "identify a short part with --keep-unstable (stable=False), as the plant is unstable in its "
    "loop and this model was made stable"
)


class Level(IntEnum):
    """Level of a model, the best first."""

    GOOD = 0
    USABLE = 1
    POOR = 2
    USELESS = 3

    def __str__(self) -> str:
        return self.name.lower()


@dataclass(frozen=True)
class Verdict:
    """Verdict with the figures that it rests on.

    Attributes
    ----------
    level : Level
        Level of the model.
    error : float
        Mean of the outputs' relative errors in free simulation; 1 is that of their means.
    worst : float
        Largest of them.
    worst_output : str
        Name of that output.
    missed : float
        Share of the error's power that follows the inputs, 0 to 1; NaN when it is not known.
    unseen : bool
        Whether the errors are of data that the model has not seen.
    next_step : str
        What to do next, a main clause.
    """

    level: Level
    error: float
    worst: float
    worst_output: str
    missed: float
    unseen: bool
    next_step: str

    def __str__(self) -> str:
        worse = ", worse than the mean" if self.error >= _WORSE else ""
        data = "data that were not fitted" if self.unseen else "the fitted data"
        text = (
            f"{self.level}{worse}: error {self.error:.3g} in free simulation of {data} (worst "
            f"{self.worst:.3g}, {self.worst_output}; the mean has 1)"
        )
        if np.isfinite(self.missed):
            text += f", {100.0 * self.missed:.0f} % of the error's power follows the inputs"
        return f"{text}. Next: {self.next_step}."


def verdict(
    errors: FloatArray,
    missed: FloatArray,
    outputs: Sequence[str],
    *,
    unseen: bool,
    defects: Sequence[str] = (),
    few_values: bool = False,
    unstable: bool = False,
) -> Verdict:
    """Return the verdict from the figures of each output.

    Parameters
    ----------
    errors : ndarray, (outputs,)
        Relative errors in free simulation of any validation; NaN for a constant output.
    missed : ndarray, (outputs,)
        Share of each error's power that follows the inputs; NaN where it is not known.
    outputs : sequence of str
        Names of the outputs.
    unseen : bool
        Whether the errors are of data that the model has not seen.
    defects : sequence of str
        Defects of the data that can be mended, in words.
    few_values : bool
        Whether the records have too few values for errors on parts of them to be relied on: the
        model is no better than usable then.
    unstable : bool
        Whether the plant is unstable and the model was made stable.
    """
    known = np.flatnonzero(~np.isnan(errors))
    number = int(known[np.argmax(errors[known])])
    error, worst = float(errors[known].mean()), float(errors[number])
    share = _joined(errors[known], missed[known])
    # One output may be a level worse than the others: it can be left out.
    level = Level(max(_level(error), _level(worst) - 1))
    if level == Level.POOR and worst < _WORSE and error * np.sqrt(share) <= _GOOD:
        # As good as the record allows: what is missing follows no input. Noise alone is as large as
        # the output at most.
        level = Level.USABLE
    if few_values:
        level = max(level, Level.USABLE)
    step = _next_step(level, share, outputs[number], unseen=unseen, defects=defects)
    if unstable and level > Level.GOOD:
        step = _KEEP_UNSTABLE
    return Verdict(level, error, worst, outputs[number], share, unseen, step)


def missed_shares(records: Sequence[IoData], simulated: Sequence[FloatArray]) -> FloatArray:
    """Return the share of the power of each output's error that is coherent with the inputs.

    Of a closed loop the inputs' innovations stand for them: the inputs themselves hold the outputs'
    noise, and all of an error would seem to follow them.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    simulated : sequence of ndarray, (samples, outputs)
        Simulated outputs of each record.

    Returns
    -------
    ndarray, (outputs,)
        Shares, 0 to 1; NaN when the records are too short to tell.
    """
    pairs = [_causes(record, y) for record, y in zip(records, simulated, strict=True)]
    told = [pair for pair in pairs if pair is not None]
    with np.errstate(over="ignore", invalid="ignore"):
        found = (
            spectra([cause for cause, _ in told], [error for _, error in told]) if told else None
        )
    return np.full(len(records[0].outputs), np.nan) if found is None else found.explained


def _causes(record: IoData, y: FloatArray) -> tuple[IoData, FloatArray] | None:
    """Return a record with what its error is compared with as inputs, and the error."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = record.y_usable[: len(y)] - y[: len(record)]
    error[~np.isfinite(error)] = np.nan
    if not record.closed_loop:
        return record.head(len(error)), error
    innovations = innovations_of(record)
    if innovations is None:
        return None
    rows = slice(innovations.rows.start, min(innovations.rows.stop, len(error)))
    part = record.rows(rows)
    return replace(part, u=innovations.inputs[: len(part)], compensation=None), error[rows]


def _joined(errors: FloatArray, missed: FloatArray) -> float:
    """Return the share over all outputs, weighted by the power of their errors."""
    power = np.where(np.isfinite(errors) & np.isfinite(missed), errors, 0.0) ** 2
    if not power.any():
        return float("nan")
    return float(np.sum(power * np.nan_to_num(missed)) / power.sum())


def _level(error: float) -> Level:
    return Level(sum(not error <= limit for limit in (_GOOD, _USABLE, _POOR)))


def _next_step(
    level: Level, missed: float, worst_output: str, *, unseen: bool, defects: Sequence[str]
) -> str:
    listed = ", ".join(dict.fromkeys(defects))
    if level == Level.GOOD:
        step = "use it" if unseen else f"{_VALIDATE}, then use it"
        return f"{step}, but mind the data ({listed}), see the notes" if listed else step
    if listed:
        return f"mend the data first ({listed}), see the notes"
    if missed > _AVOIDABLE:
        return (
            "try another method, a higher order, feedthrough or friction, as the inputs tell more "
            "than the model"
        )
    if level == Level.USABLE:
        return "design with a gain margin of 2 or more; harder driving or less noise would help"
    return (
        "drive harder and longer, or less hard where the plant is not linear, measure "
        f"{worst_output} better or leave it out: noise, friction or something beside these inputs "
        "makes most of the error"
    )
