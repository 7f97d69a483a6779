"""Integral control plus linear quadratic regulator from the position alone (section 4.4).

Figure 4-13 has the structure: an observer estimates the states of a model from the position. The
regulator (4-9) feeds them back, and an integral of the error removes a constant disturbance::

    u = R_f - K_C x,    R_f = K_P R + K_I sum (R - y1)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.gains import OptionalCompensation
from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, limited, winds_up
from flexarm_control.models.arm_model import (
    POSITION,
    SPEED,
    check_arm_model,
    check_no_feedthrough,
)
from flexarm_core.errors import SettingError
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_control.laws.law_protocol import Memory
    from flexarm_core.arrays import FloatArray

PLAUSIBLE_V = 100.0
"""Ten times the range of the converter; a larger reading is not a measurement."""
# Digits of a gain in which the kernels of all processors agree.
_COMMON_DIGITS = 9


@dataclass(frozen=True)
class RegulatorWeights(Bounded):
    """Weights of the design of a regulator: Q and R of (4-9).

    The thesis weighs the states of its own realisation, which is not printed. Here the outputs are
    weighed, which any realisation has, and the states of the model as it is given if asked for:
    Q = C^T diag(outputs) C + diag(states). The defaults were found by trial on the simulated rig.
    """

    position: float = setting(1.0, 0.0, 1e3, "1/V^2", "weight of the position")
    strain: float = setting(0.3, 0.0, 1e3, "1/V^2", "weight of the gauges")
    speed: float = setting(20.0, 0.0, 1e3, "1/V^2", "weight of the speed")
    states: tuple[float, ...] = setting(
        (0.0,), 0.0, 1e3, "", "weights of the states of the model: one for each, or one for all"
    )
    effort: float = setting(0.6, 1e-3, 1e3, "1/V^2", "weight of the effort")


@dataclass(frozen=True)
class IlqrWeights(RegulatorWeights):
    """Weights of the design of Figure 4-13 and its K_I; the thesis's observer is twice as fast."""

    ki: float = setting(0.0005, 0.0, 1.0, "", "gain on the sum of the errors")
    observer_speed: float = setting(
        2.0, 0.0, 5.0, "", "least speed ratio to the regulator, 0 for none"
    )


@dataclass(frozen=True)
class IlqrDesign:
    """State feedback with observer, reference gain and integral.

    Attributes
    ----------
    model : control.StateSpace
        Model of the observer.
    channels : tuple of int
        Outputs that correct the observer.
    kc : ndarray, (states,)
        State feedback K_C.
    observer : ndarray, (states, channels)
        Observer gain L.
    kp : float
        Gain of the reference: one over the steady state of the position with K_P = 1.
    ki : float
        Gain on the sum of the errors, per sample.
    regulator_radius, observer_radius : float
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

    The observer is the regulator of the dual system with Q = I and R = 1, as in the thesis. Its
    model is sped up by the prescribed degree of stability of Anderson and Moore [1]_, which bounds
    the magnitude of all its eigenvalues. The observer settles in the settling time of the regulator
    over `observer_speed`.

    Parameters
    ----------
    model : control.StateSpace
        Model of the arm with D = 0, its position observable.
    weights : IlqrWeights, optional
        Weights of the design.

    Returns
    -------
    IlqrDesign
        Gains of the controller.

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
    observer = rounded(dual.T / speed_up)
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
    model : control.StateSpace
        Model of the arm with D = 0.
    weights : RegulatorWeights
        Weights of the design.

    Returns
    -------
    kc : ndarray, (states,)
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
    q = weighted.T @ weighted + np.diag(_of_states(weights.states, len(a)))
    kc = quadratic_gain(a, b, q, np.array([[weights.effort]]))
    steady = c[[POSITION]] @ np.linalg.solve(np.eye(len(a)) - a + b @ kc, b)
    return kc.ravel(), float(rounded(1.0 / steady[0, 0]))


def _of_states(weights: Sequence[float], order: int) -> FloatArray:
    given = np.atleast_1d(np.asarray(weights, dtype=float))
    if given.size not in {1, order}:
        raise SettingError(
            f"states has {given.size} weights and the model {order} states: give one for each, or "
            "one for all"
        )
    return np.broadcast_to(given, order)


class Observer:
    """Observer of a design, one sample at a time.

    The products of a sample are summed in one order: the same samples give the same states on
    every machine.

    Parameters
    ----------
    design : IlqrDesign
        Gains of the controller.

    Attributes
    ----------
    state : ndarray, (states,)
        State before the sample.
    """

    def __init__(self, design: IlqrDesign) -> None:
        model, measured = design.model, list(design.channels)
        self._kc, self._kp = design.kc, design.kp
        a = model.A - np.einsum("ij,jk", design.observer, model.C[measured])
        # One product gives the next state from state, effort and measured outputs.
        self._move = np.ascontiguousarray(np.hstack([a, model.B, design.observer]))
        self._measured = tuple(enumerate(measured, len(a) + 1))
        self._at_rest = rounded(_at_rest(model))
        self._order = len(a)
        self._known = np.zeros(self._move.shape[1])
        self.state = self._known[: self._order]
        self._next = np.zeros(self._order)

    def begin(self, position_v: float) -> None:
        """Start at rest at a position, V."""
        np.multiply(self._at_rest, position_v, out=self.state)

    def effort_v(self, reference_v: float) -> float:
        """Return the effort of the state feedback K_P R - K_C x, V."""
        return self._kp * reference_v - float(np.einsum("i,i", self._kc, self.state))

    def correct(self, missing_v: float) -> None:
        """Take note that the last effort was another one by so much, V."""
        if missing_v:
            self.state += missing_v * self._move[:, self._order]

    def move(self, volts: Sequence[float], effort_v: float) -> None:
        """Go on to the next sample with the outputs and the effort of this one, V."""
        known = self._known
        for place, channel in self._measured:
            known[place] = volts[channel]
        known[self._order] = effort_v
        np.einsum("ij,j", self._move, known, out=self._next)
        self.state[:] = self._next


class Ilqr:
    """Controller of Figure 4-13, one sample at a time.

    The observer starts at rest at the position of the arm. Its input is the effort that is sent,
    and the sum of the errors is held while a limit cuts the effort, so neither winds up.
    A measurement beyond 100 V is a fault: the answer is zero and the states do not change.

    The gains have nine digits, and the observer sums in one order: the same samples give the same
    commands on every machine.

    A model from data without the compensation is that of an arm whose friction is compensated. So
    the law can compensate as well, as in (4-8), with the speed of the observer.

    Parameters
    ----------
    design : IlqrDesign
        Gains of the controller.
    compensation : OptionalCompensation, optional
        Level and thresholds of (4-8); none by default, as in the thesis.
    """

    def __init__(
        self, design: IlqrDesign, compensation: OptionalCompensation | None = None
    ) -> None:
        self._design = design
        self._compensation = compensation if compensation is not None else OptionalCompensation()
        self._speed = np.array(design.model.C[SPEED])
        self._observer = Observer(design)
        self._started = False
        self._integral_v = self._cut_v = 0.0

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        design, observer = self._design, self._observer
        for channel in design.channels:
            if not -PLAUSIBLE_V < volts[channel] < PLAUSIBLE_V:
                return NO_EFFORT
        if not -PLAUSIBLE_V < reference_v < PLAUSIBLE_V:
            return NO_EFFORT
        if not self._started:
            observer.begin(volts[POSITION])
            self._started = True
        error_v = reference_v - volts[POSITION]
        integral_v = self._integral_v + error_v
        feedback_v = float(np.einsum("i,i", design.kc, observer.state))
        effort_v = design.kp * reference_v + design.ki * integral_v - feedback_v
        answer = limited(effort_v, self._compensation_v(effort_v, error_v))
        if not winds_up(error_v, effort_v - answer.effort_v, self._cut_v):
            self._integral_v = integral_v
        observer.move(volts, answer.effort_v)
        return answer

    def hear(self, missing_v: float, cut_v: float) -> None:
        """Hear what became of the last effort; see `HearingLaw.hear`."""
        self._observer.correct(missing_v)
        self._cut_v = cut_v

    def _compensation_v(self, effort_v: float, error_v: float) -> float:
        """Return the compensation (4-8), V."""
        if not self._compensation.compensation_v:
            return 0.0
        speed_v = float(np.einsum("i,i", self._speed, self._observer.state))
        return self._compensation.command_v(effort_v, error_v, speed_v)

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._started = False
        self._integral_v = self._cut_v = 0.0

    def memory(self) -> Memory:
        """Return observer and sum of the errors; see `LawWithMemory.memory`."""
        return {
            "observer": self._observer.state.tolist(),
            "integral_v": (self._integral_v,),
            "started": (float(self._started),),
        }

    def remember(self, memory: Memory) -> None:
        """Go on from an observer and a sum of the errors; see `LawWithMemory.remember`."""
        self._observer.state[:] = memory["observer"]
        (self._integral_v,) = memory["integral_v"]
        self._started = bool(memory["started"][0])


def quadratic_gain(A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray) -> FloatArray:
    """Return the gain that minimises (4-9), (inputs, states).

    Raises
    ------
    SettingError
        When the Riccati equation has no stabilising solution.
    """
    # With the first design: it takes long to import.
    from flexarm_ident.models.control_library import control_library  # noqa: PLC0415

    try:
        gain = rounded(control_library().dlqr(A, B, Q, R)[0])
    except (np.linalg.LinAlgError, ValueError) as error:
        found = str(error)
    else:
        found = "it does not decay" if radius(A - B @ gain) >= 1.0 else ""
    if found:
        raise SettingError(
            f"no regulator or observer for this model and these weights ({found}); weigh the "
            "position more or the effort less, or identify the model again"
        )
    return gain


def radius(a: FloatArray) -> float:
    """Return the largest magnitude of the eigenvalues of a matrix."""
    return float(np.max(np.abs(np.linalg.eigvals(a))))


def rounded(gains: FloatArray | float) -> FloatArray:
    """Return gains to the `_COMMON_DIGITS` of the largest one."""
    largest = float(np.max(np.abs(gains)))
    digits = _COMMON_DIGITS - 1 - (math.floor(math.log10(largest)) if largest else 0)
    return np.round(gains, digits)


def _at_rest(model: control.StateSpace) -> FloatArray:
    """Return the state in which a constant input holds the position at 1 V, (states,)."""
    # The input is a further unknown, which is zero for a model with an integrator.
    stands = np.hstack([np.eye(model.nstates) - model.A, -model.B])
    there = np.append(model.C[POSITION], 0.0)
    wanted = np.append(np.zeros(model.nstates), 1.0)
    rest: FloatArray = np.linalg.lstsq(np.vstack([stands, there]), wanted, rcond=None)[0][:-1]
    return rest
