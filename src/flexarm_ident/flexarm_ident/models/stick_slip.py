"""Linear models with dry friction at their inputs, stepped in time by compiled code.

Friction opposes the speed of the coordinate that its input drives. It is taken implicitly: over a
step it is the force that stops the motion, limited to the friction level. A drive below its level
therefore stands still without creep or chatter, and the step is piecewise smooth, which gives exact
derivatives. Moreau, "Unilateral contact and dry friction in finite freedom dynamics" (1988).

The level of an input is that of Coulomb, higher near standstill after Stribeck, and higher under
load. It is taken from the speed v at the beginning of the step and the size of the input u over it:

    level = coulomb + rise exp(-(v / stribeck_speed)^2) + load |u|

Armstrong-Hélouvry, Dupont, Canudas de Wit, "A survey of models, analysis tools and compensation
methods for the control of machines with friction", Automatica 30 (1994).

The functions check nothing; `dry_friction` and `refinement` use them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.compilation import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray

_SWEEPS = 50
_SETTLED = 1e-12
# Samples whose products with derivatives fit into a core's own cache.
_TOGETHER = 32


@compiled
def friction_force(free_speed: FloatArray, gain: FloatArray, levels: FloatArray) -> FloatArray:
    """Return the friction of one step, (inputs,), to be subtracted from the inputs.

    Parameters
    ----------
    free_speed : ndarray, (inputs,)
        Speeds after the step without friction.
    gain : ndarray, (inputs, inputs)
        Speeds that unit forces give over the step.
    levels : ndarray, (inputs,)
        Coulomb friction levels in units of the input; 0 without friction.
    """
    force = np.zeros(len(levels))
    for _ in range(_SWEEPS):
        change = 0.0
        for i in range(len(levels)):
            if levels[i] <= 0.0 or gain[i, i] == 0.0:
                continue
            left = free_speed[i]
            for j in range(len(levels)):
                if j != i:
                    left -= gain[i, j] * force[j]
            wanted = min(max(left / gain[i, i], -levels[i]), levels[i])
            change = max(change, abs(wanted - force[i]))
            force[i] = wanted
        if change <= _SETTLED:
            break
    return force


@compiled
def friction_levels(laws: FloatArray, speeds: FloatArray, sizes: FloatArray) -> FloatArray:
    """Return the friction level of each input, (inputs,).

    Parameters
    ----------
    laws : ndarray, (inputs, 4)
        Coulomb level, rise at standstill, speed over which it fades, and part of the input's size.
    speeds, sizes : ndarray, (inputs,)
        Speeds that friction opposes, and sizes of the inputs.
    """
    levels = np.empty(len(laws))
    for i in range(len(laws)):
        fading = np.exp(-((speeds[i] / laws[i, 2]) ** 2)) if laws[i, 1] > 0.0 else 0.0
        levels[i] = laws[i, 0] + laws[i, 1] * fading + laws[i, 3] * sizes[i]
    return levels


@compiled
def friction_level_derivatives(
    laws: FloatArray,
    speeds: FloatArray,
    sizes: FloatArray,
    d_laws: FloatArray,
    d_speeds: FloatArray,
) -> FloatArray:
    """Return the derivatives of `friction_levels`, (inputs, parameters).

    Parameters
    ----------
    laws, speeds, sizes
        As in `friction_levels`.
    d_laws : ndarray, (inputs, 4, parameters)
        Derivatives of the laws.
    d_speeds : ndarray, (inputs, parameters)
        Derivatives of the speeds.
    """
    derivatives = np.empty(d_speeds.shape)
    for i in range(len(laws)):
        derivatives[i] = d_laws[i, 0] + sizes[i] * d_laws[i, 3]
        if laws[i, 1] > 0.0:
            part = speeds[i] / laws[i, 2]
            fading = np.exp(-(part**2))
            steep = 2.0 * laws[i, 1] * fading * part / laws[i, 2]
            derivatives[i] += fading * d_laws[i, 1] + steep * (part * d_laws[i, 2] - d_speeds[i])
    return derivatives


@compiled
def run(  # noqa: PLR0917 (compiled code has no keyword arguments)
    A: FloatArray,
    B: FloatArray,
    speed: FloatArray,
    laws: FloatArray,
    holds: FloatArray,
    u: FloatArray,
    sizes: FloatArray,
    x0: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Step a model through a record.

    Parameters
    ----------
    A, B : ndarray
        Discrete model.
    speed : ndarray, (inputs, states)
        Map from the state to the speed that the friction of each input opposes.
    laws : ndarray, (inputs, 4)
        Friction as `friction_levels` takes it; zeros without friction.
    holds : ndarray, (inputs, 2)
        How friction yields below its level: the part of the speed that a step leaves, and the part
        by which the force that takes the rest is smaller. Zeros where it holds still.
    u, sizes : ndarray, (samples, inputs)
        Inputs from each sample to the next, and their sizes for the friction.
    x0 : ndarray, (states,)
        Initial state.

    Returns
    -------
    ndarray, (samples, states)
        States.
    ndarray, (samples, inputs)
        Friction from each sample to the next.
    """
    samples, states, inputs = len(u), len(A), B.shape[1]
    x = np.empty((samples, states))
    forces = np.empty((samples, inputs))
    gain = speed @ B
    for i in range(inputs):
        gain[i, i] *= 1.0 + holds[i, 1]
    now = x0.copy()
    speeds, free_speed = np.empty(inputs), np.empty(inputs)
    after = np.empty(states)
    for k in range(samples):
        x[k] = now
        for i in range(states):
            total = 0.0
            for j in range(states):
                total += A[i, j] * now[j]
            for j in range(inputs):
                total += B[i, j] * u[k, j]
            after[i] = total
        for i in range(inputs):
            speeds[i] = free_speed[i] = 0.0
            for j in range(states):
                speeds[i] += speed[i, j] * now[j]
                free_speed[i] += speed[i, j] * after[j]
            free_speed[i] -= holds[i, 0] * speeds[i]
        forces[k] = friction_force(free_speed, gain, friction_levels(laws, speeds, sizes[k]))
        for i in range(states):
            total = after[i]
            for j in range(inputs):
                total -= B[i, j] * forces[k, j]
            now[i] = total
    return x, forces


@compiled
def force_derivative(  # noqa: PLR0917 (compiled code has no keyword arguments)
    ahead: FloatArray,
    gain: FloatArray,
    inverse: FloatArray,
    force: FloatArray,
    levels: FloatArray,
    d_levels: FloatArray,
) -> FloatArray:
    """Return the derivative of `friction_force`, (inputs, parameters).

    Parameters
    ----------
    ahead : ndarray, (inputs, parameters)
        Derivative of the speeds after the step, with the friction held.
    gain, inverse : ndarray, (inputs, inputs)
        Speeds that unit forces give over the step, and the inverse of this.
    force, levels : ndarray, (inputs,)
        The step's friction and its levels.
    d_levels : ndarray, (inputs, parameters)
        Derivative of the levels.
    """
    inputs, parameters = ahead.shape
    derivative = np.zeros((inputs, parameters))
    held = np.zeros(inputs, dtype=np.bool_)
    for i in range(inputs):
        held[i] = abs(force[i]) < levels[i]
        if not held[i] and levels[i] > 0.0:
            derivative[i] = np.sign(force[i]) * d_levels[i]
    if not held.any():
        return derivative
    # Drives that stick keep their speed zero, whatever the others do.
    if held.all():
        return product(inverse, ahead)
    matrix = np.eye(inputs)
    right = derivative.copy()
    for i in range(inputs):
        if held[i]:
            matrix[i] = gain[i]
            right[i] = ahead[i]
    right[:] = np.linalg.solve(matrix, right)
    return right


@compiled
def run_sensitivity(  # noqa: PLR0917 (compiled code has no keyword arguments)
    A: FloatArray,
    B: FloatArray,
    speed: FloatArray,
    laws: FloatArray,
    u: FloatArray,
    sizes: FloatArray,
    x0: FloatArray,
    d_A: FloatArray,
    d_B: FloatArray,
    d_laws: FloatArray,
    d_u: FloatArray,
    d_x0: FloatArray,
    wanted: NDArray[np.intp],
) -> tuple[FloatArray, FloatArray]:
    """Step a model and the derivatives of its states with respect to parameters.

    Parameters
    ----------
    A, B, speed, laws, u, sizes, x0
        As in `run`; `speed` does not depend on the parameters.
    d_A : ndarray, (states, states, first parameters)
        Derivative of A, which only the first of all parameters change.
    d_B : ndarray, (states, inputs, first parameters)
        Derivative of B.
    d_laws : ndarray, (inputs, 4, parameters)
        Derivatives of the friction.
    d_u : ndarray, (inputs, parameters)
        Derivative of a constant part of the inputs.
    d_x0 : ndarray, (states, parameters)
        Derivative of the initial state.
    wanted : ndarray of int, (wanted states,)
        States whose derivatives are wanted.

    Returns
    -------
    ndarray, (samples, states)
        States.
    ndarray, (samples, wanted states, parameters)
        Derivatives of those that are wanted.

    Raises
    ------
    LinAlgError
        If forces together give no speeds of their own.
    """
    samples, states, inputs = len(u), len(A), B.shape[1]
    parameters, first = d_x0.shape[1], d_A.shape[2]
    x, forces = run(A, B, speed, laws, np.zeros((inputs, 2)), u, sizes, x0)
    gain, steady = speed @ B, product(B, d_u)
    inverse = np.zeros(gain.shape)
    if np.any(laws > 0.0):
        inverse[:] = np.linalg.inv(gain)
    d_A_rows, d_B_rows = rows_of(d_A), rows_of(d_B)
    d_x = np.empty((samples, len(wanted), parameters))
    now, ahead = d_x0.copy(), np.empty((states, parameters))
    for start in range(0, samples, _TOGETHER):
        rows = slice(start, min(start + _TOGETHER, samples))
        # What A and B themselves change, of many samples at once.
        direct = np.dot(x[rows], d_A_rows) + np.dot(u[rows] - forces[rows], d_B_rows)
        for k in range(rows.start, rows.stop):
            for i in range(len(wanted)):
                d_x[k, i] = now[wanted[i]]
            ahead[:] = steady
            for i in range(states):
                for p in range(first):
                    ahead[i, p] += direct[k - start, i * first + p]
            add_product(ahead, A, now, 1.0)
            speeds = np.zeros(inputs)
            for i in range(inputs):
                for j in range(states):
                    speeds[i] += speed[i, j] * x[k, j]
            levels = friction_levels(laws, speeds, sizes[k])
            d_levels = friction_level_derivatives(
                laws, speeds, sizes[k], d_laws, product(speed, now)
            )
            d_force = force_derivative(
                product(speed, ahead), gain, inverse, forces[k], levels, d_levels
            )
            now[:] = ahead
            add_product(now, B, d_force, -1.0)
    return x, d_x


@compiled
def rows_of(derivative: FloatArray) -> FloatArray:
    """Return the derivative of a matrix, (rows, columns, parameters), as (columns, rows * ...)."""
    rows, columns, parameters = derivative.shape
    turned = np.empty((columns, rows, parameters))
    for i in range(rows):
        turned[:, i] = derivative[i]
    return turned.reshape(columns, rows * parameters)


@compiled
def product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the product of two small matrices, of any layout."""
    result = np.zeros((left.shape[0], right.shape[1]))
    add_product(result, left, right, 1.0)
    return result


@compiled
def add_product(total: FloatArray, left: FloatArray, right: FloatArray, factor: float) -> None:
    """Add a multiple of the product of two small matrices, of which the left one has zeros."""
    for i in range(left.shape[0]):
        for j in range(left.shape[1]):
            entry = factor * left[i, j]
            if entry != 0.0:
                for p in range(right.shape[1]):
                    total[i, p] += entry * right[j, p]
