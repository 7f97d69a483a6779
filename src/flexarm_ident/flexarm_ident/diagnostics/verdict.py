"""Verdict on an identification: good, usable, poor or not usable, with two figures and a next step.

A control engineer rests on two figures. The first is the fit of a simulation, on data that the
model has not seen if there are any: 100 % is a perfect model, 0 % is the mean. The second is the
part of the residual power that is coherent with the inputs. It shows unmodelled dynamics, which
another model can have, from noise and friction, which no linear model of these inputs can.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.diagnostics.spectra import spectra
from flexarm_ident.subspace.innovations import innovations_of

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
# Part of the residual power that is coherent with the inputs: with more, most can be avoided.
_AVOIDABLE = 0.5
ESTIMATION_DATA, HELD_OUT, CROSS_VALIDATED = "estimation data", "held-out data", "cross-validated"
"""What a fit is computed on."""
_VALIDATE = "validate it on another record, or fit a leading part of this one (train_fraction)"


class Level(IntEnum):
    """Level of a model, the best first."""

    GOOD = 0
    USABLE = 1
    POOR = 2
    NOT_USABLE = 3

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True)
class Verdict:
    """Verdict with the figures that it rests on.

    Attributes
    ----------
    level : Level
        Level of the model.
    error : float
        Mean of the outputs' relative errors in simulation; 1 is that of their means.
    worst : float
        Largest of them.
    worst_output : str
        Name of that output.
    missed : float
        Share of the residual power that is coherent with the inputs, 0 to 1; NaN when it is not
        known.
    validation : str
        What the errors are of: `ESTIMATION_DATA`, `HELD_OUT` or `CROSS_VALIDATED`.
    next_step : str
        What to do next, a main clause.
    """

    level: Level
    error: float
    worst: float
    worst_output: str
    missed: float
    validation: str
    next_step: str

    def __str__(self) -> str:
        figures = "; ".join(filter(None, (self.headline, self.coherence)))
        return f"{figures}. Next: {self.next_step}."

    @property
    def headline(self) -> str:
        """Level and fit, with how the fit is computed and that of the worst output."""
        worse = ", worse than the mean" if self.error >= _WORSE else ""
        lowest = f"; lowest {fit_text(self.worst)}, {self.worst_output}"
        return (
            f"{self.level}{worse}: fit {fit_text(self.error)} (NRMSE, simulation, "
            f"{self.validation}{lowest if self.worst > self.error else ''})"
        )

    @property
    def coherence(self) -> str:
        """Share of the residual power that is coherent with the inputs; empty when not known."""
        if not np.isfinite(self.missed):
            return ""
        meaning = "most of it can be modelled" if self.avoidable else "unmodelled dynamics"
        share = f"{100.0 * self.missed:.0f} % of the residual power"
        return f"{share} is coherent with the input ({meaning})"

    @property
    def avoidable(self) -> bool:
        """Whether a better linear model could remove most of the residual."""
        return self.missed > _AVOIDABLE


def fit_text(error: float) -> str:
    """Return a relative error about the mean as a fit: 100 (1 - NRMSE) in percent."""
    return f"{100.0 * (1.0 - error):.1f} %" if np.isfinite(error) else "-∞ %"


def verdict(
    errors: FloatArray,
    missed: FloatArray,
    outputs: Sequence[str],
    *,
    validation: str,
    defects: Sequence[str] = (),
    few_values: bool = False,
    keep_s: float = 0.0,
) -> Verdict:
    """Return the verdict from the figures of each output.

    Parameters
    ----------
    errors : ndarray, (outputs,)
        Relative errors in simulation; NaN for a constant output.
    missed : ndarray, (outputs,)
        Share of each residual's power that is coherent with the inputs; NaN where it is not known.
    outputs : sequence of str
        Names of the outputs.
    validation : str
        What the errors are of: `ESTIMATION_DATA`, `HELD_OUT` or `CROSS_VALIDATED`.
    defects : sequence of str
        Defects of the data that can be fixed, in words.
    few_values : bool
        Whether the records have too few values for errors on parts of them to be relied on: the
        model is no better than usable then.
    keep_s : float
        Of an unstable plant whose model was made stable: the time in which it can be kept so; 0
        of others.
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
    step = _next_step(level, share, outputs[number], validation=validation, defects=defects)
    if keep_s and level > Level.GOOD:
        step = (
            f"identify a short part with --keep-unstable --to {keep_s:.3g}s (stable=False): the "
            "plant is unstable in its loop, and this model was made stable"
        )
    return Verdict(level, error, worst, outputs[number], share, validation, step)


def missed_shares(
    records: Sequence[IoData], simulated: Sequence[FloatArray], *, reached: bool = False
) -> FloatArray:
    """Return the share of the power of each output's error that is coherent with the inputs.

    Of a closed loop the inputs' innovations stand for them: the inputs themselves hold the outputs'
    noise, and all of an error would seem to follow them.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    simulated : sequence of ndarray, (samples, outputs)
        Simulated outputs of each record.
    reached : bool
        Whether the inputs follow the outputs' noise: records that declare no loop are closed then.

    Returns
    -------
    ndarray, (outputs,)
        Shares, 0 to 1; NaN when the records are too short to tell.
    """
    pairs = [
        _causes(record, y, closed=reached if record.closed_loop is None else record.closed_loop)
        for record, y in zip(records, simulated, strict=True)
    ]
    known = [pair for pair in pairs if pair is not None]
    with np.errstate(over="ignore", invalid="ignore"):
        found = (
            spectra([cause for cause, _ in known], [error for _, error in known]) if known else None
        )
    return np.full(len(records[0].outputs), np.nan) if found is None else found.explained


def _causes(record: IoData, y: FloatArray, *, closed: bool) -> tuple[IoData, FloatArray] | None:
    """Return a record with what its error is compared with as inputs, and the error."""
    with np.errstate(over="ignore", invalid="ignore"):
        error = record.y_usable[: len(y)] - y[: len(record)]
    error[~np.isfinite(error)] = np.nan
    if not closed:
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
    level: Level, missed: float, worst_output: str, *, validation: str, defects: Sequence[str]
) -> str:
    listed = ", ".join(dict.fromkeys(defects))
    if level == Level.GOOD:
        step = f"{_VALIDATE}, then use it" if validation == ESTIMATION_DATA else "use the model"
        return f"{step}, but check the data ({listed}), see the notes" if listed else step
    if listed:
        return f"fix the data ({listed}), see the notes"
    if missed > _AVOIDABLE:
        return (
            "try another method, a higher order, feedthrough or friction: the residual is coherent "
            "with the input"
        )
    if level == Level.USABLE:
        return "design with a gain margin of 2 or more; a larger excitation improves the fit"
    return (
        "increase excitation amplitude or length, or decrease the amplitude where the plant is "
        f"nonlinear; improve the measurement of {worst_output}, or leave it out: noise, friction "
        "or an unmeasured input makes most of the residual"
    )
