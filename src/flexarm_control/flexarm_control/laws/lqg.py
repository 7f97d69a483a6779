"""Linear quadratic Gaussian control from all four signals, as a baseline.

The regulator, the reference gain and the integral are those of section 4.4. The observer is the
stationary Kalman filter of all outputs instead of one of the position alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.ilqr import (
    IlqrDesign,
    RegulatorWeights,
    design_regulator,
    quadratic_gain,
    radius,
)
from flexarm_core.specs import setting

if TYPE_CHECKING:
    import control

# Share of the input's variance that drives every state, so that no state is without a gain.
_STATE_SHARE = 1e-6


@dataclass(frozen=True)
class LqgWeights(RegulatorWeights):
    """Weights and noise levels of the design.

    The noise levels are standard deviations; friction is most of the disturbance.
    """

    disturbance_v: float = setting(0.3, 1e-3, 10.0, "V", "disturbance at the input")
    position_noise_v: float = setting(0.005, 1e-4, 10.0, "V", "noise of the position")
    strain_noise_v: float = setting(0.05, 1e-4, 10.0, "V", "noise of the gauges")
    speed_noise_v: float = setting(0.02, 1e-4, 10.0, "V", "noise of the tachometer")


def design_lqg(model: control.StateSpace, weights: LqgWeights | None = None) -> IlqrDesign:
    """Design regulator, Kalman filter and reference gain.

    Parameters
    ----------
    model : control.StateSpace
        Model of the arm with D = 0.
    weights : LqgWeights, optional
        Weights of the design.

    Returns
    -------
    IlqrDesign
        Gains of the controller; its observer corrects by all four outputs.

    Raises
    ------
    SettingError
        When the model cannot be used.
    """
    weights = weights if weights is not None else LqgWeights()
    kc, kp = design_regulator(model, weights)
    a, b, c = model.A, model.B, model.C
    strain = weights.strain_noise_v
    noise_v = np.array([weights.position_noise_v, strain, strain, weights.speed_noise_v])
    moved = weights.disturbance_v**2 * (b @ b.T + _STATE_SHARE * np.eye(len(a)))
    observer = quadratic_gain(a.T, c.T, moved, np.diag(noise_v**2)).T
    return IlqrDesign(
        model=model,
        channels=tuple(range(len(c))),
        kc=kc,
        observer=observer,
        kp=kp,
        ki=weights.ki,
        regulator_radius=radius(a - b @ kc[None]),
        observer_radius=radius(a - observer @ c),
    )
