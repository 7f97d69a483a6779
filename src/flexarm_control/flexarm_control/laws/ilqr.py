"""Integral control plus linear quadratic regulator from the position alone (section 4.4).

The structure of Figure 4-13: an observer estimates the states of a model from the position, the
regulator (4-9) feeds them back, and an integral of the error takes out a constant disturbance::

    u = R_f - K_C x,    R_f = K_P R + K_I sum (R - y1)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, limited
from flexarm_control.models.arm_model import POSITION, check_arm_model, check_no_feedthrough
from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.errors import SettingError
from flexarm_core.specs import Bounded, limits

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray

PLAUSIBLE_V = 100.0
"""Ten times the range of the converter: what is beyond is no measurement."""


@dataclass(frozen=True)
class RegulatorWeights(Bounded):
    """Weights of the design of a regulator.

    The thesis weighs the states of its own realisation, which is not printed; here the outputs are
    weighed, which any realisation has. The defaults are chosen by trial on the simulated rig.

    Attributes
    ----------
    position, strain, speed
        Weights of the outputs in Q of (4-9), per V^2; both gauges have the same.
    effort
        R of (4-9), per V^2.
    ki
        K_I of Figure 4-13, per sample.
    """

    position: float = field(
        default=1.0, metadata=limits(1e-3, 1e3, "1/V^2", "weight of the position")
    )
    strain: float = field(default=0.3, metadata=limits(0.0, 1e3, "1/V^2", "weight of the gauges"))
    speed: float = field(default=20.0, metadata=limits(0.0, 1e3, "1/V^2", "weight of the speed"))
    effort: float = field(default=0.6, metadata=limits(1e-3, 1e3, "1/V^2", "weight of the effort"))
    ki: float = field(
        default=0.0005, metadata=limits(0.0, 1.0, "", "gain on the sum of the errors")
    )


@dataclass(frozen=True)
class IlqrWeights(RegulatorWeights):
    """Weights of the design of Figure 4-13.

    Attributes
    ----------
    position, strain, speed, effort, ki
        As in `RegulatorWeights`.
    observer_speed
        How many times faster than the regulator the observer has to be at least; the thesis has 2.
    """

    observer_speed: float = field(
        default=2.0, metadata=limits(1.0, 5.0, "", "how much faster than the regulator")
    )


@dataclass(frozen=True)
class IlqrDesign:
    """A state feedback with observer, reference gain and integral.

    Attributes
    ----------
    model
        The model that the observer runs.
    channels
        Outputs that the observer corrects by.
    kc
        State feedback, shape (states,).
    observer
        Observer gain L, shape (states, channels).
    kp
        Gain of the reference: one over the steady state of the position with K_P = 1.
    ki
        Gain on the sum of the errors, per sample.
    regulator_radius, observer_radius
        Largest magnitude of the eigenvalues of A - B K_C and of A - L C.
    """

    model: control.StateSpace
    channels: tuple[int, ...]
    kc: FloatArray
    observer: FloatArray
    kp: float
    ki: float
    regulator_radius: float
    observer_radius: float


def design_ilqr(model: control.StateSpace, weights: IlqrWeights | None = None) -> IlqrDesign:
    """Design regulator, observer and reference gain, items 1 to 4 of section 4.4.

    The observer is the regulator of the dual system with Q = I and R = 1, as in the thesis, for
    the model sped up by the prescribed degree of stability of Anderson and Moore [1]_. That holds
    every one of its eigenvalues within a circle: what the regulator takes a time for, the observer
    has done in that time over `observer_speed`.

    Parameters
    ----------
    model
        Model of the arm with D = 0, its position observable.
    weights
        Weights of the design.

    Returns
    -------
    IlqrDesign
        The controller.

    Raises
    ------
    SettingError
        When the model cannot be used.

    References
    ----------
    .. [1] Anderson, B. D. O., and Moore, J. B. (1990). Optimal Control: Linear Quadratic Methods.
       Prentice Hall. Section 3.5.
    """
    weights = weights if weights is not None else IlqrWeights()
    kc, kp = design_regulator(model, weights)
    regulator_radius = radius(model.A - model.B @ kc[None])
    order, position = model.nstates, model.C[[POSITION]]
    speed_up = regulator_radius**-weights.observer_speed
    dual = quadratic_gain(speed_up * model.A.T, position.T, np.eye(order), np.eye(1))
    observer = dual.T / speed_up
    return IlqrDesign(
        model=model,
        channels=(POSITION,),
        kc=kc,
        observer=observer,
        kp=kp,
        ki=weights.ki,
        regulator_radius=regulator_radius,
        observer_radius=radius(model.A - observer @ position),
    )


def design_regulator(
    model: control.StateSpace, weights: RegulatorWeights
) -> tuple[FloatArray, float]:
    """Design state feedback (4-9) and reference gain, items 1 and 3 of section 4.4.

    Parameters
    ----------
    model
        Model of the arm with D = 0.
    weights
        Weights of the design.

    Returns
    -------
    kc : ndarray, shape (states,)
        State feedback K_C.
    kp : float
        Gain of the reference K_P.

    Raises
    ------
    SettingError
        When the model or the weights cannot be used.
    """
    check_arm_model(model)
    check_no_feedthrough(model)
    a, b, c = model.A, model.B, model.C
    per_output = (weights.position, weights.strain, weights.strain, weights.speed)
    weighted = np.sqrt(per_output)[:, None] * c
    kc = quadratic_gain(a, b, weighted.T @ weighted, np.array([[weights.effort]]))
    steady = c[[POSITION]] @ np.linalg.solve(np.eye(len(a)) - a + b @ kc, b)
    return kc.ravel(), 1.0 / float(steady[0, 0])


class Ilqr:
    """The controller of Figure 4-13, one sample at a time.

    The observer starts at rest where the arm stands. It is told the effort after saturation, and
    the sum of the errors stands still while the drive is saturated, so neither winds up. A
    measurement beyond 100 V is none: it is answered with zero and not taken in.

    Parameters
    ----------
    design
        The controller's gains.
    """

    def __init__(self, design: IlqrDesign) -> None:
        model, measured = design.model, list(design.channels)
        self._design = design
        a = model.A - design.observer @ model.C[measured]
        # The next state in one product with what is known: state, effort and measured outputs.
        self._move = np.ascontiguousarray(np.hstack([a, model.B, design.observer]))
        self._at_rest = _at_rest(model)
        self._order = len(a)
        self._known = np.zeros(self._move.shape[1])
        self._state = self._known[: self._order]
        self._next = np.zeros(self._order)
        self._started = False
        self._integral_v = 0.0

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        design, known = self._design, self._known
        for place, channel in enumerate(design.channels, self._order + 1):
            if not -PLAUSIBLE_V < volts[channel] < PLAUSIBLE_V:
                return NO_EFFORT
            known[place] = volts[channel]
        if not -PLAUSIBLE_V < reference_v < PLAUSIBLE_V:
            return NO_EFFORT
        if not self._started:
            np.multiply(self._at_rest, volts[POSITION], out=self._state)
            self._started = True
        error_v = reference_v - volts[POSITION]
        integral_v = self._integral_v + error_v
        feedback_v = float(np.dot(design.kc, self._state))
        effort_v = design.kp * reference_v + design.ki * integral_v - feedback_v
        answer = limited(effort_v)
        if -MAX_COMMAND_V <= effort_v <= MAX_COMMAND_V or effort_v * error_v < 0.0:
            self._integral_v = integral_v
        known[self._order] = answer.effort_v
        np.dot(self._move, known, out=self._next)
        self._state[:] = self._next
        return answer

    def reset(self) -> None:
        """Forget the past: an arm at rest, somewhere."""
        self._started = False
        self._integral_v = 0.0


def quadratic_gain(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    """Gain that minimises (4-9), shape (inputs, states).

    Raises
    ------
    SettingError
        When the Riccati equation has no stabilising solution.
    """
    from control import dlqr  # noqa: PLC0415 - it loads matplotlib

    try:
        return np.asarray(dlqr(A, B, Q, R)[0])
    except (np.linalg.LinAlgError, ValueError) as error:
        raise SettingError(
            f"no regulator or observer for this model and these weights ({error}); weigh the "
            "position more or the effort less, or identify the model again"
        ) from error


def radius(a: FloatArray) -> float:
    """Largest magnitude of the eigenvalues of a matrix."""
    return float(np.max(np.abs(np.linalg.eigvals(a))))


def _at_rest(model: control.StateSpace) -> FloatArray:
    """State in which a constant input holds the position at 1 V, shape (states,)."""
    # With the input as a further unknown: a model with an integrator needs none.
    stands = np.hstack([np.eye(model.nstates) - model.A, -model.B])
    there = np.append(model.C[POSITION], 0.0)
    wanted = np.append(np.zeros(model.nstates), 1.0)
    rest: FloatArray = np.linalg.lstsq(np.vstack([stands, there]), wanted, rcond=None)[0][:-1]
    return rest
