"""Law with two degrees of freedom: a planned move is played, and a loop takes the differences.

A change of the set-point plans a move of the flat model (`flexarm_control.planning`), as short as
the wanted peak of the command allows. Its command is sent, and its outputs are the set-points of
a PDP loop, which has to take only what the plan does not know. The compensation of friction
follows the planned speed, which has no noise. A change during a move plans the difference that
leads to the new end, and both are played at once: the model is linear, and the sum keeps the peak.
When all moves are over, the law is `pdpc_plus`, with its rest.

The base gauge measures the torque that the arm takes and the tachometer the motion of the hub. What
is left of the command is friction, all in volts of command, with u_c the compensation known::

    d = u - u_c - beta y2 - h y4' - v y4

A low-pass takes the noise and the derivative. At 5 Hz it follows friction; at 15 Hz the loop hunts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, pi
from typing import TYPE_CHECKING, Protocol

from flexarm_control.laws.ilqr import PLAUSIBLE_V
from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, limited
from flexarm_control.laws.payload import (
    NO_ESTIMATE,
    PayloadEstimator,
)
from flexarm_control.laws.pdpc_plus import PdpcPlus
from flexarm_control.planning.move import (
    MOST_PHASES,
    Limits,
    MoveSettings,
    Phase,
    fastest,
    plan,
    what_is_left,
)
from flexarm_core.specs import Bounded, setting

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.gains import CompensationLevel, PdpGains
    from flexarm_control.laws.law_protocol import Memory
    from flexarm_control.laws.payload import PayloadDetection, PayloadEstimate
    from flexarm_control.laws.pdpc_plus import Rest
    from flexarm_control.planning.flat_arm import FlatArm
    from flexarm_control.planning.move import Move, Phases

_MOST_MOVES = 8
"""Moves that are played at once; a stream of set-points is followed in as many parts."""
_WEIGHED_HZ = 50.0
"""Least rate of the estimator of the payload: it takes means of samples, which saves time."""
_ASK_EVERY = 5
_HALF = 2 * MOST_PHASES
_NO_MOVE = [0.0] * (3 + 2 * _HALF)
"""Distance, payload, next sample and both rigid moves of a move that is none, in the memory."""
_BASE_STRAIN, _SPEED = 1, 3


class ArmByPayload(Protocol):
    """Figures of the arm: `ArmFigures`, or those of a model at any payload."""

    def at(self, payload_kg: float) -> FlatArm:
        """Return the figures for a payload, kg."""


@dataclass
class _Playing:
    """Move, what it was planned for, the rigid moves that it is the difference of, next sample."""

    height_v: float
    payload_kg: float
    phases: Phases
    instead_of: Phases
    move: Move
    at: int = 0

    def numbers(self) -> list[float]:
        """Return all but the move, which they give again."""
        beginning = [self.height_v, self.payload_kg, float(self.at)]
        return beginning + _numbers(self.phases) + _numbers(self.instead_of)


class Planned:
    """Planned moves with a PDP loop on the differences.

    Parameters
    ----------
    arm : ArmByPayload
        Figures of the arm. Plans take those of the detected payload.
    settings : MoveSettings
        Settings of the plans.
    gains : PdpGains
        Gains of the PDP loop.
    level : CompensationLevel
        Level of the Coulomb friction compensation.
    rest : Rest
        Thresholds of the rest, help to the bent arm, and sampling rate.
    sensing : FrictionSensing
        Settings of the observer of the friction.
    detection : PayloadDetection
        Settings of the estimator of the payload.
    """

    def __init__(  # noqa: PLR0917 - `LawSpec.build` gives them by place
        self,
        arm: ArmByPayload,
        settings: MoveSettings,
        gains: PdpGains,
        level: CompensationLevel,
        rest: Rest,
        sensing: FrictionSensing,
        detection: PayloadDetection,
    ) -> None:
        self._arm, self._settings = arm, settings
        self._level_v, self._rate_hz = level.compensation_v, rest.rate_hz
        # Friction brakes too: the command has the same peak with the move and against it.
        braking = 1.0 + 2.0 * level.compensation_v / settings.peak_v
        self._limits = Limits(settings.peak_v, braking)
        self._loop = PdpcPlus(gains, level, rest)
        self._observes = sensing.observer_hz > 0.0
        self._observer = FrictionObserver(sensing, rest.rate_hz)
        self._meaned = int(rest.rate_hz // _WEIGHED_HZ)
        self._estimator = PayloadEstimator(replace(detection, rate_hz=rest.rate_hz / self._meaned))
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self._loop.reset()
        self._observer.reset()
        self._estimator.reset()
        self._payload = NO_ESTIMATE
        self._planned_kg = self._settings.payload_kg
        self._base_sum_v = self._speed_sum_v = 0.0
        self._samples = 0
        self._moves: list[_Playing] = []
        self._target_v = 0.0

    @property
    def payload(self) -> PayloadEstimate:
        """Present estimate of the payload."""
        return self._payload

    @property
    def loop(self) -> PdpcPlus:
        """Loop that takes the differences."""
        return self._loop

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        position_v, base_v, middle_v, speed_v = volts
        sizes_v = abs(position_v) + abs(base_v) + abs(middle_v) + abs(speed_v) + abs(reference_v)
        if not sizes_v < PLAUSIBLE_V:
            return NO_EFFORT
        if not self._samples:
            self._target_v = position_v
        self._weigh(base_v, speed_v)
        if reference_v != self._target_v and len(self._moves) < _MOST_MOVES:
            self._begin(reference_v)
        command_v = next_speed_v = 0.0
        for playing in self._moves:
            planned = playing.move[playing.at]
            command_v += planned.command_v
            position_v -= planned.left_v
            middle_v -= planned.middle_strain_v
            speed_v -= planned.speed_v
            next_speed_v += planned.next_speed_v
            playing.at += 1
        answer = self._loop.step((position_v, base_v, middle_v, speed_v), self._target_v)
        effort_v, compensation_v = command_v + answer.effort_v, answer.compensation_v
        if self._moves:
            share = min(1.0, max(-1.0, next_speed_v / self._settings.full_speed_v))
            compensation_v = share * self._level_v
            self._moves = [each for each in self._moves if each.at < len(each.move)]
        elif self._loop.resting:
            self._observer.reset()
            return limited(effort_v, compensation_v)
        if self._observes:
            compensation_v += self._observer.step(volts, effort_v)
        return limited(effort_v, compensation_v)

    def hear(self, missing_v: float, cut_v: float) -> None:  # noqa: ARG002 - it sums no errors
        """Hear what became of the last effort; see `HearingLaw.hear`."""
        self._observer.correct(missing_v)

    def _begin(self, reference_v: float) -> None:
        """Plan the move to a set-point."""
        height_v = reference_v - self._target_v
        arm = self._arm.at(self._planned_kg)
        left: Phases = ()
        if self._moves:
            last = self._moves[-1]
            left = what_is_left(last.phases, last.at / self._rate_hz)
        phases = fastest(arm, left, height_v, self._limits)
        move = plan(arm, height_v, phases, left, self._rate_hz)
        self._moves.append(_Playing(height_v, self._planned_kg, phases, left, move))
        self._target_v = reference_v

    def _weigh(self, base_v: float, speed_v: float) -> None:
        """Give the estimator of the payload the mean of some samples."""
        self._base_sum_v += base_v
        self._speed_sum_v += speed_v
        self._samples += 1
        meaned = self._meaned
        if self._samples % meaned:
            return
        self._estimator.step((0.0, self._base_sum_v / meaned, 0.0, self._speed_sum_v / meaned))
        self._base_sum_v = self._speed_sum_v = 0.0
        if self._samples % (_ASK_EVERY * meaned) == 0:
            self._payload = self._estimator.estimate
            if self._payload.detected:
                self._planned_kg = self._payload.payload_kg

    def memory(self) -> Memory:
        """Return moves, loop, observer and estimator; see `LawWithMemory.memory`."""
        moves = [each.numbers() for each in self._moves]
        unused = [_NO_MOVE] * (_MOST_MOVES - len(moves))
        return {
            **self._loop.memory(),
            **self._estimator.memory(),
            "friction_v": self._observer.state,
            "weighed": (
                self._base_sum_v,
                self._speed_sum_v,
                float(self._samples),
                self._planned_kg,
            ),
            "target_v": (self._target_v,),
            "moves": [float(number) for move in (*moves, *unused) for number in move],
        }

    def remember(self, memory: Memory) -> None:
        """Go on from moves, loop, observer and estimator; see `LawWithMemory.remember`."""
        self._loop.remember(memory)
        left_v, low_speed_v, command_v = memory["friction_v"]
        self._observer.state = left_v, low_speed_v, command_v
        self._estimator.remember(memory)
        self._base_sum_v, self._speed_sum_v, samples, self._planned_kg = memory["weighed"]
        self._samples = int(samples)
        (self._target_v,) = memory["target_v"]
        numbers = iter(memory["moves"])
        self._moves = []
        for height_v, payload_kg, at, *phases in zip(*[numbers] * len(_NO_MOVE), strict=True):
            if height_v:
                new, old = _phases(phases[:_HALF]), _phases(phases[_HALF:])
                move = plan(self._arm.at(payload_kg), height_v, new, old, self._rate_hz)
                self._moves.append(_Playing(height_v, payload_kg, new, old, move, int(at)))


def _numbers(phases: Phases) -> list[float]:
    """Return phases as numbers, as many for each move."""
    numbers = [number for phase in phases for number in phase]
    return numbers + [0.0] * (_HALF - len(numbers))


def _phases(numbers: Sequence[float]) -> Phases:
    """Return the phases of some numbers."""
    pairs = zip(numbers[::2], numbers[1::2], strict=True)
    return tuple(Phase(lasts_s, command_v) for lasts_s, command_v in pairs if lasts_s)


@dataclass(frozen=True)
class FrictionSensing(Bounded):
    """Settings of the observer; the defaults are those of the simulated rig.

    Gain of gauge, tachometer and motor give the weights: beta is one over the gains of base gauge
    and motor, h the inertia of motor and hub and v the viscous friction over the gains of
    tachometer and motor.
    """

    observer_hz: float = setting(
        0.0, 0.0, 50.0, "Hz", "bandwidth of the friction observer; 0: none; try 5"
    )
    command_per_strain: float = setting(1.136, -100.0, 100.0, "V/V", "command that a strain takes")
    command_per_acceleration_s: float = setting(
        0.0235, 0.0, 10.0, "s", "command that accelerates the hub alone, over the change of speed"
    )
    command_per_speed: float = setting(0.451, 0.0, 100.0, "V/V", "viscous friction of the motor")
    most_friction_v: float = setting(1.0, 0.0, 5.0, "V", "most that the observer adds")


class FrictionObserver:
    """Low-pass of the friction beyond a compensation, V.

    Parameters
    ----------
    sensing : FrictionSensing
        Settings.
    rate_hz : float
        Sampling rate of the signals, Hz.

    Attributes
    ----------
    state : tuple of float
        Command that is left, speed, both after the low-pass, and the command in force, V.
    """

    def __init__(self, sensing: FrictionSensing, rate_hz: float) -> None:
        self._sensing = sensing
        pole_per_s = 2.0 * pi * sensing.observer_hz
        self._share = 1.0 - exp(-pole_per_s / rate_hz)
        self._inertia = sensing.command_per_acceleration_s * pole_per_s
        self.state: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def step(self, volts: Sequence[float], effort_v: float) -> float:
        """Return the friction at a sample.

        Parameters
        ----------
        volts : sequence of float
            Position, base strain, middle strain and speed, V.
        effort_v : float
            Effort that answers the sample, V, without the compensation that is known.
        """
        sensing, share = self._sensing, self._share
        if not share:
            return 0.0
        left_v, low_speed_v, command_v = self.state
        base_v, speed_v = volts[_BASE_STRAIN], volts[_SPEED]
        now_v = command_v - (
            sensing.command_per_strain * base_v + sensing.command_per_speed * speed_v
        )
        left_v += share * (now_v - left_v)
        low_speed_v += share * (speed_v - low_speed_v)
        friction_v = left_v - self._inertia * (speed_v - low_speed_v)
        friction_v = min(max(friction_v, -sensing.most_friction_v), sensing.most_friction_v)
        self.state = left_v, low_speed_v, effort_v + friction_v
        return friction_v

    def correct(self, missing_v: float) -> None:
        """Take note that the last effort was another one by so much, V."""
        if self._share:
            left_v, low_speed_v, command_v = self.state
            self.state = left_v, low_speed_v, command_v + missing_v

    def reset(self) -> None:
        """Forget the friction."""
        self.state = (0.0, 0.0, 0.0)
