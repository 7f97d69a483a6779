"""Servo in the loop of a rig: its signals by their names, and a change of it without a jump."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.errors import SettingError, nearest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.law_protocol import Memory
    from flexarm_control.servo.controller import Servo
    from flexarm_core.rig_description import RigDescription
    from flexarm_core.signals import Sample

    Answer = tuple[tuple[float, ...], tuple[float, ...]]

FADE = 0.01
"""Part of an input's reach by which the difference to the controller before fades in a sample."""


def require_signals(servo: Servo, rig: RigDescription) -> None:
    """Refuse a controller whose signals or tracked outputs are not those of a rig.

    Raises
    ------
    SettingError
        With the signal, or the outputs.
    """
    for role, wanted, known in (
        ("input", servo.inputs, rig.input_names),
        ("output", servo.outputs, rig.output_names),
    ):
        for name in wanted:
            if name not in known:
                raise SettingError(
                    f"the controller has the {role} {name}, and rig {rig.name} has "
                    f"{', '.join(known)}{nearest(name, known)}: design it on a record of this rig"
                )
    if tuple(servo.tracked) != rig.tracked:
        tracked = ", ".join(servo.tracked)
        raise SettingError(
            f"the controller tracks {tracked}, and rig {rig.name} "
            f"{', '.join(rig.tracked) or 'nothing'}: write tracked: [{tracked}] into its file"
        )


class ServoLoop:
    """Servo of a rig; inputs that it does not have rest.

    Parameters
    ----------
    rig : RigDescription
        The rig.
    servo : Servo
        Its controller.
    """

    def __init__(self, rig: RigDescription, servo: Servo) -> None:
        self._rig = rig
        self._rest = [each.rest for each in rig.inputs]
        self._steps = [FADE * (each.high - each.low) / 2.0 for each in rig.inputs]
        self._difference = [0.0] * len(rig.inputs)
        self._is_new = False
        self._take(servo)

    def _take(self, servo: Servo) -> None:
        self._servo = servo
        self._inputs = [self._rig.input_names.index(name) for name in servo.inputs]
        self._outputs = [self._rig.output_names.index(name) for name in servo.outputs]

    def replace(self, servos: Sequence[Servo]) -> None:
        """Take another controller from the next sample on; the same one changes nothing."""
        (servo,) = servos
        if servo is not self._servo:
            servo.reset()
            self._take(servo)
            self._is_new = True

    def step(self, sample: Sample, references: Sequence[float]) -> Answer:
        """Answer a sample, in whose commands the controller hears what was applied."""
        in_force = [sample.commands[place] for place in self._inputs]
        if not self._is_new:
            self._servo.hear(in_force)
        wanted = self._servo.step([sample.outputs[place] for place in self._outputs], references)
        efforts = list(self._rest)
        for place, effort, before in zip(self._inputs, wanted, in_force, strict=True):
            if self._is_new:
                self._difference[place] = before - effort
            left = self._difference[place]
            efforts[place] = effort + left
            fade = self._steps[place]
            self._difference[place] = left - min(max(left, -fade), fade)
        self._is_new = False
        return tuple(efforts), (0.0,) * len(efforts)

    def reset(self) -> None:
        """Forget the past: the plant is at rest where it is."""
        self._servo.reset()
        self._is_new = False
        self._difference = [0.0] * len(self._rest)

    def memory(self) -> Memory:
        """Return the memory of the servo and the fade."""
        fade = (*self._difference, float(self._is_new))
        return {**self._servo.memory(), "fade": fade}

    def remember(self, memory: Memory) -> None:
        """Go on from a memory of the same controller."""
        *self._difference, is_new = memory["fade"]
        self._is_new = bool(is_new)
        self._servo.remember(memory)
