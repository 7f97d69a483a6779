"""Untold filters: low-passes of outputs that the records do not show, left out of the model.

A filter that is much faster than the sampling changes nothing. Its states would be modes without a
meaning: dead after one sample, or ringing at an alias of a frequency far above the samples.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.arm.equations import FlexibleArm
    from flexarm_ident.arm.simulation_error import SimulationError
    from flexarm_ident.fitting.levenberg_marquardt import Minimum

# A cost that rises by 2 % is an error that rises by 1 %.
_NOTHING_LOST = 0.02


class Observed(NamedTuple):
    """States of an arm that a model keeps, and how the outputs follow from these.

    Attributes
    ----------
    kept : ndarray of int, (kept,)
        Places of the states.
    C : ndarray, (outputs, kept)
        Output matrix.
    """

    kept: NDArray[np.intp]
    C: FloatArray


def observed(problem: SimulationError, best: Minimum) -> Observed:
    """Return the states without those of filters that can be left out.

    Parameters
    ----------
    problem : SimulationError
        Simulation error.
    best : Minimum
        Its minimum.
    """
    arm, states = problem.arm, problem.states(best.theta)
    C, settled = arm.output_matrix.copy(), _settled(arm, best.theta)
    kept = np.ones(arm.states, dtype=np.bool_)
    allowance = _NOTHING_LOST * best.cost
    for number, output in enumerate(arm.elastic):
        before, after = (
            _missed(problem, states, output, row) for row in (C[output], settled[number])
        )
        if after - before <= allowance:
            C[output] = settled[number]
            kept[arm.filter_states(number)] = False
    places = np.flatnonzero(kept)
    return Observed(places, C[:, places])


def _settled(arm: FlexibleArm, theta: FloatArray) -> FloatArray:
    """Return the filtered outputs from the motion alone, (filtered outputs, states)."""
    rows = np.zeros((len(arm.elastic), arm.states))
    rows[:, : arm.motions] = arm.settled(theta)[::2]
    return rows


def _missed(
    problem: SimulationError, states: list[FloatArray], output: int, row: FloatArray
) -> float:
    """Return the weighted squared error of an output that is a row times the states."""
    return sum(
        float(np.sum((part.weight[:, output] * (x @ row - part.y[:, output])) ** 2))
        for part, x in zip(problem.parts, states, strict=True)
    )
