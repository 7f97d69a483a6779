"""Compiled steps of a model in modal form with yielding dry friction, guided by its outputs.

A steady Kalman gain corrects the state by what the prediction misses, so that errors of a first
model do not add up over a record. With a gain of zero the steps are those of `stick_slip.run`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.compilation import compiled
from flexarm_ident.models.stick_slip import add_product, friction_force

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, FloatArray


@compiled
def guided_steps(  # noqa: C901, PLR0912, PLR0915, PLR0917 (compiled code of one loop)
    A: FloatArray,
    B: FloatArray,
    C: FloatArray,
    pair: NDArray[np.intp],
    rigid: BoolArray,
    gain: FloatArray,
    speed: FloatArray,
    law: FloatArray,
    u: FloatArray,
    y: FloatArray,
    now: FloatArray,
    slopes: FloatArray,
) -> FloatArray:
    """Step a model and its derivatives through some samples.

    The parameters stand in the order A by modes, B by rows, C by rows, initial state, and for the
    friction levels, rests, gives, offsets, and speeds by rows.

    Parameters
    ----------
    A, B, C : ndarray
        Model in real modal form.
    pair : ndarray of int, (states,)
        The other state of each pair, and the own number of a single state.
    rigid : ndarray of bool, (states,)
        States of pairs that are a position and its speed, in this order; the parameters in their
        places of A are a stiffness and a damping, see `guided_error`.
    gain : ndarray, (states, outputs)
        Correction of the state by the errors of the outputs.
    speed : ndarray, (inputs, states)
        Map from the state to the opposed speeds.
    law : ndarray, (3, inputs)
        Levels, rests and gives, see `dry_friction.Yielding`.
    u : ndarray, (samples, inputs)
        Inputs without offset.
    y : ndarray, (samples, outputs)
        Measured outputs.
    now : ndarray, (states,)
        State; that after the samples replaces it.
    slopes : ndarray, (states, parameters)
        Its derivatives, likewise; without columns none are computed.

    Returns
    -------
    ndarray, (samples, outputs, parameters + 1)
        Derivatives of the predicted outputs, and at last what the prediction misses.
    """
    (states, inputs), outputs, count = B.shape, len(C), slopes.shape[1]
    from_C = states + states * inputs
    from_law = from_C + outputs * states + states
    from_speed = from_law + 4 * inputs
    found = np.zeros((len(u), outputs, count + 1))
    own = speed @ B
    reach = own.copy()
    for i in range(inputs):
        reach[i, i] *= 1.0 + law[2, i]
    x, free = np.empty(states), np.empty(states)
    ahead, left = np.empty((states, count)), np.empty(inputs)
    d_force, matrix = np.zeros((inputs, count)), np.empty((inputs, inputs))
    for k in range(len(u)):
        for o in range(outputs):
            found[k, o, count] = y[k, o]
            for i in range(states):
                found[k, o, count] -= C[o, i] * now[i]
                for p in range(count):
                    found[k, o, p] += C[o, i] * slopes[i, p]
                if count:
                    found[k, o, from_C + o * states + i] += now[i]
        for i in range(states):
            x[i] = now[i]
            for o in range(outputs):
                if gain[i, o] != 0.0:
                    x[i] += gain[i, o] * found[k, o, count]
                    for p in range(count):
                        slopes[i, p] -= gain[i, o] * found[k, o, p]
        for i in range(states):
            other = pair[i]
            free[i] = A[i, i] * x[i]
            if other != i:
                free[i] += A[i, other] * x[other]
            for j in range(inputs):
                free[i] += B[i, j] * u[k, j]
            if not count:
                continue
            for p in range(count):
                ahead[i, p] = A[i, i] * slopes[i, p]
            if other != i:
                for p in range(count):
                    ahead[i, p] += A[i, other] * slopes[other, p]
            if rigid[i]:
                if other < i:
                    ahead[i, other] -= x[other]
                    ahead[i, i] += x[i]
            elif other >= i:
                ahead[i, i] += x[i]
                if other > i:
                    ahead[i, other] += x[other]
            else:
                ahead[i, other] += x[i]
                ahead[i, i] -= x[other]
            for j in range(inputs):
                ahead[i, states + i * inputs + j] += u[k, j]
                ahead[i, from_law + 3 * inputs + j] -= B[i, j]
        for i in range(inputs):
            left[i] = 0.0
            for j in range(states):
                left[i] += speed[i, j] * (free[j] - law[1, i] * x[j])
        force = friction_force(left, reach, law[0])
        if count:
            held = False
            for i in range(inputs):
                d_force[i] = 0.0
                for j in range(inputs):
                    matrix[i, j] = 1.0 if i == j else 0.0
                if abs(force[i]) >= law[0, i]:
                    d_force[i, from_law + i] = np.sign(left[i] / own[i, i])
                    continue
                held = True
                matrix[i] = reach[i]
                d_force[i, from_law + 2 * inputs + i] -= own[i, i] * force[i]
                for j in range(states):
                    # What the drive keeps of the speed of a state, and what the friction gives it.
                    kept = free[j] - law[1, i] * x[j]
                    for p in range(count):
                        d_force[i, p] += speed[i, j] * (ahead[j, p] - law[1, i] * slopes[j, p])
                    d_force[i, from_law + inputs + i] -= speed[i, j] * x[j]
                    for other in range(inputs):
                        part = force[other] * (1.0 + law[2, i] if other == i else 1.0)
                        kept -= B[j, other] * part
                        d_force[i, states + j * inputs + other] -= speed[i, j] * part
                    d_force[i, from_speed + i * states + j] += kept
            if held:
                d_force[:] = np.linalg.solve(matrix, d_force)
            slopes[:] = ahead
            add_product(slopes, B, d_force, -1.0)
            for i in range(states):
                for j in range(inputs):
                    slopes[i, states + i * inputs + j] -= force[j]
        for i in range(states):
            now[i] = free[i]
            for j in range(inputs):
                now[i] -= B[i, j] * force[j]
    return found
