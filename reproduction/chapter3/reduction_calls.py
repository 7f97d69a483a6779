"""The computations of chapter 3, and figures of many records from their results."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from reproduction.chapter3.reduction_stages import LOW, THESIS
from reproduction.chapter3.reduction_trial import reduction_trial
from reproduction.framework.evidence import SEEDS
from reproduction.framework.subjects import Call

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from reproduction.chapter3.reduction_stages import ReductionTrial
    from reproduction.framework.subjects import Results

Validation: TypeAlias = Literal["dmv", "sfv"]
INITIAL = "initial"
RUNS_AWAY = 10.0
"""A simulation whose error is ten times its signal is of a loop that is not stable."""


def calls(code: str, noise: str) -> tuple[Call, ...]:
    """Return the computations of one example, one per seed."""
    return tuple(Call(reduction_trial, (code, noise, seed)) for seed in SEEDS)


def both_calls(code: str) -> tuple[Call, ...]:
    """Return those with little noise and with the thesis's."""
    return (*calls(code, LOW), *calls(code, THESIS))


def trials(results: Results, code: str, noise: str) -> tuple[ReductionTrial, ...]:
    """Look the results of `calls` up."""
    return tuple(results[call] for call in calls(code, noise))


def errors(
    found: Sequence[ReductionTrial], stage: str, validation: Validation = "dmv"
) -> NDArray[np.float64]:
    """Return the errors of a stage, (seeds, 4)."""
    return np.array([getattr(trial.stages[stage], validation) for trial in found])


def means(
    found: Sequence[ReductionTrial], stage: str, validation: Validation = "dmv"
) -> NDArray[np.float64]:
    """Return the mean errors of a stage, (seeds,)."""
    return np.asarray(errors(found, stage, validation).mean(axis=1))


def ratios(
    found: Sequence[ReductionTrial], stage: str, validation: Validation = "dmv"
) -> NDArray[np.float64]:
    """Return the mean errors of a stage as parts of the full model's.

    Records are left out in which the loop with the full model runs away; where that is all of
    them, the part is infinite.
    """
    full = means(found, INITIAL, validation)
    steady = full < RUNS_AWAY
    if not steady.any():
        return np.array([np.inf])
    return np.asarray(means(found, stage, validation)[steady] / full[steady])


def error_text(value: float) -> str:
    """Return an error as text."""
    return f"{value:.3f}" if value < RUNS_AWAY else "runs away"


def ratio_text(values: NDArray[np.float64]) -> str:
    """Return the median of `ratios` as text."""
    middle = float(np.median(values))
    return f"{middle:.2f}" if middle < RUNS_AWAY else "runs away"


def errors_text(values: NDArray[np.float64]) -> str:
    """Return median and range of an error as text."""
    low, high = float(values.min()), float(values.max())
    return f"{error_text(float(np.median(values)))} ({error_text(low)} to {error_text(high)})"
