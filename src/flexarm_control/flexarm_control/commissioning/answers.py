"""Answers of an unknown arm: to pulses, to slow motion and to an excitation.

Each judgement takes a record and the arm's description, and refuses what would make the next
experiment dangerous or uninformative.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from flexarm_control.joint_laws import joint_ways
from flexarm_control.laws.gains import KD, KP
from flexarm_core.channels import POSITION_V_PER_RAD, SPEED_V_S_PER_RAD
from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.joint_laws import JointWay
    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_core.rig_description import Joint, RigDescription
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.workflow.outcome import Outcome

SOFT_HZ: Final = 0.8
"""Frequency of the soft position loop, about that of the thesis's experiments in closed loop."""
_SOFT_DAMPING: Final = 0.4
# Of the rate's loop at the sampling rate; one is where it begins to ring.
_MOST_RATE_GAIN: Final = 0.5
# Noise alone exceeds this once in two million times.
_CERTAIN: Final = 5.0
_LIGHT_DAMPING: Final = 0.2
# Play answers small pulses with more of a way for each unit than large ones. Friction and a linear
# arm never do, but for noise and vibrations of the pairs before.
_LEAST_OF_PLAY: Final = 1.5
_CLEAR: Final = 20.0
_WITHOUT_PAST: Final = 2
# Of the way of an angle, what its rate does not make; and of the noise of both.
_MOST_APART: Final = 0.2
_ABOVE_NOISE: Final = 3.0
# Standard deviations that friction has to exceed to be there.
_SHOWN: Final = 2.0


class ArmFaultError(FlexarmError):
    """Answer of an arm with which it must not be driven on; the message names the remedy."""


class PulseAnswer(NamedTuple):
    """Answer of a joint to growing pairs of pulses.

    Attributes
    ----------
    joint : str
        Its name.
    height : float
        Highest pulse, in the unit of the input.
    way : float
        Way of the joint to the end of it, in the unit of the angle.
    gain : float
        Acceleration by one unit of the input, less what friction took.
    answering : tuple of str
        Outputs that answered beside the angle.
    """

    joint: str
    height: float
    way: float
    gain: float
    answering: tuple[str, ...]


class SoftLoop(NamedTuple):
    """Gains of the law `pd` of a soft position loop, in the volts of the thesis's arm."""

    kp: float
    kd: float


class Friction(NamedTuple):
    """Friction of a joint.

    Attributes
    ----------
    joint : str
        Its name.
    level, deviation : float
        Dry friction: the command that it takes at any speed, either way, and its standard
        deviation.
    viscous : float
        Command beside it at the slow speed, of what grows with the motion.
    offset : float
        Command that holds the joint against a constant force.
    """

    joint: str
    level: float
    deviation: float
    viscous: float
    offset: float

    @property
    def text(self) -> str:
        """The friction in words, without its unit."""
        if self.level > _SHOWN * self.deviation:
            return f"{self.level:.3g} ± {self.deviation:.2g}"
        return f"below {max(self.level, 0.0) + _SHOWN * self.deviation:.2g}"


class Accuracy(NamedTuple):
    """Standard deviations of a model, each as a part of its value.

    Attributes
    ----------
    frequency, gain : float
        Largest of the frequencies of vibrations, and the median of the gains from the inputs to the
        angles; NaN where they are not known.
    """

    frequency: float
    gain: float

    def misses(self, goal: float) -> str:
        """Return what exceeds a goal in words, or nothing."""
        found = [
            f"the {name} is known to ±{100.0 * value:.2g} %"
            for name, value in (
                ("frequency of a mode", self.frequency),
                ("gain to an angle", self.gain),
            )
            if value > goal
        ]
        return " and ".join(found) + f", and the goal is {100.0 * goal:g} %" if found else ""


def judge_pulses(record: IoData, rig: RigDescription, joint: Joint) -> PulseAnswer:
    """Judge the answer of one joint to pairs of pulses on its input alone.

    Parameters
    ----------
    record : IoData
        Record of the excitation ``pulses``, which begins with a rest.
    rig : RigDescription
        The arm.
    joint : Joint
        The joint that is driven.

    Raises
    ------
    ArmFaultError
        For pulses that are not whole, a dead output, reversed wiring, wiring to another joint, a
        stuck joint, a loose gear, or a sensor of the joint that is dead or reversed.
    """
    u = record.u[:, record.inputs.index(joint.input)] - rig.input(joint.input).rest
    driven = np.flatnonzero(u)
    if not driven.size:
        raise ArmFaultError(
            f"no pulse reached {joint.input}: flexarm status says what holds the drive"
        )
    first = int(driven[0])
    y, noise = record.y - record.y[:first].mean(axis=0), _noise(record.y[:first])
    # The pulse up of the last pair, which is the highest, and the one down behind it.
    rises = np.flatnonzero((u[1:] > 0.0) & (u[:-1] <= 0.0)) + 1
    last_rise = int(rises[-1]) if rises.size else len(u)
    length = int(np.argmax(np.append(u[last_rise:] < 0.0, True)))
    if last_rise + length >= len(u):
        raise ArmFaultError(
            f"the last pulse on {joint.input} is not in the record with both its halves: flexarm "
            "status says what held the drive, doctor --realtime which rate the machine keeps"
        )
    fall = last_rise + length
    angle = record.outputs.index(joint.angle)
    before = y[max(0, last_rise - length) : last_rise].mean(axis=0)
    pair = slice(last_rise, min(fall + length, len(u)))
    certainty = _turning(y[:, angle] / noise[angle], u, rises.tolist(), length)
    answers = _answers(y[pair] - before, noise, first)
    answering = tuple(
        name
        for name, answered in zip(record.outputs, answers, strict=True)
        if answered and not rig.output(name).absent
    )
    way = float((y[fall] - before)[angle])
    if answers[angle]:
        ways = [float(np.ptp(y[rise : rise + 2 * length, angle])) for rise in rises]
        _judge_gear(np.array(ways), u[rises], noise[angle], joint)
        if joint.rate in answering:
            _judge_play(y[last_rise : fall + 2 * length], record, noise, joint)
    if abs(certainty) < _CERTAIN or not answers[angle]:
        raise ArmFaultError(_silence(rig, joint, answering, float(u.max())))
    if certainty * joint.sign < 0.0:
        raise ArmFaultError(
            f"reversed wiring: a positive {joint.input} turns {joint.angle} the other way than "
            f"joint {joint.name} says: swap the wires, or set sign: {-joint.sign}"
        )
    if joint.rate is not None:
        _judge_rate(y, record, joint, answering)
    length_s = length * record.dt_s
    height = float(u[last_rise])
    gain = 2.0 * abs(way) / (length_s**2 * height)
    others = tuple(name for name in answering if name != joint.angle)
    return PulseAnswer(joint.name, height, way, gain, others)


def require_all_answer(answers: Sequence[PulseAnswer], rig: RigDescription) -> None:
    """Refuse an output that answers to no joint.

    Raises
    ------
    ArmFaultError
        With the output.
    """
    heard = {name for each in answers for name in each.answering}
    heard |= {each.angle for each in rig.joints}
    for each in rig.outputs:
        if each.name not in heard and not each.absent:
            raise ArmFaultError(
                f"dead sensor: {each.name} answers to no joint: check sensor, wire and supply, or "
                "mark it absent: true in the description"
            )


def soft_loop(answers: Sequence[PulseAnswer], rig: RigDescription) -> SoftLoop:
    """Return gains of the law `pd` that hold every joint softly, in the volts of `joint_laws`.

    The joint that answers most sets the stiffness, and the one that answers least the damping.
    """
    ways = {each.name: each for each in joint_ways(rig)}
    gains = [each.gain * abs(_volts(ways[each.joint])) for each in answers]
    kp = min((math.tau * SOFT_HZ) ** 2 / max(gains), KP[1])
    per_speed = SPEED_V_S_PER_RAD / POSITION_V_PER_RAD
    kd = 2.0 * _SOFT_DAMPING * math.sqrt(kp / min(gains)) / per_speed
    kd = min(kd, _MOST_RATE_GAIN * rig.rate_hz / (per_speed * max(gains)), KD[1])
    return SoftLoop(kp, kd)


def _volts(way: JointWay) -> float:
    """Return the volts of position for one unit, times the units of the input for one volt."""
    return way.volts_per_unit * way.per_volt


def of_joints(record: IoData, rig: RigDescription) -> IoData:
    """Return a record without the inputs that turn no joint: they rest in a commissioning."""
    turning = {each.input for each in rig.joints}
    kept = [place for place, name in enumerate(record.inputs) if name in turning]
    compensation = None if record.compensation is None else record.compensation[:, kept]
    inputs = tuple(record.inputs[place] for place in kept)
    return replace(record, u=record.u[:, kept], inputs=inputs, compensation=compensation)


def friction_levels(
    records: Sequence[IoData], rig: RigDescription, half_period_s: float
) -> tuple[Friction, ...]:
    """Return the friction of each joint from triangle waves of its position, slow and faster.

    Dry friction takes the same command in all of them. What grows with the motion (viscous
    friction, a spring, the end of a turn) is as many times larger as the motion is.

    Parameters
    ----------
    records : sequence of IoData
        Records of triangles of one period and of two heights or more, the lowest first; each rises
        for the first quarter of its period.
    rig : RigDescription
        The arm.
    half_period_s : float
        Time from turn to turn, s.

    Raises
    ------
    ArmFaultError
        If a joint does not follow.
    """
    found = []
    for joint in rig.joints:
        ramps = np.vstack([_ramps(record, rig, joint, half_period_s) for record in records])
        means, moves = ramps.T
        slow = float(np.abs(moves[: len(moves) // len(records)]).mean())
        causes = np.column_stack([np.sign(moves), moves / slow, np.ones(len(moves))])
        (level, viscous, offset), *_ = np.linalg.lstsq(causes, means, rcond=None)
        misses = means - causes @ (level, viscous, offset)
        variance = float(misses @ misses) / max(1, len(means) - causes.shape[1])
        deviation = math.sqrt(variance * float(np.linalg.pinv(causes.T @ causes)[0, 0]))
        figures = (max(0.0, float(level)), deviation, float(viscous), float(offset))
        found.append(Friction(joint.name, *figures))
    return tuple(found)


def _ramps(record: IoData, rig: RigDescription, joint: Joint, half_period_s: float) -> FloatArray:
    """Return mean command and way of each whole ramp behind its turn, (ramps, 2), up first."""
    time_s = np.arange(len(record)) * record.dt_s / half_period_s + 0.5
    number = time_s.astype(int)
    # The second half of each ramp: the turn is over then.
    steady = (np.round(time_s) > number) & (number > 0)
    command = record.u[:, record.inputs.index(joint.input)] - rig.input(joint.input).rest
    angle = record.y[:, record.outputs.index(joint.angle)]
    parts = [np.flatnonzero(steady & (number == each)) for each in range(1, number[-1] + 1)]
    parts = [each for each in parts if len(each) > 1]
    means = joint.sign * np.array([command[each].mean() for each in parts])
    moves = joint.sign * np.array([angle[each[-1]] - angle[each[0]] for each in parts])
    if np.any(moves * (-1.0) ** np.arange(1, len(parts) + 1) <= 0.0):
        raise ArmFaultError(
            f"stuck joint: {joint.name} does not follow a slow motion of {joint.angle}: free "
            "it, or look for a stop within its travel"
        )
    return np.column_stack([means, moves])


def accuracy(outcome: Outcome, rig: RigDescription, band_hz: tuple[float, float]) -> Accuracy:
    """Return how well a model's vibrations and gains are known by its own data.

    Parameters
    ----------
    outcome : Outcome
        The identification.
    rig : RigDescription
        The arm.
    band_hz : tuple of float
        Ends of the excited band, Hz.
    """
    found = outcome.identification
    low, high = band_hz
    frequencies = [
        each.frequency_std_hz / each.frequency_hz
        for each in found.mode_uncertainty
        if low < each.frequency_hz < high and each.damping_ratio < _LIGHT_DAMPING
    ]
    known = found.response_uncertainty(np.geomspace(low, high, 20))
    gain = math.nan
    if known is not None:
        angles = [outcome.records[0].outputs.index(each.angle) for each in rig.joints]
        inputs = [outcome.records[0].inputs.index(each.input) for each in rig.joints]
        parts = known.deviation[:, angles, inputs] / np.abs(known.response[:, angles, inputs])
        gain = float(np.median(parts))
    return Accuracy(max(frequencies, default=math.nan), gain)


def _noise(rest: FloatArray) -> FloatArray:
    """Return the deviation of each output at rest; that of rounding where it stands still."""
    rounding = np.finfo(float).eps * (1.0 + np.abs(rest).max(axis=0))
    return np.asarray(np.maximum(rest.std(axis=0), rounding))


def _answers(y: FloatArray, noise: FloatArray, rest: int) -> BoolArray:
    """Return which outputs have more power in a pair of pulses than in samples of rest."""
    power = np.mean(y**2, axis=0) / noise**2
    return np.asarray(power > 1.0 + _CERTAIN * math.sqrt(2.0 / len(y) + 4.0 / rest))


def _silence(rig: RigDescription, joint: Joint, answering: Sequence[str], most: float) -> str:
    """Return why the angle of a joint did not answer."""
    most_text = f"{most:.3g} {rig.input(joint.input).unit}"
    others = [each.name for each in rig.joints if each.angle in answering and each is not joint]
    if others:
        return (
            f"wired to another joint, or dead sensor: {joint.input} turns {others[0]} and not "
            f"{joint.name}: exchange the wires, or the inputs in the description, or check the "
            f"sensor of {joint.angle}"
        )
    if joint.rate is not None and joint.rate in answering:
        return (
            f"dead sensor: {joint.rate} answers to {joint.input} up to {most_text}, and "
            f"{joint.angle} does not: check sensor, wire and supply"
        )
    if answering:
        return (
            f"stuck joint, or dead sensor: {', '.join(answering)} answers to {joint.input} up to "
            f"{most_text}, and {joint.angle} does not move: free the joint, or check the sensor"
        )
    return (
        f"dead output, or stuck joint: nothing answers to {joint.input} up to {most_text}: check "
        "the drive's power, its enable input, the emergency stop and the wires, or free the joint"
    )


def _judge_gear(ways: FloatArray, heights: FloatArray, noise: float, joint: Joint) -> None:
    """Refuse an angle that moves by the play of a gear, whatever the height of the pulses.

    Parameters
    ----------
    ways : ndarray, (pairs,)
        From end to end, in each pair.
    heights : ndarray, (pairs,)
        Its pulses.
    """
    known = (ways > _CLEAR * noise) & (ways > ways[-1] / 8.0)
    known[:_WITHOUT_PAST] = False
    if not known.any():
        return
    share = ways[known] / heights[known]
    most = int(np.argmax(share))
    if share[most] > _LEAST_OF_PLAY * ways[-1] / heights[-1]:
        raise ArmFaultError(
            f"loose gear: {joint.angle} moves by {ways[known][most]:.2g} at pulses of "
            f"{heights[known][most]:.2g} on {joint.input}, and by no more than {ways[-1]:.2g} at "
            f"{heights[-1]:.2g}: take the play out of gear and couplings, or look for a stop "
            "within its travel"
        )


def _judge_play(y: FloatArray, record: IoData, noise: FloatArray, joint: Joint) -> None:
    """Refuse a rate and an angle of either side of a gear with play, by their way in a pair."""
    assert joint.rate is not None  # noqa: S101 - the caller asks
    angle, rate = record.outputs.index(joint.angle), record.outputs.index(joint.rate)
    # Beside a straight line: the way of the rate, and what a lag of either one makes.
    way = _without_trend(np.column_stack([np.cumsum(y[:, rate]), y[:, rate]]))
    turned = _without_trend(y[:, angle])
    scale, *_ = np.linalg.lstsq(way, turned, rcond=None)
    apart = float((turned - way @ scale).std())
    # A sum of noise keeps a fifteenth of its power without its straight line.
    summed = abs(float(scale[0])) * noise[rate] * math.sqrt(len(y) / 15.0)
    unsure = math.hypot(noise[angle], summed)
    if apart > max(_MOST_APART * float(turned.std()), _ABOVE_NOISE * unsure):
        raise ArmFaultError(
            f"loose gear: {joint.angle} and {joint.rate} do not move together at pulses on "
            f"{joint.input}: take the play out of gear and couplings"
        )


def _turning(angle: FloatArray, u: FloatArray, rises: Sequence[int], length: int) -> float:
    """Return the speed that the pulses up give an angle, in its standard deviations.

    The pulses down are left out: a heavy tip throws the hub back in them. So is the place from
    which a pulse begins, as the arm may swing.
    """
    ramp = np.arange(length) - 0.5 * (length - 1)
    speeds = [float(ramp @ angle[rise : rise + length]) for rise in rises]
    heights = u[rises]
    return float(heights @ speeds) / math.sqrt(float(heights @ heights) * float(ramp @ ramp))


def _without_trend(course: FloatArray) -> FloatArray:
    """Return one course or some, (samples,) or (samples, n), less their straight lines."""
    causes = np.column_stack([np.ones(len(course)), np.linspace(-1.0, 1.0, len(course))])
    line, *_ = np.linalg.lstsq(causes, course, rcond=None)
    return np.asarray(course - causes @ line)


def _judge_rate(y: FloatArray, record: IoData, joint: Joint, answering: Sequence[str]) -> None:
    """Refuse a rate that is dead or has the other sign than the angle's own."""
    assert joint.rate is not None  # noqa: S101 - the caller asks
    if joint.rate not in answering:
        raise ArmFaultError(
            f"dead sensor: {joint.rate} does not answer while {joint.angle} moves: check sensor, "
            "wire and supply"
        )
    # The integral of the rate runs beside the angle, whatever noise both have.
    rate = y[:, record.outputs.index(joint.rate)]
    angle = y[:, record.outputs.index(joint.angle)]
    if float(np.cumsum(rate - rate.mean()) @ _without_trend(angle)) < 0.0:
        raise ArmFaultError(
            f"reversed wiring: {joint.rate} has the other sign than the motion of {joint.angle}: "
            "swap its wires, or make its scale negative"
        )
