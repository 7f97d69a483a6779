"""Soft limit on the base gauge: the effort is corrected when a peak beyond the limit is predicted.

The loop of state feedback and model predicts the gauge. Half of what the gauge measures beyond the
model counts, as a constant: friction that turns round bends the arm more than the model knows. The
cost of a correction is that of the regulator: about its optimum it is the square alone, times
R + B' P B at every sample [1]_. So only the ratio of that weight to the one of the slack matters,
and no prediction beyond the limit means no correction.

A correction lessens the effort, to zero at most, and never enlarges it. One that may reverse it is
a feedback of the gauge with a high gain, and the modes that the model knows badly swing in that
loop for ever, from stop to stop of the drive.

References
----------
.. [1] Kouvaritakis, B., Rossiter, J. A., and Schuurmans, J. (2000). Efficient robust predictive
   control. IEEE Transactions on Automatic Control 45(8), 1545-1549.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.models.arm_model import BASE_STRAIN
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    import control

    from flexarm_core.arrays import FloatArray

_HELD = 2
"""Samples of one correction; longer ones would excite the higher modes."""
_CORRECTIONS = 10
"""Corrections of a prediction: 67 ms at 300 Hz, half a period of bending."""
_SLACK = 100.0
"""Weight of the slack over that of a correction; both are squares of V."""
_PREDICTED = 0.6
"""Part of the limit that a prediction may reach; friction and gap take the rest by surprise."""
_COUNTED = 0.5
"""Part of the gauge beyond the model that counts; all of it makes a loop that may swing."""
MOST_STEPS = 12
"""Steps of Newton's method that a sample may take; the usual number is two to four."""
_MOST_HALVINGS = 8


@dataclass(frozen=True)
class StrainLimit(Bounded):
    """Limit on the peak of the base gauge."""

    strain_limit_v: float = setting(
        0.0, 0.0, 20.0, "V", "soft limit on the base gauge's peak, 0 for none"
    )


class StrainLimiter:
    """Correction of the effort of one state feedback.

    Parameters
    ----------
    model : control.StateSpace
        Model that predicts.
    kc : ndarray, (states,)
        State feedback K_C.
    kp : float
        Gain of the reference.
    limit_v : float
        Limit on the magnitude of the base gauge, V, positive.
    """

    def __init__(
        self, model: control.StateSpace, kc: FloatArray, kp: float, limit_v: float
    ) -> None:
        self._bound_v = _PREDICTED * limit_v
        self._from_state, self._from_reference, self.moves = predictions(model, kc, kp)
        self._gauge = np.array(model.C[BASE_STRAIN])
        self._weights = np.full(_CORRECTIONS, float(_HELD))

    def limited_v(
        self, effort_v: float, state: FloatArray, base_v: float, reference_v: float
    ) -> float:
        """Return the effort of this sample with its correction, between zero and the effort, V.

        Parameters
        ----------
        effort_v : float
            Effort of the state feedback, V.
        state : ndarray, (states,)
            State of the observer before the sample.
        base_v : float
            Base gauge, V.
        reference_v : float
            Reference, V; it counts as constant.
        """
        unknown_v = _COUNTED * (base_v - self._gauge @ state)
        free_v = self._from_state @ state + self._from_reference * reference_v + unknown_v
        if np.abs(free_v).max() <= self._bound_v:
            return effort_v
        correction = least_correction(self._weights, _SLACK, self.moves, free_v, self._bound_v)
        lowest_v, highest_v = min(0.0, effort_v), max(0.0, effort_v)
        return min(max(effort_v + float(correction[0]), lowest_v), highest_v)


def predictions(
    model: control.StateSpace, kc: FloatArray, kp: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what state, reference and corrections make of the gauge at the samples ahead.

    The parameters are those of `StrainLimiter`.

    Returns
    -------
    from_state : ndarray, (samples, states)
        Gauge per state.
    from_reference : ndarray, (samples,)
        Gauge per reference, V/V.
    from_corrections : ndarray, (samples, corrections)
        Gauge per correction, V/V.
    """
    samples = _HELD * _CORRECTIONS
    b, gauge = np.asarray(model.B)[:, 0], np.asarray(model.C)[BASE_STRAIN]
    loop = np.asarray(model.A) - np.outer(b, kc)
    rows = [gauge @ loop]
    for _ in range(samples - 1):
        rows.append(rows[-1] @ loop)
    # The response to an effort of one sample, then its sums over the corrections.
    impulse = np.array([gauge @ b, *(row @ b for row in rows[:-1])])
    step = np.concatenate([[0.0], np.cumsum(impulse)])
    ahead = np.arange(1, samples + 1)
    moves = [
        step[np.maximum(ahead - start, 0)] - step[np.maximum(ahead - start - _HELD, 0)]
        for start in range(0, samples, _HELD)
    ]
    return np.array(rows), kp * step[1:], np.column_stack(moves)


def least_correction(
    weights: FloatArray, slack: float, moves: FloatArray, free: FloatArray, bound: float
) -> FloatArray:
    """Return the correction v, (m,); after `MOST_STEPS`, what is best so far.

    A correction v of m parts moves predicted values f to f + G v. What is left beyond the bound
    costs as the square, so there is always a solution::

        min  1/2 v' D v + s/2 sum max(0, |f + G v| - bound)^2

    The cost is strictly convex, and quadratic between the places where a value passes the bound.
    Newton's method with a line search ends at the minimum after finitely many steps: each step
    solves the problem of the values that are beyond the bound, m equations.

    Li and Swetits, "A new algorithm for solving strictly convex quadratic programs", SIAM Journal
    on Optimization 7(3), 595-619 (1997).

    Parameters
    ----------
    weights : ndarray, (m,)
        Weights of the squares of the parts: the diagonal of D, positive.
    slack : float
        Weight s of the squares of what is beyond the bound, positive.
    moves : ndarray, (values, m)
        G.
    free : ndarray, (values,)
        Predicted values without a correction, f.
    bound : float
        Largest magnitude of a value, positive.
    """
    v = np.zeros(len(weights))
    beyond = free - np.clip(free, -bound, bound)
    cost = 0.5 * slack * float(beyond @ beyond)
    active = beyond != 0.0
    for _ in range(MOST_STEPS):
        if not active.any():
            break
        bent = moves[active]
        gradient = weights * v + slack * (beyond[active] @ bent)
        way = -np.linalg.solve(np.diag(weights) + slack * (bent.T @ bent), gradient)
        slope = float(gradient @ way)
        share = 1.0
        for _ in range(_MOST_HALVINGS):
            tried = v + share * way
            values = free + moves @ tried
            left = values - np.clip(values, -bound, bound)
            found = 0.5 * float(tried @ (weights * tried)) + 0.5 * slack * float(left @ left)
            if found <= cost + 1e-4 * share * slope:
                break
            share *= 0.5
        else:
            break
        v, beyond, cost = tried, left, found
        before, active = active, beyond != 0.0
        # The step was exact if no value passed the bound in it.
        if share == 1.0 and np.array_equal(before, active):
            break
    return v
