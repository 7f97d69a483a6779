"""Laws and references of a whole rig from the parameters of a controller, and their loop."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from flexarm_control.joint_laws import JointLaws, joint_ways
from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.switching import Handover
from flexarm_control.loop_setup import TOPIC, Setup
from flexarm_control.sample_rate import suits
from flexarm_control.servo.loop import ServoLoop, require_signals
from flexarm_core.bounds import read_text_bytes
from flexarm_core.channels import is_thesis_arm
from flexarm_core.errors import SettingError, nearest, reason
from flexarm_core.rig_description import described, load_rig

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flexarm_control.joint_laws import JointWay
    from flexarm_control.laws.law_protocol import Memory
    from flexarm_control.laws.payload import PayloadEstimate
    from flexarm_control.servo.controller import Servo
    from flexarm_core.rig_description import RigDescription, Track
    from flexarm_core.signals import Sample

    Answer = tuple[tuple[float, ...], tuple[float, ...]]

RIG = "rig"
"""Entry of the text of a setup: the description of a rig that is not the thesis's arm."""
SERVO = "servo"
CONTROLLER, CONTENT = "servo.controller", "servo.content"
"""Parameter with the file of a controller, and the content of that file in a record."""
REFERENCES = "references"
"""Group of the memory with the set-points of such a rig."""


class Loop(Protocol):
    """Laws of a rig in their loop; they can be replaced between two samples."""

    def replace(self, laws: Sequence[Any]) -> None:
        """Take other laws from the next sample on, without a jump of the commands."""

    def step(self, sample: Sample, references: Sequence[float]) -> Answer:
        """Return efforts and compensations of all inputs in answer to a sample."""

    def reset(self) -> None:
        """Return to the state before the first sample."""

    def memory(self) -> Memory:
        """Return what the next answers follow from; see `LawWithMemory.memory`."""

    def remember(self, memory: Memory) -> None:
        """Go on from a memory of the same laws."""


@dataclass(frozen=True)
class RigSetup:
    """Laws and references of a rig in force; replaced as a whole, by one assignment.

    Attributes
    ----------
    rig : RigDescription
        The rig.
    setups : tuple of Setup
        Law and reference of each joint; of the thesis's arm that of the arm; none with a servo.
    text : str
        All that they were built from, as JSON.
    servo : Servo or None
        Controller of all inputs in the place of laws.
    """

    rig: RigDescription
    setups: tuple[Setup, ...]
    text: str
    servo: Servo | None = None

    @classmethod
    def of(cls, values: Mapping[str, Any], rig: RigDescription | None = None) -> RigSetup:
        """Build laws and references from all parameters of the node, of its rig by default.

        Raises
        ------
        SettingError
            When the values do not fit together, or the rig lacks what the law needs.
        """
        rig = rig or load_rig(values[RIG])
        if values["law"] == SERVO:
            return cls.of_servo(values, rig)
        if is_thesis_arm(rig):
            setup = Setup.of(values)
            return cls(rig, (setup,), setup.text)
        setups = Setup.of_joints(values, rig)
        return cls(rig, setups, json.dumps({**json.loads(setups[0].text), RIG: rig.text}))

    @classmethod
    def of_servo(cls, values: Mapping[str, Any], rig: RigDescription) -> RigSetup:
        """Load the controller that `flexarm design` made; a record has its file's content.

        Raises
        ------
        SettingError
            When there is none, or its signals are not those of the rig.
        """
        # It loads a compiler, which the other laws do without.
        from flexarm_control.servo.controller import Servo  # noqa: PLC0415
        from flexarm_control.servo.files import gains_in  # noqa: PLC0415

        file = values[CONTROLLER]
        content = values.get(CONTENT)
        if not file:
            raise SettingError(f"law servo needs {CONTROLLER}, a controller.yaml of flexarm design")
        if content is None:
            try:
                content = read_text_bytes(Path(file)).decode("utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise SettingError(f"{CONTROLLER} = {file!r}: {reason(error)}") from error
        servo = Servo(gains_in(content.encode(), file))
        require_signals(servo, rig)
        used = {"law": SERVO, "reference": TOPIC, CONTROLLER: file, CONTENT: content}
        return cls(rig, (), json.dumps({**used, RIG: rig.text}), servo)

    @property
    def law(self) -> str:
        """Name of the control law."""
        return self.setups[0].law_spec.name if self.setups else SERVO

    @property
    def uses_outputs(self) -> bool:
        """Whether the law uses the outputs."""
        return not self.setups or bool(self.setups[0].law_spec.uses_outputs)

    @property
    def payload(self) -> Callable[[], PayloadEstimate] | None:
        """Function that returns the law's estimate of the payload, if it has one."""
        return self.setups[0].payload if self.setups else None

    @cached_property
    def laws(self) -> tuple[Any, ...]:
        """Laws of the joints, or the servo: what `Loop.replace` takes."""
        return (self.servo,) if self.servo else tuple(each.law for each in self.setups)

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Outputs that the set-points mean, in their order."""
        return self.rig.tracks

    @cached_property
    def has_profile(self) -> bool:
        """Whether the reference is a built-in one or a trajectory."""
        return bool(self.setups) and self.setups[0].profile is not None

    def profile(self, time_s: float) -> tuple[float, ...]:
        """Return the set-points of the built-in references of the joints."""
        profiles = [each.profile for each in self.setups]
        values_v = [0.0 if each is None else each(time_s) for each in profiles]
        if self._is_thesis_arm:
            return tuple(values_v)
        pairs = zip(self._ways, values_v, strict=True)
        return tuple(way.reference(value_v) for way, value_v in pairs)

    @cached_property
    def _is_thesis_arm(self) -> bool:
        return is_thesis_arm(self.rig)

    @cached_property
    def _ways(self) -> tuple[JointWay, ...]:
        return joint_ways(self.rig)

    def recorded_memory(self, loop: Loop, references: tuple[float, ...]) -> Memory:
        """Return what a record holds of the loop: with its rig it needs all set-points."""
        is_arm_law = self.servo is None and self._is_thesis_arm
        return loop.memory() if is_arm_law else {**loop.memory(), REFERENCES: references}

    def place(self, joint: str) -> int | None:
        """Return the place of a joint or its output among the tracks; None for an unknown name."""
        if not joint and len(self.tracks) == 1:
            return 0
        names = [(each.name, each.output) for each in self.tracks]
        return next((place for place, both in enumerate(names) if joint in both), None)

    def unknown(self, joint: str) -> str:
        """Return that a joint is not known, or not named."""
        names = [each.name for each in self.tracks]
        known = f"the joints are {', '.join(names)}"
        if not joint:
            return f"{known}: name one"
        return f"no joint {joint!r}{nearest(joint, names)}: {known}"

    def check_rate(self, measured_hz: float | None) -> None:
        """Refuse samples at another rate than that of the laws; see `Setup.check_rate`."""
        for setup in self.setups:
            setup.check_rate(measured_hz)
        if self.servo and measured_hz and not suits(self.servo.rate_hz, measured_hz):
            raise SettingError(
                f"the controller is made for {self.servo.rate_hz:g} Hz and the samples come at "
                f"{measured_hz:.0f} Hz: design it on a record of that rate"
            )

    def loop(self) -> Loop:
        """Return the laws in a new loop."""
        if self.servo:
            return ServoLoop(self.rig, self.servo)
        return ArmLoop(self.laws) if self._is_thesis_arm else JointLaws(self.rig, self.laws)


def recorded_setup(parameters: Mapping[str, Any]) -> RigSetup:
    """Return a setup from the parameters that its text holds."""
    if RIG in parameters:
        return RigSetup.of(parameters, described(parameters[RIG]))
    return RigSetup.of(parameters, load_rig("thesis"))


class ArmLoop:
    """Law of the thesis's arm in its loop."""

    def __init__(self, laws: Sequence[Any]) -> None:
        self._handover = Handover(laws[0])
        self.reset, self.memory = self._handover.reset, self._handover.memory
        self.remember = self._handover.remember

    def replace(self, laws: Sequence[Any]) -> None:
        """Take another law; see `Loop.replace`."""
        self._handover.replace(laws[0])

    def step(self, sample: Sample, references: Sequence[float]) -> Answer:
        """Answer a sample; see `Loop.step`."""
        drive = DriveCommand(sample.commands[0], sample.compensations[0])
        effort_v, compensation_v = self._handover.step(sample.outputs, references[0], drive)
        return (effort_v,), (compensation_v,)


def first_references(setup: RigSetup, sample: Sample) -> tuple[float, ...]:
    """Return the set-points before one was given: the arm stays where it is.

    That of the thesis's arm is zero.
    """
    if is_thesis_arm(setup.rig):
        return (0.0,)
    places = [setup.rig.output_names.index(each.output) for each in setup.tracks]
    return tuple(
        min(max(sample.outputs[place], track.low), track.high)
        for place, track in zip(places, setup.tracks, strict=True)
    )
