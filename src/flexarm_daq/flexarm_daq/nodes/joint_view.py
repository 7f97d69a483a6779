"""SI view of a sample for `joint_states`: position, velocity and effort of each joint."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, Protocol

from flexarm_core.channels import CHANNELS, COMMAND, DRIVE_A_PER_V, is_thesis_arm
from flexarm_daq.rigs.arm_shape import BEND_JOINTS, HUB, bend_angles
from flexarm_daq.rigs.rig_parameters import RigParameters

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.rig_description import RigDescription


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
