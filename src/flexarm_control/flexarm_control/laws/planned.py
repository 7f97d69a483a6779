"""Law with two degrees of freedom: a planned move is played, and a loop takes the differences.

A change of the set-point plans a move of the flat model (`flexarm_control.planning`), as short as
the wanted peak of the command allows. Its command is sent, and its outputs are the set-points of
a PDP loop, which has to take only what the plan does not know. The compensation of friction
follows the planned speed, which has no noise. A change during a move is a further move, and both
are played at once: the model is linear. When all moves are over, the law is `pdpc_plus`, with its
calm rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from flexarm_control.laws.ilqr import PLAUSIBLE_V
from flexarm_control.laws.law_protocol import NO_EFFORT, Effort, limited
from flexarm_control.laws.payload import (
    NO_ESTIMATE,
    PayloadEstimator,
)
from flexarm_control.laws.pdpc_plus import PdpcPlus
from flexarm_control.planning.friction_observer import FrictionObserver
from flexarm_control.planning.move import MoveSettings, plan, shortest_samples

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.gains import CompensationLevel, PdpGains
    from flexarm_control.laws.law_protocol import Memory
    from flexarm_control.laws.payload import PayloadDetection, PayloadEstimate
    from flexarm_control.laws.pdpc_plus import Rest
    from flexarm_control.planning.flat_arm import FlatArm
    from flexarm_control.planning.friction_observer import FrictionSensing
    from flexarm_control.planning.move import Move

_MOST_MOVES = 8
"""Moves that are played at once; a stream of set-points is followed in as many parts."""
_WEIGHED_HZ = 50.0
"""Least rate of the estimator of the payload: it takes means of samples, which saves time."""
_ASK_EVERY = 5
_NO_MOVE = (0.0, 0.0, 0.0, 0.0)
"""Distance, payload, length and next sample of a move that is none, in the memory."""


class ArmByPayload(Protocol):
    """Figures of the arm: `ArmFigures`, or those of a model at any payload."""

    def at(self, payload_kg: float) -> FlatArm:
        """Return the figures for a payload, kg."""


@dataclass
class _Playing:
    """Move, what it was planned for, and its next sample."""

    height_v: float
    payload_kg: float
    move: Move
    at: int = 0


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
        self._loop = PdpcPlus(gains, level.compensation_v, rest)
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
        self._sums_v = (0.0, 0.0)
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
        for value_v in (*volts, reference_v):
            if not -PLAUSIBLE_V < value_v < PLAUSIBLE_V:
                return NO_EFFORT
        position_v, base_v, middle_v, speed_v = volts
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
        return limited(effort_v, compensation_v + self._observer.step(volts, effort_v))

    def _begin(self, reference_v: float) -> None:
        """Plan the move to a set-point."""
        height_v = reference_v - self._target_v
        arm = self._arm.at(self._planned_kg)
        samples = shortest_samples(arm, height_v, self._settings, self._rate_hz)
        move = plan(arm, height_v, samples, self._rate_hz)
        self._moves.append(_Playing(height_v, self._planned_kg, move))
        self._target_v = reference_v

    def _weigh(self, base_v: float, speed_v: float) -> None:
        """Give the estimator of the payload the mean of some samples."""
        base_sum_v, speed_sum_v = self._sums_v
        self._sums_v = base_sum_v + base_v, speed_sum_v + speed_v
        self._samples += 1
        count, left = divmod(self._samples, self._meaned)
        if left:
            return
        base_sum_v, speed_sum_v = self._sums_v
        self._sums_v = (0.0, 0.0)
        self._estimator.step((0.0, base_sum_v / self._meaned, 0.0, speed_sum_v / self._meaned))
        if count % _ASK_EVERY == 0:
            self._payload = self._estimator.estimate
            if self._payload.detected:
                self._planned_kg = self._payload.payload_kg

    def memory(self) -> Memory:
        """Return moves, loop, observer and estimator; see `LawWithMemory.memory`."""
        moves = [(each.height_v, each.payload_kg, len(each.move), each.at) for each in self._moves]
        unused = [_NO_MOVE] * (_MOST_MOVES - len(moves))
        return {
            **self._loop.memory(),
            **self._estimator.memory(),
            "friction_v": self._observer.state,
            "weighed": (*self._sums_v, float(self._samples), self._planned_kg),
            "target_v": (self._target_v,),
            "moves": [float(number) for move in (*moves, *unused) for number in move],
        }

    def remember(self, memory: Memory) -> None:
        """Go on from moves, loop, observer and estimator; see `LawWithMemory.remember`."""
        self._loop.remember(memory)
        left_v, low_speed_v, command_v = memory["friction_v"]
        self._observer.state = left_v, low_speed_v, command_v
        self._estimator.remember(memory)
        base_sum_v, speed_sum_v, samples, self._planned_kg = memory["weighed"]
        self._sums_v, self._samples = (base_sum_v, speed_sum_v), int(samples)
        (self._target_v,) = memory["target_v"]
        numbers = iter(memory["moves"])
        self._moves = []
        for height_v, payload_kg, count, at in zip(*[numbers] * len(_NO_MOVE), strict=True):
            if count:
                move = plan(self._arm.at(payload_kg), height_v, int(count), self._rate_hz)
                self._moves.append(_Playing(height_v, payload_kg, move, int(at)))
