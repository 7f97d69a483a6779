"""Integral control plus linear quadratic regulator from the position alone (section 4.4).

The structure of Figure 4-13: an observer estimates the states of a model from the position, the
regulator (4-9) feeds them back, and an integral of the error takes out a constant disturbance::

    u = R_f - K_C x,    R_f = K_P R + K_I sum (R - y1)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING

import control
import numpy as np

from flexarm_control.arm_model import POSITION, check_arm_model, check_no_feedthrough
from flexarm_control.law import NO_EFFORT, Effort
from flexarm_control.parameters import Bounded, limits

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.arrays import FloatArray

SATURATION_V = 10.0
"""Largest command of the drive (Figure 2-2)."""


@dataclass(frozen=True)
class IlqrWeights(Bounded):
    """What the design weighs.

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
    strain: float = field(default=0.05, metadata=limits(0.0, 1e3, "1/V^2", "weight of the gauges"))
    speed: float = field(default=2.0, metadata=limits(0.0, 1e3, "1/V^2", "weight of the speed"))
    effort: float = field(default=0.5, metadata=limits(1e-3, 1e3, "1/V^2", "weight of the effort"))
    ki: float = field(
        default=0.0015, metadata=limits(0.0, 1.0, "", "gain on the sum of the errors")
    )


@dataclass(frozen=True)
class IlqrDesign:
    """An ILQR controller.

    Attributes
    ----------
    model
        The model that the observer runs.
    kc
        State feedback, shape (states,).
    observer
        Observer gain L, shape (states,).
    kp
        Gain of the reference: one over the steady state of the position with K_P = 1.
    ki
        Gain on the sum of the errors, per sample.
    regulator_radius, observer_radius
        Largest magnitude of the eigenvalues of A - B K_C and of A - L C_1. An identified model may
        have a slow pole that the position hardly shows; the observer keeps it, and only there it
        is slower than the regulator.
    """

    model: control.StateSpace
    kc: FloatArray
    observer: FloatArray
    kp: float
    ki: float
    regulator_radius: float
    observer_radius: float


def design_ilqr(model: control.StateSpace, weights: IlqrWeights | None = None) -> IlqrDesign:
    """Design regulator, observer and reference gain, items 1 to 4 of section 4.4.

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
    ControlError
        When the model cannot be used.
    """
    check_arm_model(model)
    check_no_feedthrough(model)
    weights = weights if weights is not None else IlqrWeights()
    a, b, c = model.A, model.B, model.C
    per_output = (weights.position, weights.strain, weights.strain, weights.speed)
    weighted = np.sqrt(per_output)[:, None] * c
    kc = control.dlqr(a, b, weighted.T @ weighted, np.array([[weights.effort]]))[0]
    regulator_radius = _radius(a - b @ kc)
    observer = control.dlqr(a.T, c[[POSITION]].T, np.eye(len(a)), np.eye(1))[0].T
    steady = c[[POSITION]] @ np.linalg.solve(np.eye(len(a)) - a + b @ kc, b)
    return IlqrDesign(
        model=model,
        kc=np.asarray(kc).ravel(),
        observer=np.asarray(observer).ravel(),
        kp=1.0 / float(steady[0, 0]),
        ki=weights.ki,
        regulator_radius=regulator_radius,
        observer_radius=_radius(a - observer @ c[[POSITION]]),
    )


class Ilqr:
    """The controller of Figure 4-13, one sample at a time.

    The observer is told the effort after saturation, and the sum of the errors stands still while
    the drive is saturated, so neither winds up.

    Parameters
    ----------
    design
        The controller's gains.
    """

    def __init__(self, design: IlqrDesign) -> None:
        self._design = design
        self._a = design.model.A - np.outer(design.observer, design.model.C[POSITION])
        self._b = design.model.B[:, 0]
        self._state = np.zeros(len(self._b))
        self._integral_v = 0.0

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.law.Law.step`."""
        design, position_v = self._design, volts[0]
        error_v = reference_v - position_v
        if not isfinite(error_v):
            return NO_EFFORT
        integral_v = self._integral_v + error_v
        effort_v = design.kp * reference_v + design.ki * integral_v - float(design.kc @ self._state)
        if not isfinite(effort_v):
            return NO_EFFORT
        limited_v = min(max(effort_v, -SATURATION_V), SATURATION_V)
        if limited_v == effort_v or effort_v * error_v < 0.0:
            self._integral_v = integral_v
        self._state = self._a @ self._state + self._b * limited_v + design.observer * position_v
        return Effort(effort_v, 0.0)

    def reset(self) -> None:
        """Forget the past: an arm at rest at zero."""
        self._state = np.zeros(len(self._b))
        self._integral_v = 0.0


def _radius(a: FloatArray) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(a))))
