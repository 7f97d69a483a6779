"""Self-test of the rig before it is armed: the signs of its answer to a small current.

The test gives two short pulses of current, up and down, each followed by a pause in which friction
stops the arm. During a pulse the speed and the base gauge follow the current, and the middle gauge
has the opposite sign (Appendix B). The position follows the integral of the current. The answer of
each channel is correlated with that course and compared with the standard deviation of its noise.

The test shows a wire on the wrong terminal, a swapped polarity, a dead sensor or a drive without
power before a controller makes it worse.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flexarm_core.channels import CHANNEL_NAMES, CHANNELS, INPUT_RANGE_V
from flexarm_core.errors import SettingError
from flexarm_daq.rigs.rig_protocol import RigError, absent_channels

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.loop.limiter import Gate
    from flexarm_daq.rigs.rig_protocol import Rig

PULSE_V: Final = 2.0
"""Height of the pulses: 1 A, three times the break-away current; it turns the arm 6 degrees."""

MIN_RATE_HZ: Final = 200.0
"""Slowest sampling that shows the pulses."""

_REST_S: Final = 0.25
_PULSE_S: Final = 0.1
_PAUSE_S: Final = 0.1
_SETTLE_S: Final = 1.0
_TRIES: Final = 3
_MAX_START_V: Final = 5.0
_MAX_MOVE_V: Final = 1.5
_SATURATED_V: Final = INPUT_RANGE_V - 0.05
_SATURATED_SHARE: Final = 0.1
# Noise alone exceeds this once in two million times.
_CERTAIN: Final = 5.0
# This is half a step of a 10-bit converter; below it the noise comes from the converter.
_LEAST_NOISE_V: Final = 0.005

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


def profile_v(rate_hz: float) -> NDArray[np.float64]:
    """Return the command after each sample of one try: rest, pulse up, pause, pulse down, pause."""
    levels_v = (0.0, PULSE_V, 0.0, -PULSE_V, 0.0)
    lengths_s = (_REST_S, _PULSE_S, _PAUSE_S, _PULSE_S, _PAUSE_S)
    return np.repeat(levels_v, [round(length_s * rate_hz) for length_s in lengths_s])


def judge(command_v: NDArray[np.float64], volts: NDArray[np.float64]) -> tuple[Answer, ...]:
    """Compare the course of the channels with the expected effect of the current.

    Parameters
    ----------
    command_v : ndarray, (samples,)
        Command in force while each sample was taken, V; zero at first, for noise and offset.
    volts : ndarray, (samples, 4)
        Samples, V.

    Returns
    -------
    tuple of Answer
        One answer per channel.

    Raises
    ------
    SettingError
        If there are less than 2 samples of rest, or no command.
    """
    moving = np.flatnonzero(command_v)
    if not moving.size or moving[0] < 2:  # noqa: PLR2004 - a standard deviation takes two
        raise SettingError("the self-test needs two samples of rest, and a command after them")
    rest = volts[: moving[0]]
    course = np.column_stack([np.cumsum(command_v), command_v, -command_v, command_v])[moving[0] :]
    noise_v = np.maximum(rest.std(axis=0, ddof=1), _LEAST_NOISE_V)
    answer = np.sum(course * (volts[moving[0] :] - rest.mean(axis=0)), axis=0)
    # The mean of the rest is noisy too.
    spread = noise_v * np.sqrt(np.sum(course**2, axis=0) + np.sum(course, axis=0) ** 2 / moving[0])
    saturated = np.mean(np.abs(volts) >= _SATURATED_V, axis=0) > _SATURATED_SHARE
    return tuple(
        Answer(name, SATURATED if clipped else _verdict(certainty), float(certainty))
        for name, clipped, certainty in zip(CHANNEL_NAMES, saturated, answer / spread, strict=True)
    )


def _verdict(certainty: float) -> str:
    if certainty >= _CERTAIN:
        return RIGHT
    return WRONG_SIGN if certainty <= -_CERTAIN else SILENT


def complaint(answers: tuple[Answer, ...]) -> str:
    """Return the faults and their remedies in one line; empty if every channel is right."""
    verdicts = {answer.verdict for answer in answers}
    if verdicts == {WRONG_SIGN}:
        return (
            "every channel answers the current with the wrong sign: the direction (DAC1) is "
            "inverted, check its wire and the parameter nidaq.high_is_positive"
        )
    if verdicts == {SILENT}:
        return (
            "no channel answers the current: check the drive's power, the emergency stop and the "
            "wire of the magnitude (DAC0)"
        )
    advice = {
        WRONG_SIGN: "answers the current with the wrong sign: swap its wires",
        SILENT: "does not answer the current: check sensor, wire and terminal",
        SATURATED: "is at the end of the input range: check its supply and wires",
    }
    return "; ".join(
        f"{answer.channel} (ACH{CHANNEL_NAMES.index(answer.channel)}) {advice[answer.verdict]}"
        for answer in answers
        if answer.verdict != RIGHT
    )


def run_self_test(rig: Rig, gate: Gate, rate_hz: float, *, paced: bool) -> None:
    """Open the rig, pulse it, judge it, and close it with the drive at zero.

    Noise or a swinging arm can leave a try undecided; the test is then repeated.

    Parameters
    ----------
    rig : Rig
        Rig, closed.
    gate : Gate
        Gate before it: the pulses stay within its limits.
    rate_hz : float
        Sampling rate, Hz.
    paced : bool
        True waits a period between samples; false in virtual time.

    Raises
    ------
    RigError
        If the rig fails; `SelfTestError` if a channel is not right.
    """
    absent = absent_channels(rig)
    try:
        rig.open()
        for attempt in range(_TRIES):
            if attempt:
                _follow(rig, gate, np.zeros(round(_SETTLE_S * rate_hz)), rate_hz, paced=paced)
            judged = judge(*_follow(rig, gate, profile_v(rate_hz), rate_hz, paced=paced))
            answers = tuple(answer for answer in judged if answer.channel not in absent)
            if any(answer.verdict == WRONG_SIGN for answer in answers):
                break
            if not complaint(answers):
                return
    finally:
        rig.close()
    raise SelfTestError(f"self-test: {complaint(answers)}")


def check_possible(rate_hz: float, max_command_v: float) -> None:
    """Refuse a sampling rate or a command limit that does not fit the pulses.

    Raises
    ------
    SettingError
        If the sampling is too slow for the pulses or the limit is below them.
    """
    if rate_hz < MIN_RATE_HZ:
        raise SettingError(
            f"the self-test needs a rate_hz of {MIN_RATE_HZ:g} or more, got {rate_hz:g}"
        )
    if max_command_v < PULSE_V:
        raise SettingError(
            f"the self-test needs a max_command_v of {PULSE_V:g} or more, got {max_command_v:g}"
        )


def _follow(
    rig: Rig, gate: Gate, commands_v: NDArray[np.float64], rate_hz: float, *, paced: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Apply the commands in turn; return the commands in force and the samples."""
    in_force_v = np.zeros(len(commands_v))
    volts = np.zeros((len(commands_v), len(CHANNELS)))
    applied_v = 0.0
    gate.reset()
    for k, wanted_v in enumerate(commands_v):
        deadline_s = time.monotonic() + 1.0 / rate_hz
        in_force_v[k] = applied_v
        volts[k] = rig.read().outputs
        hub_v = volts[k, 0]
        if abs(hub_v) > _MAX_START_V:
            raise SelfTestError(
                f"self-test: {CHANNEL_NAMES[0]} (ACH0) reads {hub_v:.2f} V: turn the arm to the "
                f"middle, within {_MAX_START_V:g} V, by hand; else check the sensor"
            )
        if commands_v.any() and abs(hub_v - volts[0, 0]) > _MAX_MOVE_V:
            raise SelfTestError(
                f"self-test: {CHANNEL_NAMES[0]} (ACH0) moved by more than {_MAX_MOVE_V:g} V "
                f"{'at a small pulse' if in_force_v.any() else 'with the drive at zero'}: wait "
                "until the arm rests; else check the sensor, the arm and the drive's gain"
            )
        commands = gate.apply([wanted_v], [0.0], volts[k].tolist(), 1.0 / rate_hz).commands
        rig.write(commands)
        (applied_v,) = commands
        if paced:
            time.sleep(max(0.0, deadline_s - time.monotonic()))
    return in_force_v, volts
