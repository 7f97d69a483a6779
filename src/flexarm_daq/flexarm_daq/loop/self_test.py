"""Self-test of the rig before it is armed: the signs of its answer to a small command.

The test gives the input of each joint two short pulses, up and down, each followed by a pause in
which friction stops the arm. The joint's angle follows the integral of the pulses and its rate the
pulses themselves, with the sign of the joint. On the thesis's arm the base gauge follows them too,
and the middle gauge has the opposite sign (Appendix B). The answer of each output is correlated
with that course and compared with the standard deviation of its noise.

The test shows a wire on the wrong terminal, a swapped polarity, a dead sensor or a drive without
power before a controller makes it worse.
"""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flexarm_core.channels import is_thesis_arm
from flexarm_core.errors import SettingError
from flexarm_core.signals import require_both_ways
from flexarm_daq.rigs.rig_protocol import RigError, absent_channels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_core.rig_description import Joint, RigDescription
    from flexarm_daq.loop.limiter import Gate
    from flexarm_daq.rigs.rig_protocol import Rig

PULSE: Final = 0.2
"""Height of the pulses, of the way from the input's rest to its limit: on the thesis's arm 2 V or
1 A, three times the break-away current, which turns it 6 degrees."""

MIN_RATE_HZ: Final = 200.0
"""Slowest sampling that shows the pulses."""

_REST_S: Final = 0.25
_PULSE_S: Final = 0.1
_PAUSE_S: Final = 0.1
_SETTLE_S: Final = 1.0
_TRIES: Final = 3
# Of the joint's travel to either side: where a test may begin, and how far the arm may move in it.
_MAX_START: Final = 0.73
_MAX_MOVE: Final = 0.22
# Of the range of an output: the readings at its end, and half a step of a 10-bit converter, below
# which the noise comes from the converter.
_AT_END: Final = 0.0025
_LEAST_NOISE: Final = 0.00025
_SATURATED_SHARE: Final = 0.1
# Noise alone exceeds this once in two million times.
_CERTAIN: Final = 5.0
# A rest without noise or range is a counter's, of which a step or two may come from anything.
_FEWEST_STEPS: Final = 3
# The gauges of the thesis's arm, in the order of its outputs.
_GAUGE_SIGNS: Final = {1: 1.0, 2: -1.0}

RIGHT: Final = "right"
WRONG_SIGN: Final = "wrong sign"
SILENT: Final = "silent"
SATURATED: Final = "saturated"


class SelfTestError(RigError):
    """Wrong answer of the rig; the message names the channel."""


class Answer(NamedTuple):
    """Answer of one channel.

    Attributes
    ----------
    channel : str
        Name of the channel.
    verdict : str
        `RIGHT`, `WRONG_SIGN`, `SILENT` or `SATURATED`.
    certainty : float
        Height of the answer in standard deviations of the channel's noise; negative for the wrong
        sign.
    """

    channel: str
    verdict: str
    certainty: float


def profile(rate_hz: float, height: float) -> NDArray[np.float64]:
    """Return the command after each sample of one try: rest, pulse up, pause, pulse down, pause."""
    levels = (0.0, height, 0.0, -height, 0.0)
    lengths_s = (_REST_S, _PULSE_S, _PAUSE_S, _PULSE_S, _PAUSE_S)
    return np.repeat(levels, [round(length_s * rate_hz) for length_s in lengths_s])


def judge(
    command: NDArray[np.float64],
    outputs: NDArray[np.float64],
    rig: RigDescription,
    joint: Joint,
) -> tuple[Answer, ...]:
    """Compare the course of the outputs with the expected effect of the pulses of one joint.

    Parameters
    ----------
    command : ndarray, (samples,)
        Command of the joint, from its rest, in force while each sample was taken; zero at first,
        for noise and offset.
    outputs : ndarray, (samples, outputs)
        Samples.
    rig : RigDescription
        The arm.
    joint : Joint
        The joint that is pulsed.

    Returns
    -------
    tuple of Answer
        One answer for each output whose course is known, and for each saturated one.

    Raises
    ------
    SettingError
        If there are less than 2 samples of rest, or no command.
    """
    moving = np.flatnonzero(command)
    if not moving.size or moving[0] < 2:  # noqa: PLR2004 - a standard deviation takes two
        raise SettingError("the self-test needs two samples of rest, and a command after them")
    answers = []
    for number, output in enumerate(rig.outputs):
        readings = outputs[:, number]
        from_end = np.minimum(readings - output.low, output.high - readings)
        course = _course(command, rig, joint, number)
        if output.span and np.mean(from_end <= _AT_END * output.span) > _SATURATED_SHARE:
            answers.append(Answer(output.name, SATURATED, math.inf))
        elif course is not None:
            certainty = _certainty(course[moving[0] :], readings, output.span)
            answers.append(Answer(output.name, _verdict(certainty), certainty))
    return tuple(answers)


def _course(
    command: NDArray[np.float64], rig: RigDescription, joint: Joint, number: int
) -> NDArray[np.float64] | None:
    """Return the course of an output behind a command; None where it is not known."""
    name = rig.outputs[number].name
    if name == joint.angle:
        return joint.sign * np.cumsum(command)
    if name == joint.rate:
        return joint.sign * command
    if is_thesis_arm(rig):
        return _GAUGE_SIGNS[number] * command
    return None


def _certainty(course: NDArray[np.float64], readings: NDArray[np.float64], span: float) -> float:
    """Return the height of an answer in deviations of the noise of the rest before the course."""
    rest, answering = np.split(readings, [len(readings) - len(course)])
    if not (span or np.ptp(rest)):
        steps = np.diff(np.unique(readings))
        if not steps.size or np.ptp(readings) < _FEWEST_STEPS * steps.min():
            return 0.0
    rounding = float(np.finfo(float).eps * (1.0 + np.abs(rest).max()))
    noise = max(float(rest.std(ddof=1)), _LEAST_NOISE * span, rounding)
    # The mean of the rest is noisy too.
    spread = math.sqrt(float(course @ course) + float(course.sum()) ** 2 / len(rest))
    return float(course @ (answering - rest.mean())) / (noise * spread)


def _verdict(certainty: float) -> str:
    if certainty >= _CERTAIN:
        return RIGHT
    return WRONG_SIGN if certainty <= -_CERTAIN else SILENT


def complaint(answers: tuple[Answer, ...], rig: RigDescription, joint: Joint) -> str:
    """Return the faults and their remedies in one line; empty if every output is right."""
    verdicts = {answer.verdict for answer in answers}
    of_thesis = is_thesis_arm(rig)
    if verdicts == {WRONG_SIGN}:
        if of_thesis:
            return (
                "every channel answers the current with the wrong sign: the direction (DAC1) is "
                "inverted, check its wire and the parameter nidaq.high_is_positive"
            )
        return (
            f"{joint.angle} answers {joint.input} with the wrong sign: swap the wires, or set "
            f"sign: {-joint.sign} for joint {joint.name}"
        )
    if verdicts == {SILENT}:
        what, wire = ("the current", "magnitude (DAC0)") if of_thesis else (joint.input, "command")
        return (
            f"no channel answers {what}: check the drive's power, the emergency stop and the "
            f"wire of the {wire}"
        )
    command = "the current" if of_thesis else joint.input
    advice = {
        WRONG_SIGN: f"answers {command} with the wrong sign: swap its wires"
        + ("" if of_thesis else ", or make its scale negative"),
        SILENT: f"does not answer {command}: check sensor, wire and terminal",
        SATURATED: "is at the end of the input range: check its supply and wires",
    }
    return "; ".join(
        f"{_wired(answer.channel, rig)} {advice[answer.verdict]}"
        for answer in answers
        if answer.verdict != RIGHT
    )


def _wired(output: str, rig: RigDescription) -> str:
    """Return an output with its terminal, where the thesis names one."""
    number = rig.output_names.index(output)
    return f"{output} (ACH{number})" if is_thesis_arm(rig) else output


def run_self_test(
    rig: Rig, gate: Gate, description: RigDescription, rate_hz: float, *, paced: bool
) -> None:
    """Open the rig, pulse each joint, judge it, and close the rig with the drives at rest.

    Noise or a swinging arm can leave a try undecided; the test is then repeated.

    Parameters
    ----------
    rig : Rig
        Rig, closed.
    gate : Gate
        Gate before it: the pulses stay within its limits.
    description : RigDescription
        The arm: its joints, and the ranges of its outputs.
    rate_hz : float
        Sampling rate, Hz.
    paced : bool
        True waits a period between samples; false in virtual time.

    Raises
    ------
    RigError
        If the rig fails; `SelfTestError` if an output is not right.
    """
    absent = {*absent_channels(rig), *(each.name for each in description.outputs if each.absent)}
    pulsed = _Pulsed(rig, gate, description, rate_hz, paced)
    try:
        rig.open()
        for joint in description.joints:
            fault = _fault_of(pulsed, joint, absent)
            if fault:
                raise SelfTestError(f"self-test: {fault}")
    finally:
        rig.close()


class _Pulsed(NamedTuple):
    """Open rig that is pulsed, with its gate, description and pace."""

    rig: Rig
    gate: Gate
    description: RigDescription
    rate_hz: float
    paced: bool


def _fault_of(pulsed: _Pulsed, joint: Joint, absent: set[str]) -> str:
    """Return what is wrong with the answers to the pulses of a joint; empty if nothing is."""
    rig, rate_hz = pulsed.description, pulsed.rate_hz
    fault = ""
    for attempt in range(_TRIES):
        if attempt:
            _follow(pulsed, joint, np.zeros(round(_SETTLE_S * rate_hz)))
        pulses = profile(rate_hz, PULSE * rig.input(joint.input).reach)
        judged = judge(*_follow(pulsed, joint, pulses), rig, joint)
        answers = tuple(answer for answer in judged if answer.channel not in absent)
        if not answers:
            return f"joint {joint.name} has no sensor that could answer: set self_test:=off"
        fault = complaint(answers, rig, joint)
        if not fault or any(answer.verdict == WRONG_SIGN for answer in answers):
            break
    return fault


def check_possible(rig: RigDescription, rate_hz: float, max_command_v: float) -> None:
    """Refuse an arm, a sampling rate or a limit of the thesis's drive without room for the pulses.

    Raises
    ------
    SettingError
        If the arm has no joint or one that is driven one way only, the sampling is too slow for the
        pulses or the limit is below them.
    """
    if not rig.joints:
        raise SettingError(
            f"the self-test pulses joints, and {rig.name} has none: set self_test:=off"
        )
    require_both_ways(rig, "the self-test pulses", "set self_test:=off")
    if rate_hz < MIN_RATE_HZ:
        raise SettingError(
            f"the self-test needs a rate_hz of {MIN_RATE_HZ:g} or more, got {rate_hz:g}"
        )
    least_v = PULSE * rig.inputs[0].reach
    if is_thesis_arm(rig) and max_command_v < least_v:
        raise SettingError(
            f"the self-test needs a max_command_v of {least_v:g} or more, got {max_command_v:g}"
        )


def _follow(
    pulsed: _Pulsed, joint: Joint, commands: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Give a joint commands from its rest in turn; return those in force, and the samples."""
    rig, gate, description, rate_hz, paced = pulsed
    rests = [each.rest for each in description.inputs]
    place = description.input_names.index(joint.input)
    angle = description.output_names.index(joint.angle)
    in_force = np.zeros(len(commands))
    outputs = np.zeros((len(commands), len(description.outputs)))
    applied = 0.0
    gate.reset()
    for k, wanted in enumerate(commands):
        deadline_s = time.monotonic() + 1.0 / rate_hz
        in_force[k] = applied
        outputs[k] = rig.read().outputs
        _require_room(outputs[: k + 1, angle], in_force, description, joint, moves=commands.any())
        asked = list(rests)
        asked[place] += wanted
        given = gate.apply(asked, [0.0] * len(rests), outputs[k].tolist(), 1.0 / rate_hz).commands
        rig.write(given)
        applied = given[place] - rests[place]
        if paced:
            time.sleep(max(0.0, deadline_s - time.monotonic()))
    return in_force, outputs


def _require_room(
    angle: NDArray[np.float64],
    in_force: NDArray[np.float64],
    rig: RigDescription,
    joint: Joint,
    *,
    moves: bool | np.bool_,
) -> None:
    """Refuse a joint that begins too near to an end of its travel, or moves too far in a test."""
    most_start, most_move = _MAX_START * joint.half_travel, _MAX_MOVE * joint.half_travel
    is_far = abs(angle[-1] - joint.middle) > most_start
    if not is_far and not (moves and abs(angle[-1] - angle[0]) > most_move):
        return
    name, unit = _wired(joint.angle, rig), rig.output(joint.angle).unit
    if is_far:
        raise SelfTestError(
            f"self-test: {name} reads {angle[-1]:.2f} {unit}: turn the arm to the middle, within "
            f"{most_start:.2g} {unit}, by hand; else check the sensor"
        )
    raise SelfTestError(
        f"self-test: {name} moved by more than {most_move:.2g} {unit} "
        f"{'at a small pulse' if in_force.any() else 'with the drive at zero'}: wait until the "
        "arm rests; else check the sensor, the arm and the drive's gain"
    )
