"""SI view of a sample for `joint_states`: position, velocity and effort of each joint.

The arm of the URDF is `BENDS` equal pieces, each stiff but for a joint in its middle. The joint
takes the change of slope over its piece, the integral of the curvature. The curvature is that of
the gauges where they are, zero at the free tip, and linear in between.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from flexarm_core.channels import CHANNELS, COMMAND, DRIVE_A_PER_V, is_thesis_arm
from flexarm_daq.rigs.rig_parameters import RigParameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_core.rig_description import RigDescription

BENDS = 4
HUB = "hub"
BEND_JOINTS = tuple(f"bend{number}" for number in range(1, BENDS + 1))
"""Names of the virtual joints, from the hub to the tip."""
# Of a piece: the mean over their middles is its integral to 1e-6.
_POINTS = 1000


class JointValues(NamedTuple):
    """Values of all joints in SI units; NaN for what no sensor measures."""

    position: list[float]
    velocity: list[float]
    effort: list[float]


class JointView(Protocol):
    """Joints of one arm."""

    names: tuple[str, ...]

    def of(self, outputs: Sequence[float], commands: Sequence[float]) -> JointValues:
        """Return the values of the joints in one sample."""


class ThesisJoints:
    """Hub of the thesis's arm, and the virtual joints by which a viewer bends its link."""

    names = (HUB, *BEND_JOINTS)

    def __init__(self) -> None:
        arm = RigParameters()
        self._torque_nm_per_a = arm.motor_gain_nm_per_v / DRIVE_A_PER_V
        self._bend_angles = bend_angles(arm)
        self._unknown = [math.nan] * len(BEND_JOINTS)

    def of(self, outputs: Sequence[float], commands: Sequence[float]) -> JointValues:
        """Return angles from position and gauges; speed and torque are those of the hub."""
        angle_v, *gauges_v, rate_v = outputs
        position, _, _, speed = CHANNELS
        torque_nm = COMMAND.to_si(commands[0]) * self._torque_nm_per_a
        return JointValues(
            [position.to_si(angle_v), *(self._bend_angles @ gauges_v)],
            [speed.to_si(rate_v), *self._unknown],
            [torque_nm, *self._unknown],
        )


class DescribedJoints:
    """Joints of a rig by its description; an effort has the SI unit of its input."""

    def __init__(self, rig: RigDescription) -> None:
        self.names = tuple(each.name for each in rig.joints)
        self._rig = rig

    def of(self, outputs: Sequence[float], commands: Sequence[float]) -> JointValues:
        """Return angle, rate and effort of each joint."""
        si = {
            each.name: each.to_si(value)
            for channels, values in ((self._rig.outputs, outputs), (self._rig.inputs, commands))
            for each, value in zip(channels, values, strict=True)
        }
        joints = self._rig.joints
        return JointValues(
            [si[each.angle] for each in joints],
            [si[each.rate] if each.rate else math.nan for each in joints],
            [si[each.input] for each in joints],
        )


def joint_view(rig: RigDescription) -> JointView:
    """Return the view of a rig's joints."""
    return ThesisJoints() if is_thesis_arm(rig) else DescribedJoints(rig)


def bend_angles(parameters: RigParameters) -> NDArray[np.float64]:
    """Return the angles of the virtual joints per volt of the base and the middle gauge.

    Parameters
    ----------
    parameters : RigParameters
        Rig, with its beam and its gauges.

    Returns
    -------
    ndarray, (BENDS, 2)
        Angles in rad per V, positive as the hub's.
    """
    # The gauges' signs are those of the wiring: see `plant`.
    curvature_per_v = np.array(
        [-1.0 / parameters.base_gauge_v_per_nm, 1.0 / parameters.middle_gauge_v_per_nm]
    )
    curvature_per_v /= parameters.bending_stiffness_nm2
    known_m = [parameters.base_gauge_at_m, parameters.middle_gauge_at_m, parameters.length_m]
    piece_m = parameters.length_m / BENDS
    middles_m = piece_m * (np.arange(BENDS * _POINTS) + 0.5) / _POINTS
    shares = [
        np.interp(middles_m, known_m, one_of_three).reshape(BENDS, _POINTS).mean(axis=1)
        for one_of_three in np.eye(3)[:2]
    ]
    angles: NDArray[np.float64] = piece_m * np.column_stack(shares) * curvature_per_v
    return angles
