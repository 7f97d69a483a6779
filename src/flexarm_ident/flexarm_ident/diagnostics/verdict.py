"""Verdict on an identification: good, usable, poor or useless, with two figures and the next step.

A control engineer rests on two figures. The first is the error of a free simulation on data that
the model has not seen, in units of the outputs' RMS: 1 is no better than a line at zero. The second
is the part of this error that still follows the inputs. It tells missing dynamics, which another
model can have, from noise and disturbances, which no model that is driven by these inputs can.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray

# A loop with a complementary sensitivity below 1 / e stands a relative error e of its plant
# (small-gain theorem). Peaks of up to 2 are usual, so half the output is the most that a design may
# miss; a fifth leaves room for any peak up to 5, beyond all that is built.
_GOOD = 0.2
_USABLE = 0.5
# Less than a fifth of the power is explained: 1 - 0.9**2 = 0.19. A gain would have told as much.
_POOR = 0.9
# Part of the error's power that follows the inputs: with more, most of it can be avoided.
_MOSTLY_AVOIDABLE = 0.5


class Level(IntEnum):
    """Grades of a model, the best first."""

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
        Grade of the model.
    error : float
        Mean of the outputs' relative errors in free simulation; 1 is that of a line at zero.
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
        data = "data it has not seen" if self.unseen else "the fitted data (none were left out)"
        worst = f", worst {self.worst:.3g} at {self.worst_output}"
        text = (
            f"{self.level}: free-run error {self.error:.3g} of the outputs on {data}{worst}, a "
            "line at zero has 1"
        )
        if np.isfinite(self.missed):
            text += f"; {100.0 * self.missed:.0f} % of its power follows the inputs"
        return f"{text}. Next: {self.next_step}."


def verdict(
    errors: FloatArray,
    missed: FloatArray,
    outputs: Sequence[str],
    *,
    unseen: bool,
    unusable: Sequence[str] = (),
) -> Verdict:
    """Return the verdict from the figures of each output.

    Parameters
    ----------
    errors : ndarray, (outputs,)
        Relative errors in free simulation (2-25), of any kind of validation.
    missed : ndarray, (outputs,)
        Share of each error's power that follows the inputs; NaN where it is not known.
    outputs : sequence of str
        Names of the outputs.
    unseen : bool
        Whether the errors are of data that the model has not seen.
    unusable : sequence of str
        Defects of the data by which they should not be used.
    """
    error, number = float(np.mean(errors)), int(np.argmax(errors))
    worst = float(errors[number])
    # One output may be a grade worse than the others: it can be left out.
    level = Level(max(_level(error), _level(worst) - 1))
    known = np.isfinite(missed) & np.isfinite(errors)
    weight = np.where(known, errors, 0.0) ** 2
    share = float(np.sum(weight * np.nan_to_num(missed)) / weight.sum()) if weight.any() else np.nan
    step = _next_step(level, share, worst, outputs[number], unseen=unseen, unusable=unusable)
    return Verdict(level, error, worst, outputs[number], share, unseen, step)


def _level(error: float) -> Level:
    limits = (_GOOD, _USABLE, _POOR)
    return Level(sum(not error <= limit for limit in limits))


def _next_step(
    level: Level,
    missed: float,
    worst: float,
    worst_output: str,
    *,
    unseen: bool,
    unusable: Sequence[str],
) -> str:
    if unusable and level > Level.GOOD:
        return f"mend the data, {', '.join(unusable)}"
    if level == Level.GOOD:
        return "use it" if unseen else "validate it on another record before use"
    if missed > _MOSTLY_AVOIDABLE:
        return (
            "the inputs tell more than the model: try another method, order or friction, and look "
            "for a delay or a change in the record"
        )
    if level == Level.USABLE:
        return "design with margins; a stronger excitation or less noise would make it better"
    if worst > _POOR:
        return (
            f"look at {worst_output}: what it does is not from these inputs; drive harder, measure "
            "better, or leave it out"
        )
    return (
        "the rest is noise, disturbance or friction that no linear model of these inputs has: "
        "drive harder and longer, or measure better"
    )
