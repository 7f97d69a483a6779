"""Linear quadratic Gaussian control from all four signals, the textbook's answer as a baseline.

The regulator, the reference gain and the integral are those of section 4.4; the observer is the
stationary Kalman filter of the whole sample instead of one of the position alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.ilqr import (
    IlqrDesign,
    RegulatorWeights,
    design_regulator,
    quadratic_gain,
    radius,
)
from flexarm_core.specs import limits

if TYPE_CHECKING:
    import control

# Of the input's variance: holds the filter open for every state that the input hardly moves.
_STATE_SHARE = 1e-6


@dataclass(frozen=True)
class LqgWeights(RegulatorWeights):
    """Weights and noise levels of the design.

    Attributes
    ----------
    position, strain, speed, effort, ki
        As in `RegulatorWeights`.
    disturbance_v
        Standard deviation of the disturbance at the input, V; friction is most of it.
    position_noise_v, strain_noise_v, speed_noise_v
        Standard deviations of the noise of the sensors, V.
    """

    disturbance_v: float = field(
        default=0.3, metadata=limits(1e-3, 10.0, "V", "disturbance at the input")
    )
    position_noise_v: float = field(
        default=0.005, metadata=limits(1e-4, 10.0, "V", "noise of the position")
    )
    strain_noise_v: float = field(
        default=0.05, metadata=limits(1e-4, 10.0, "V", "noise of the gauges")
    )
    speed_noise_v: float = field(
        default=0.02, metadata=limits(1e-4, 10.0, "V", "noise of the tachometer")
    )


def design_lqg(model: control.StateSpace, weights: LqgWeights | None = None) -> IlqrDesign:
    """Design regulator, Kalman filter and reference gain.

    Parameters
    ----------
    model
        Model of the arm with D = 0.
    weights
        Weights of the design.

    Returns
    -------
    IlqrDesign
        The controller; its observer corrects by all four outputs.

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
