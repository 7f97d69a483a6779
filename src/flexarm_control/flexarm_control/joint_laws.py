"""Laws in the loop of a rig: one a joint, in the volts of the thesis's arm.

A law of the thesis knows a drive of 10 V and a travel of 6.857 V. On another rig it sees each joint
so: the end of the input's limits stands for 10 V, and that of the travel for 6.857 V. Its gains
then mean the same on every rig, and so do its limits.

Where the set-point of a joint means another angle, such as the direction of the tip, the law takes
it for that of the joint: at rest both are the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.switching import Handover
from flexarm_core.channels import (
    MAX_COMMAND_V,
    POSITION_V_PER_RAD,
    SPEED_V_S_PER_RAD,
    TRAVEL_V,
)
from flexarm_core.errors import SettingError
from flexarm_core.signals import require_both_ways

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_control.laws.law_protocol import LawWithMemory, Memory
    from flexarm_control.laws.registry import LawSpec
    from flexarm_core.rig_description import Joint, Output, RigDescription
    from flexarm_core.signals import Sample

    Answer = tuple[tuple[float, ...], tuple[float, ...]]

_SPEED_S = SPEED_V_S_PER_RAD / POSITION_V_PER_RAD
"""Volts of speed for a volt of position a second."""
RATE_FILTER_HZ = 30.0
"""Cut-off of the filter by which the rate of a joint without a rate sensor is taken from its
angle."""
_ROUNDING_V = 1e-9
"""Change of a command by its way to the units of a drive and back, at most."""
_KNOWN_PLACES = {0, 3}
"""Outputs that every joint has for a law, in the order of the thesis's channels: position, speed.
The gauges' volts of one arm mean nothing on another one."""


@dataclass(frozen=True)
class JointWay:
    """Way between the signals of one joint and the volts of the thesis's arm.

    Attributes
    ----------
    name : str
        Name of the joint.
    input, angle : int
        Places of its input and of its angle.
    rate : int or None
        Place of its rate; None where it is not measured.
    middle, volts_per_unit : float
        Middle of the travel, and volts of position for one unit of the angle.
    rate_volts_per_unit : float
        Volts of speed for one unit of the rate, or of the angle a second.
    rest, per_volt : float
        Command at rest, and change of it for 1 V.
    tracked_per_unit : float
        Units of the tracked output for one unit of the angle.
    """

    name: str
    input: int
    angle: int
    rate: int | None
    middle: float
    volts_per_unit: float
    rate_volts_per_unit: float
    rest: float
    per_volt: float
    tracked_per_unit: float = 1.0

    def angle_v(self, angle: float) -> float:
        """Return an angle in volts."""
        return self.volts_per_unit * (angle - self.middle)

    def reference_v(self, reference: float) -> float:
        """Return a set-point, in the unit of the tracked output, in volts."""
        return self.angle_v(reference / self.tracked_per_unit)

    def reference(self, reference_v: float) -> float:
        """Return a set-point of volts in the unit of the tracked output."""
        return self.tracked_per_unit * (self.middle + reference_v / self.volts_per_unit)


def joint_ways(rig: RigDescription) -> tuple[JointWay, ...]:
    """Return the ways of the joints of a rig."""
    tracked = rig.tracked if _tracks_joints(rig) else [each.angle for each in rig.joints]
    return tuple(
        _way(rig, joint, rig.output(name)) for joint, name in zip(rig.joints, tracked, strict=True)
    )


def _tracks_joints(rig: RigDescription) -> bool:
    """Return whether the set-points mean an angle of each joint, in their order."""
    outputs = [rig.output(name) for name in rig.tracked]
    angles = [joint.angle for joint in rig.joints]
    return len(outputs) == len(angles) and all(
        each.name == angle or (each.quantity == "angle" and each.name not in angles)
        for each, angle in zip(outputs, angles, strict=True)
    )


def _way(rig: RigDescription, joint: Joint, tracked: Output) -> JointWay:
    driven, angle = rig.input(joint.input), rig.output(joint.angle)
    volts_per_unit = joint.sign * TRAVEL_V / joint.half_travel
    per_second = 1.0
    if joint.rate is not None:
        # Units of the angle a second for one unit of the rate.
        per_second = (angle.per_si or 1.0) / (rig.output(joint.rate).per_si or 1.0)
    return JointWay(
        joint.name,
        rig.input_names.index(joint.input),
        rig.output_names.index(joint.angle),
        None if joint.rate is None else rig.output_names.index(joint.rate),
        joint.middle,
        volts_per_unit,
        volts_per_unit * per_second * _SPEED_S,
        driven.rest,
        driven.reach / MAX_COMMAND_V,
        (tracked.per_si or 1.0) / (angle.per_si or 1.0),
    )


def compensation_v(rig: RigDescription, joint: Joint) -> float:
    """Return the Coulomb level of a joint in volts; 0 where it is not known."""
    return (joint.coulomb or 0.0) * MAX_COMMAND_V / rig.input(joint.input).reach


def require_known_outputs(spec: LawSpec, rig: RigDescription) -> None:
    """Refuse a law that needs more of a rig than the angle and the rate of a joint.

    Raises
    ------
    SettingError
        With what the law needs.
    """
    if not rig.joints:
        raise SettingError(
            f"law {spec.name} moves joints, and rig {rig.name} has none: name them in its "
            "description (joints), or record it in open loop (`flexarm experiment B_dat1`) and "
            "take the law servo with a controller that `flexarm design --track` made of that"
        )
    require_both_ways(rig, f"law {spec.name} drives", "take the law servo")
    if not _tracks_joints(rig):
        raise SettingError(
            f"law {spec.name} turns the joints of rig {rig.name}, which tracks "
            f"{', '.join(rig.tracked)}: take the law servo with a controller that `flexarm design "
            "--track` made, or name an angle of each joint under tracked"
        )
    if spec.takes_model or not _KNOWN_PLACES.issuperset(spec.uses_outputs):
        needs = "a model of the thesis's arm" if spec.takes_model else "the strain of its gauges"
        raise SettingError(
            f"law {spec.name} needs {needs}, which rig {rig.name} has not: take pd or pi, or "
            "the law servo with a controller that `flexarm design` made for it"
        )


class JointLaws:
    """Laws of all joints of a rig, each in its own loop.

    Parameters
    ----------
    rig : RigDescription
        The rig.
    laws : sequence of LawWithMemory
        Law of each joint.
    """

    def __init__(self, rig: RigDescription, laws: Sequence[LawWithMemory]) -> None:
        self._ways = joint_ways(rig)
        self._loops = [Handover(law, _ROUNDING_V) for law in laws]
        self._rest = tuple(each.rest for each in rig.inputs)
        self._rates_v = [_RateFilter(rig.rate_hz) for _ in self._ways]

    def replace(self, laws: Sequence[LawWithMemory]) -> None:
        """Take other laws from the next sample on, without a jump of the commands."""
        for loop, law in zip(self._loops, laws, strict=True):
            loop.replace(law)

    def step(self, sample: Sample, references: Sequence[float]) -> Answer:
        """Answer one sample.

        Parameters
        ----------
        sample : Sample
            Outputs, and the commands in force, in the units of the rig.
        references : sequence of float, (joints,)
            Set-points of the tracked outputs, in their units.

        Returns
        -------
        efforts, compensations : tuple of float, (inputs,)
            An input that drives no joint rests.
        """
        efforts, compensations = list(self._rest), [0.0] * len(self._rest)
        rows = zip(self._ways, self._loops, self._rates_v, references, strict=True)
        for way, loop, filtered, reference in rows:
            angle_v = way.angle_v(sample.outputs[way.angle])
            rate_v = filtered.step(angle_v) * _SPEED_S
            if way.rate is not None:
                rate_v = way.rate_volts_per_unit * sample.outputs[way.rate]
            drive = DriveCommand(
                (sample.commands[way.input] - way.rest) / way.per_volt,
                sample.compensations[way.input] / way.per_volt,
            )
            volts = (angle_v, 0.0, 0.0, rate_v)
            effort_v, compensation_v = loop.step(volts, way.reference_v(reference), drive)
            efforts[way.input] = way.rest + way.per_volt * effort_v
            compensations[way.input] = way.per_volt * compensation_v
        return tuple(efforts), tuple(compensations)

    def reset(self) -> None:
        """Return to the state before the first sample."""
        for loop, filtered in zip(self._loops, self._rates_v, strict=True):
            loop.reset()
            filtered.reset()

    def memory(self) -> Memory:
        """Return the memories of all joints, each group behind the name of its joint."""
        found: dict[str, Sequence[float]] = {}
        for way, loop, filtered in zip(self._ways, self._loops, self._rates_v, strict=True):
            groups = {**loop.memory(), "rate": filtered.memory()}
            found |= {f"{way.name}.{name}": group for name, group in groups.items()}
        return found

    def remember(self, memory: Memory) -> None:
        """Go on from a memory of the same laws."""
        for way, loop, filtered in zip(self._ways, self._loops, self._rates_v, strict=True):
            start = f"{way.name}."
            own: Mapping[str, Sequence[float]] = {
                name.removeprefix(start): group
                for name, group in memory.items()
                if name.startswith(start)
            }
            loop.remember(own)
            filtered.remember(own["rate"])


class _RateFilter:
    """Derivative of a signal behind a first-order low pass of `RATE_FILTER_HZ` (Tustin)."""

    def __init__(self, rate_hz: float) -> None:
        omega = 2.0 * math.pi * RATE_FILTER_HZ
        self._gain = 2.0 * omega * rate_hz / (omega + 2.0 * rate_hz)
        self._pole = (2.0 * rate_hz - omega) / (2.0 * rate_hz + omega)
        self._last, self._rate = math.nan, 0.0

    def step(self, value: float) -> float:
        """Return the filtered rate of change at the next sample, a second."""
        if math.isfinite(value):
            change = 0.0 if math.isnan(self._last) else value - self._last
            self._rate = self._pole * self._rate + self._gain * change
            self._last = value
        return self._rate

    def reset(self) -> None:
        """Forget all samples."""
        self._last, self._rate = math.nan, 0.0

    def memory(self) -> Sequence[float]:
        """Return the last value and rate, and whether there was one."""
        known = not math.isnan(self._last)
        return (self._last if known else 0.0, self._rate, float(known))

    def remember(self, memory: Sequence[float]) -> None:
        """Go on from a memory."""
        last, self._rate, known = memory
        self._last = last if known else math.nan
