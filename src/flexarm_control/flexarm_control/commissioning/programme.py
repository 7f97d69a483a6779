"""Programme of a commissioning: which experiments, how strong, and how long they take."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flexarm_control.joint_laws import joint_ways
from flexarm_core.channels import MAX_COMMAND_V, TRAVEL_V
from flexarm_core.waves import Band

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.commissioning.answers import Friction, SoftLoop
    from flexarm_core.rig_description import RigDescription
    from flexarm_ident.records.iodata import IoData

PULSES_V: Final = 5.0
"""Highest pulse: half of the reach of the input, which stands for 10 V."""
_PULSES_S: Final = 6.0
RAMPS_V: Final = {"friction": 1.5, "friction_faster": 3.0}
"""Slow motions to either side of the middle, of a travel that stands for 6.857 V."""
RAMP_S: Final = 4.0
"""Time of a slow motion from turn to turn."""
_RAMPS: Final = 4.5
PERIOD_S: Final = 8.0
"""Period of the multisine."""
PERIODS: Final = 4
PARTS: Final = 4
"""Parts of the excitation, at most."""
_FIRST_V: Final = 2.0
_GROWTH: Final = 2.0
# Of the travel and of a sensor's range, the rest is for what a prediction misses.
_MOST_SHARE: Final = 0.8
_LOW_HZ: Final = 0.2
# Of the sampling rate: six samples a period and more show a mode.
_HIGH_SHARE: Final = 1.0 / 6.0
_HOLD_S: Final = 3.0


class Measurement(NamedTuple):
    """One run of the arm.

    Attributes
    ----------
    name : str
        Name of its bag.
    commander : str
        Node that commands, `experiment` or `controller`.
    parameters : dict
        Its parameters.
    length_s : float
        Length, s.
    """

    name: str
    commander: str
    parameters: dict[str, Any]
    length_s: float


class Stage(NamedTuple):
    """Line of the programme for a user."""

    name: str
    drives: str
    most: str
    length_s: float


@dataclass(frozen=True)
class Programme:
    """Experiments of one arm.

    Attributes
    ----------
    rig : RigDescription
        The arm.
    """

    rig: RigDescription

    @property
    def band(self) -> Band:
        """Band of the multisine, of odd lines with equal power in each octave."""
        high_hz = _HIGH_SHARE * self.rig.rate_hz
        return Band(_LOW_HZ, high_hz, PERIOD_S, odd=True, octaves=True)

    def pulses(self, number: int) -> Measurement:
        """Return the pulses of one joint."""
        joint = self.rig.joints[number]
        parameters = {"waveform": "pulses", "magnitude_v": PULSES_V, "input": joint.input}
        return Measurement(f"pulses_{joint.name}", "experiment", parameters, _PULSES_S)

    def friction(self, loop: SoftLoop) -> tuple[Measurement, ...]:
        """Return the slow motions of all joints, at two speeds."""
        law = self._law(loop, 0.0) | {"reference": "triangle", "triangle.offset_v": 0.0}
        period = {"triangle.period_s": 2.0 * RAMP_S}
        return tuple(
            Measurement(
                name,
                "controller",
                law | period | {"triangle.amplitude_v": amplitude_v},
                _RAMPS * RAMP_S,
            )
            for name, amplitude_v in RAMPS_V.items()
        )

    def part(
        self, number: int, magnitude_v: float, loop: SoftLoop, friction: Sequence[Friction]
    ) -> Measurement:
        """Return a part of the excitation, with the peak of the multisine, V."""
        band = self.band
        wave = {
            "multisine.magnitude_v": magnitude_v / loop.kp,
            "multisine.low_hz": band.low_hz,
            "multisine.high_hz": band.high_hz,
            "multisine.period_s": band.period_s,
            # Joints have the seeds that follow.
            "multisine.seed": number * len(self.rig.joints),
        }
        law = self._law(loop, min(self._levels_v(friction)))
        return Measurement(
            f"part_{number}",
            "controller",
            law | {"reference": "multisine"} | wave,
            PERIODS * PERIOD_S,
        )

    def servo(self, name: str, controller: str, length_s: float = _HOLD_S) -> Measurement:
        """Return a run of the controller that was designed."""
        parameters = {"law": "servo", "servo.controller": controller, "reference": "topic"}
        return Measurement(name, "controller", parameters, length_s)

    def first_v(self, friction: Sequence[Friction]) -> float:
        """Return the peak of the first part, V: well above the friction."""
        most_v = _GROWTH * max(self._levels_v(friction))
        return min(max(_FIRST_V, most_v), MAX_COMMAND_V)

    def _levels_v(self, friction: Sequence[Friction]) -> list[float]:
        """Return the friction of each joint in the volts of the thesis's arm."""
        return [
            each.level * MAX_COMMAND_V / self.rig.input(joint.input).reach
            for each, joint in zip(friction, self.rig.joints, strict=True)
        ]

    def growth(self, record: IoData, magnitude_v: float) -> float:
        """Return by how much the next part may be stronger, 2 at most.

        What moves by some way is predicted to move by so much more; no joint may pass 80 % of its
        travel, and no reading 80 % of its range.
        """
        found = [_GROWTH, MAX_COMMAND_V / magnitude_v]
        for way in joint_ways(self.rig):
            travelled_v = way.volts_per_unit * (record.y[:, way.angle] - way.middle)
            found.append(_MOST_SHARE * TRAVEL_V / float(np.abs(travelled_v).max()))
        for each, column in zip(self.rig.outputs, record.y.T, strict=True):
            if each.span and np.ptp(column) > 0.0:
                off = float(np.abs(column - 0.5 * (each.high + each.low)).max())
                found.append(_MOST_SHARE * 0.5 * each.span / off)
        return min(found)

    def stages(self) -> tuple[Stage, ...]:
        """Return the programme for a user, before anything is known of the arm."""
        reach = ", ".join(
            f"{each.rest - each.reach:g} to {each.rest + each.reach:g} {each.unit}"
            for each in self.rig.inputs
        )
        half = ", ".join(
            f"{each.rest - 0.5 * each.reach:g} to {each.rest + 0.5 * each.reach:g} {each.unit}"
            for each in self.rig.inputs
        )
        share = round(100.0 * max(RAMPS_V.values()) / TRAVEL_V)
        pulses_s = _PULSES_S * len(self.rig.joints)
        return (
            Stage("check", "nothing", "", 2.0),
            Stage("pulses", "one joint after the other, growing until it moves", half, pulses_s),
            Stage(
                "friction",
                f"all joints slowly, up to {share} % of the travel to either side",
                reach,
                len(RAMPS_V) * _RAMPS * RAMP_S,
            ),
            Stage(
                "excitation",
                f"a multisine from {self.band.low_hz:g} to {self.band.high_hz:.3g} Hz in a soft "
                f"position loop, up to {PARTS} times",
                reach,
                PARTS * PERIODS * PERIOD_S,
            ),
            Stage("step", "the tracked outputs, with the new controller", reach, 15.0),
        )

    @staticmethod
    def _law(loop: SoftLoop, compensation_v: float) -> dict[str, Any]:
        """Return the soft position loop; other arms have the compensation of their description."""
        gains = {"pd.kp": loop.kp, "pd.kd": loop.kd, "pd.compensation_v": compensation_v}
        return {"law": "pd"} | gains
