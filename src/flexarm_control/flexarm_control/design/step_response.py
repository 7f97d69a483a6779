"""Unit step responses of the linear closed loops, fast enough for an optimiser."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.models.arm_model import POSITION

if TYPE_CHECKING:
    import control

    from flexarm_control.laws.gains import PdpGains, PiGains
    from flexarm_core.arrays import FloatArray


def pdp_step_response(model: control.StateSpace, gains: PdpGains, samples: int) -> FloatArray:
    """Simulate the PDP loop (4-7) after a step of the reference from 0 to 1 V.

    Parameters
    ----------
    model : control.StateSpace
        Model of the arm with D = 0.
    gains : PdpGains
        Gains of the PDP law.
    samples : int
        Number of samples, the first at the step.

    Returns
    -------
    ndarray, (samples, 4)
        Position, base strain, middle strain and speed, V.
    """
    feedback = np.array([[gains.kp, 0.0, gains.ksg, gains.kd]])
    closed = model.A - model.B @ feedback @ model.C
    return constant_input_response(closed, gains.kp * model.B, model.C, samples)


def pi_step_response(model: control.StateSpace, gains: PiGains, samples: int) -> FloatArray:
    """Simulate the PI loop of Figure 4-1 after a step of the reference from 0 to 1 V.

    The effort is kp e(k) + ki dt (e(0) + ... + e(k)); arguments and result are as for
    `pdp_step_response`.
    """
    position = model.C[[POSITION]]
    integral_gain = gains.ki * model.dt
    error_gain = gains.kp + integral_gain
    # The extra state is the sum of the errors before this sample.
    closed = np.block(
        [[model.A - error_gain * model.B @ position, integral_gain * model.B], [-position, 1.0]]
    )
    outputs = np.hstack([model.C, np.zeros((len(model.C), 1))])
    return constant_input_response(
        closed, np.vstack([error_gain * model.B, [[1.0]]]), outputs, samples
    )


def constant_input_response(
    A: FloatArray, b: FloatArray, C: FloatArray, samples: int
) -> FloatArray:
    """Return the response from rest to a constant input of 1, (samples, outputs).

    A is (states, states), b (states, 1) and C (outputs, states). Each pass doubles the length, and
    python-control's `forced_response` takes 40 times as long for the 1050 samples of a criterion.
    """
    order = len(A)
    power = np.block([[A, b], [np.zeros((1, order)), 1.0]])
    states = np.zeros((order + 1, 1))
    states[-1] = 1.0
    while states.shape[1] < samples:
        states = np.hstack([states, power @ states])
        power = power @ power
    response: FloatArray = (C @ states[:-1, :samples]).T
    return response
