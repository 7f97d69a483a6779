"""Processes around the real cores: a commander, and what all of them have in common."""

from __future__ import annotations

import math
from random import Random
from typing import TYPE_CHECKING

from bench.schedules.messages import COMMAND, COMMANDER, Answer, Raw, command_bytes, commander_bytes
from flexarm_control.laws.registry import LAWS, build_law
from flexarm_control.laws.switching import Handover
from flexarm_control.references import build_reference
from flexarm_control.sample_rate import SampleRate
from flexarm_core.signals import Command
from flexarm_daq.experiments.excitation import EXCITATIONS
from flexarm_node.statistics import AnswerCount

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.schedules.messages import State
    from bench.schedules.world import Link, World

_EXPERIMENT_V = 3.0
# Share of the commands that repeat the number before, and of those that a silence follows.
_REPEATED = 0.6
_SILENT = 0.6
# A set-point that never lets the arm rest, so that the drive is at zero only when it is set there.
_RESTLESS = {"amplitude_v": 3.0, "period_s": 0.7}


class Killed(BaseException):
    """A process was killed while it worked."""


class Process:
    """Process that can be stalled and killed.

    Attributes
    ----------
    alive : bool
        False after it was killed.
    stalled_until_s : float
        End of its last stall.
    """

    def __init__(self, world: World) -> None:
        self.world = world
        self.alive = True
        self.stalled_until_s = -math.inf

    @property
    def stalled(self) -> bool:
        """True while the process stands still."""
        return self.world.now_s < self.stalled_until_s

    def stall(self, length_s: float) -> None:
        """Let the process stand still for a while."""
        self.stalled_until_s = max(self.stalled_until_s, self.world.now_s + length_s)


class Law:
    """A law after a built-in reference: what a controller computes."""

    uses_outputs = True

    def __init__(self, name: str) -> None:
        self.name = name
        self._law = build_law(name)
        self._handover = Handover(self._law)
        self._rate = SampleRate()
        self._rate_hz = LAWS[name].rate_hz({})
        self._profile = build_reference("square", _RESTLESS)

    def replace(self, name: str) -> None:
        """Take another law from the next sample on."""
        self.name = name
        self._law = build_law(name)

    def begin(self) -> None:
        """Forget an earlier run of samples."""
        self._handover.replace(self._law)
        self._handover.reset()
        self._rate.reset()

    def answer(self, state: State, time_s: float) -> tuple[float, float]:
        """Return effort and compensation, V."""
        self._handover.replace(self._law)
        self._rate.add(state.stamp_ns)
        return self._handover.step(state.volts, self._profile(time_s), state.drive)


class Waveform:
    """A waveform: what an experiment computes."""

    uses_outputs = False

    def __init__(self, name: str, seed: int) -> None:
        self.name = name
        self._excitation = EXCITATIONS[name](_EXPERIMENT_V, seed)

    def begin(self) -> None:
        """Begin again from the start."""
        self._excitation.reset()

    def answer(self, state: State, time_s: float) -> tuple[float, float]:
        """Return effort and compensation, V."""
        return self._excitation.step(time_s, state.volts[0]), 0.0


class Commander(Process):
    """Node that answers every sample, with a law or a waveform.

    Parameters
    ----------
    world : World
        Its time.
    sender : str
        Its name.
    work : Law or Waveform
        What it computes.
    links : tuple of Link
        Ways of its commands to the loop and to the recorder.
    count : int
        Commands that it has sent before.
    """

    def __init__(
        self,
        world: World,
        sender: str,
        work: Law | Waveform,
        links: tuple[Link, Link],
        count: int = 0,
    ) -> None:
        super().__init__(world)
        self.work = work
        self._sender = sender
        self._to_daq, self._to_recorder = links
        self._count = AnswerCount()
        self._before = count
        self._waiting: State | None = None
        self._random = Random(sender)  # noqa: S311 - not for secrets
        self._repeats_until_s = self._silent_until_s = -math.inf
        self._silence_s = 0.0

    def declare(self, send: Callable[[Raw], None]) -> None:
        """Tell a recorder which commander is active."""
        now_ns = self.world.wall_ns()
        raw = commander_bytes(
            now_ns, self._sender, self.work.name, uses_outputs=self.work.uses_outputs
        )
        send(Raw(COMMANDER, raw, now_ns, self.world.now_s))

    def repeat(self, silence_s: float, length_s: float) -> None:
        """Repeat numbers for a while, and be silent after each command."""
        self._silence_s, self._repeats_until_s = silence_s, self.world.now_s + length_s

    def receive(self, state: State) -> None:
        """Take a sample: the newest one waits until the process runs."""
        if not self.alive:
            return
        if not self.stalled:
            self._answer(state)
            return
        if self._waiting is None:
            self.world.at(self.stalled_until_s, self._resume)
        self._waiting = state

    def _resume(self) -> None:
        state, self._waiting = self._waiting, None
        if state is not None:
            self.receive(state)

    def _answer(self, state: State) -> None:
        count, repeats = self._count, self.world.now_s < self._repeats_until_s
        if self.world.now_s < self._silent_until_s:
            return
        if not count.is_new(state.sequence, state.stamp_ns):
            return
        if count.begins(state.sequence, state.stamp_ns):
            self.work.begin()
        effort_v, compensation_v = self.work.answer(
            state, (state.stamp_ns - count.run_start_ns) * 1e-9
        )
        now_ns = self.world.wall_ns()
        if repeats and self._random.random() < _REPEATED:
            self._before -= 1
        if repeats and self._random.random() < _SILENT:
            self._silent_until_s = self.world.now_s + self._silence_s
        number = max(0, self._before + count.next())
        command = Command(number, state.sequence, (effort_v,), (compensation_v,), now_ns)
        self._to_daq.send(Answer(self._sender, command))
        self._to_recorder.send(Raw(COMMAND, command_bytes(command), now_ns, self.world.now_s))
