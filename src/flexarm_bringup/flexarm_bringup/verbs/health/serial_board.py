"""Examination of a board on a serial line: line, sensors, watchdog, stop button and drive.

One step after the other. The motor's supply may be off in all of them but the last.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

import numpy as np

from flexarm_bringup.console import terminal
from flexarm_bringup.verbs.health.hardware import follow_steps
from flexarm_bringup.verbs.health.rig import reading_fault, readings_table
from flexarm_core.errors import SettingError
from flexarm_daq.drivers.at_rest import readings_of
from flexarm_daq.drivers.registry import driven
from flexarm_daq.drivers.scaled_rig import ScaledRig
from flexarm_daq.drivers.serial.rig import SerialRig
from flexarm_daq.loop.limiter import rig_gate
from flexarm_daq.loop.self_test import check_possible, run_self_test
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from flexarm_core.rig_description import RigDescription
    from flexarm_daq.drivers.at_rest import RestReading
    from flexarm_daq.drivers.serial.messages import BoardSample

_REST_S: Final = 1.0
_HAND_S: Final = 30.0
"""Time for what is asked of the user."""
_AGAIN_S: Final = 0.2
_MOST_LOST: Final = 0.01
_BY_HAND: Final = 0.1
"""Way by hand, of a joint's travel to either side."""
_MOST_OFFSET: Final = 0.1
"""Reading of a strain at rest, of its range."""
_LEAST: Final = 1.0
"""Counts that enable the power stage, and are too few to turn a motor."""
_LONGEST_SILENCES: Final = 5


class _Examination:
    """Findings so far on one board.

    Parameters
    ----------
    description : RigDescription
        The rig.
    folder : Path
        Folder of its description.

    Raises
    ------
    SettingError
        If its driver is another one, or its settings are wrong.
    """

    def __init__(self, description: RigDescription, folder: Path) -> None:
        driver = driven(description, folder)
        if not isinstance(driver, SerialRig):
            raise SettingError(
                f"rig {description.name} has the driver {description.driver}: only boards of "
                "serial and nidaq have steps, `flexarm rig check` reads any rig"
            )
        self._rig, self._description = driver, description
        self._scaled = ScaledRig(driver, description)
        self._least = [_LEAST] * len(description.inputs)

    def board(self) -> str:
        self._scaled.open()
        return "; ".join(self._rig.about.splitlines()[:-1])

    def line(self) -> str:
        reading = self._reading = readings_of(self._rig, self._description, _REST_S)
        count = len(reading.raw)
        lost, damaged = self._rig.lost, self._rig.damaged
        if lost + damaged > _MOST_LOST * count:
            raise RigError(
                f"{lost} of {count} frames lost, {damaged} damaged: take a shorter cable, away "
                "from the wires of the motor"
            )
        reading.require_rate(
            self._description.rate_hz,
            "build the firmware with the frequency of the board's crystal",
        )
        return f"{reading.rate_hz:.5g} Hz, {count} samples, {lost} lost, {damaged} damaged"

    def sensors(self) -> str:
        terminal.show_table(readings_table(self._description, self._reading))
        complaints = list(_complaints(self._description, self._reading))
        if complaints:
            raise RigError("; ".join(complaints))
        return "plausible at rest"

    def by_hand(self) -> str:
        """Let the user turn each joint, and compare the direction."""
        found = []
        for joint in self._description.joints:
            place = self._description.output_names.index(joint.angle)
            wanted, unit = _BY_HAND * joint.half_travel, self._description.output(joint.angle).unit
            _ask(
                f"turn joint {joint.name} by hand in the direction that is to be positive, by more "
                f"than {wanted:.2g} {unit}"
            )
            start = float(self._scaled.read().outputs[place])
            moved = 0.0
            for _ in self._samples():
                moved = float(self._scaled.read().outputs[place]) - start
                if abs(moved) > wanted:
                    break
            else:
                raise RigError(
                    f"{joint.angle} has moved by {moved:.2g} {unit} in {_HAND_S:g} s: check supply "
                    "and wires of its sensor; an encoder needs both A and B"
                )
            if moved < 0.0:
                raise RigError(
                    f"{joint.angle} has fallen by {-moved:.2g} {unit}: swap A and B of its encoder,"
                    " or make its scale negative"
                )
            found.append(f"{joint.angle} {moved:+.2g} {unit}")
        return ", ".join(found) or "no joints"

    def watchdog(self) -> str:
        """Enable the power stage, fall silent, and wait for the board to disable it."""
        for _ in self._samples():
            is_driven = self._sample().is_driven
            self._rig.write(self._least)
            if is_driven:
                break
        else:
            raise RigError("the board obeys no command: flash the firmware of this checkout")
        begun_us = self._newest.time_us
        assert self._rig.greeting is not None  # noqa: S101 - an open rig was greeted
        most_ms = _LONGEST_SILENCES * self._rig.greeting.watchdog_ms
        while self._sample().is_driven:
            if (self._newest.time_us - begun_us) % 2**32 > 1e3 * most_ms:
                raise RigError(
                    f"the output is still driven {most_ms} ms after the last command: do not use "
                    "this firmware"
                )
        passed_ms = 1e-3 * ((self._newest.time_us - begun_us) % 2**32)
        return f"zero within {passed_ms:.1f} ms of the last sample with a command"

    def stop_button(self) -> str:
        """Let the user press and release the button while the power stage is enabled."""
        _ask("press the stop button, and keep it pressed")
        for _ in self._samples():
            self._rig.write(self._least)
            if self._is_stopped():
                break
        else:
            raise RigError(f"no press has come within {_HAND_S:g} s: check the button's two wires")
        if self._newest.is_driven or any(self._newest.applied):
            raise RigError("the output is still driven: do not use this firmware")
        _ask("release the stop button")
        until_s = time.monotonic() + _HAND_S
        while time.monotonic() < until_s:
            time.sleep(_AGAIN_S)
            self._scaled.close()
            self._scaled.open()
            if not self._is_stopped():
                return "zero when pressed, ready after its release and a new start"
        raise RigError(f"the button is still pressed after {_HAND_S:g} s: it must open when let go")

    def drive(self) -> str:
        """Pulse each joint; its angle must follow with the joint's sign."""
        self._scaled.close()
        description = self._description
        gate, rate_hz = rig_gate(description), description.rate_hz
        run_self_test(self._scaled, gate, description, rate_hz, paced=False)
        return "every joint follows its pulses, with the right sign"

    def close(self) -> None:
        """Release the board, with its output at zero."""
        self._scaled.close()

    @property
    def _newest(self) -> BoardSample:
        assert self._rig.newest is not None  # noqa: S101 - a sample was read
        return self._rig.newest

    def _sample(self) -> BoardSample:
        self._rig.read()
        return self._newest

    def _is_stopped(self) -> bool:
        try:
            self._rig.read()
        except RigError:
            if not self._newest.is_stopped:
                raise
        return self._newest.is_stopped

    def _samples(self) -> range:
        """Return the samples in which the user may do what is asked."""
        return range(round(_HAND_S * self._description.rate_hz))


def examine_board(description: RigDescription, folder: Path, *, pulse: bool) -> int:
    """Examine a board step by step and print what remains to do; return 0 if all is right, else 1.

    Parameters
    ----------
    description : RigDescription
        Rig with the driver `serial`.
    folder : Path
        Folder of its description.
    pulse : bool
        Whether the motor is pulsed at the end.

    Raises
    ------
    SettingError
        If the rig has another driver, or cannot be pulsed.
    """
    examination = _Examination(description, folder)
    steps: list[tuple[str, Callable[[], str]]] = [
        ("board", examination.board),
        ("line", examination.line),
        ("sensors", examination.sensors),
        ("by hand", examination.by_hand),
        ("watchdog", examination.watchdog),
        ("stop button", examination.stop_button),
    ]
    remains = [
        "What remains, and only you can do:",
        "  1. Switch the motor's supply off in a run: the motor must lose its power.",
        "  2. Supply on, arm in the middle, its way free: the same with --pulse",
    ]
    if pulse:
        check_possible(description, description.rate_hz, np.inf)
        steps.append(("drive", examination.drive))
        del remains[2:]
    try:
        return follow_steps(steps, remains, moving=("drive",))
    finally:
        examination.close()


def _complaints(description: RigDescription, reading: RestReading) -> Iterator[str]:
    """Return what is wrong with each output at rest."""
    joints = {joint.angle: joint for joint in description.joints}
    for channel, output in enumerate(description.outputs):
        if output.absent:
            continue
        values = reading.values(channel, output)
        mean = float(values.mean())
        if fault := reading_fault(output, values):
            yield f"{output.name} is {fault}"
        elif (joint := joints.get(output.name)) and not joint.low <= mean <= joint.high:
            yield (
                f"{output.name} is {mean:.2f} {output.unit}, beyond its travel: turn the arm to "
                "the middle, where an encoder begins at 0"
            )
        elif output.quantity == "strain" and abs(mean) > _MOST_OFFSET * output.span > 0.0:
            raw = float(reading.raw[:, channel].mean())
            yield (
                f"{output.name} reads {mean:+.2f} {output.unit} at rest: balance its amplifier, or "
                f"set offset: {raw:.6g}"
            )


def _ask(what: str) -> None:
    """Ask the user for something by hand."""
    terminal.step(f"now:    {what}")
