"""Base of managed nodes that answer every sample of a rig with one command."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from typing import TYPE_CHECKING

from flexarm_core.signals import Command
from flexarm_msgs.msg import CommanderInfo
from flexarm_node import qos
from flexarm_node.loop_node import LoopNode
from flexarm_node.stamps import set_stamp
from flexarm_node.statistics import AnswerCount, Window
from flexarm_node.topics.waiting import TopicWaiter, await_acknowledged

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator, Mapping

    from rclpy.publisher import Publisher

    from flexarm_core.signals import Sample
    from flexarm_node.topics.handover import DirectHandover

    Answer = tuple[tuple[float, ...], tuple[float, ...]]

_WAIT_S = 0.1
_SILENT_S = 1.0
_STATISTICS_SAMPLES = 3000


class AnsweringNode(LoopNode):
    """Base of the nodes that command the arm, by a law or by an excitation.

    A subclass computes the commands. This class receives the samples, numbers the commands,
    declares the commander, and collects the figures.
    """

    _heard_s = math.inf
    _taken_ns = 0
    _waiting: Sample | None = None
    direct: DirectHandover | None = None
    """Way from a DAQ node in the same process, whose samples alone are answered then."""

    @property
    def run_start_ns(self) -> int:
        """Stamp of the first sample of the run, ns."""
        return self._count.run_start_ns

    @property
    def upcoming(self) -> int:
        """Number of the next command."""
        return self._count.upcoming

    @abstractmethod
    def commander(self) -> tuple[str, bool]:
        """Return the name of the commander, and whether its commands use the outputs."""

    @abstractmethod
    def begin(self) -> None:
        """Prepare for the first sample of a run, or of a run that begins anew."""

    @abstractmethod
    def answer(self, sample: Sample) -> Answer:
        """Return efforts and compensations of the command that answers a sample.

        The calling thread is that of the loop, or of the DAQ node's loop in the same process.
        """

    def before_command(self, taken_ns: int) -> None:
        """Publish what a record has between a sample and the command that answers it."""

    def answered(self, taken_ns: int) -> None:
        """Do what may wait until the command is sent; see `answer`."""

    def publishers(self) -> tuple[Publisher, ...]:
        """Return the publishers whose messages a recorder must have from a run's begin to end."""
        return (self._commands, self._commander_out)

    def make_topics(self) -> None:
        """Make the topics of the loop."""
        self._count = AnswerCount()
        self._answer_s = Window(_STATISTICS_SAMPLES)
        self._took_s = 0.0
        codec = self.codec
        self._samples = None
        if self.direct is None:
            self._samples = TopicWaiter(self, codec.samples, codec.sample_topic, qos.NEWEST)
        self._commands = self.create_publisher(
            codec.commands.message_type, codec.command_topic, qos.SENT
        )
        self._commander_out = self.create_publisher(CommanderInfo, "commander", qos.STATUS)

    def release_topics(self) -> None:
        """Give the topics back."""
        if self._samples is not None:
            self._samples.close()
        self.destroy_publisher(self._commands)
        self.destroy_publisher(self._commander_out)

    def prepare(self) -> None:
        """Drop an old sample, wait for every reader of what is sent, declare the commander.

        In virtual time a sample that comes meanwhile waits for its answer, and so does the first of
        a run.
        """
        self._waiting = None if self._samples is None else self._samples.wait_newest(0.0)
        if self._waiting is not None and self._waiting.sequence != 1:
            self._waiting = None
        self.await_listeners(*self.publishers(), least=1)
        self.declare_commander()

    def declare_commander(self) -> None:
        """Tell recorders and users which commander is active."""
        name, uses_outputs = self.commander()
        info = CommanderInfo(
            node=self.get_fully_qualified_name(), law=name, uses_outputs=uses_outputs
        )
        set_stamp(info.header.stamp, self.time.now_ns())
        self._commander_out.publish(info)

    def loop(self, stopping: threading.Event) -> None:
        """Answer until told to stop; a count of samples that goes back begins a new run."""
        self._count.restart()
        self._heard_s, self._taken_ns = math.inf, 0
        if self._samples is not None:
            self._answer_topic(self._samples, stopping)
        elif self.direct is not None:
            self._leave_to_the_sampling_thread(self.direct, stopping)
        await_acknowledged(*self.publishers())

    def sampled_ns(self) -> int:
        """Return the stamp of the newest sample; see `LoopNode.sampled_ns`."""
        return self._taken_ns if self._is_heard() else 0

    def is_answering(self) -> bool:
        """Return whether samples are coming and the loop answers them."""
        return self._is_heard() and self.running and not self.trouble

    def warning(self) -> str:
        """Return that the samples have stopped, when they have."""
        if time.monotonic() - self._heard_s < _SILENT_S:
            return ""
        return "no samples any more: is the DAQ node active?"

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        answer = self._answer_s.percentiles()
        yield {
            "answered samples": self._count.answered,
            "skipped periods": self._count.skipped,
            "answer p50 ms": f"{answer.p50 * 1e3:.3f}",
            "answer p99 ms": f"{answer.p99 * 1e3:.3f}",
        }

    def _is_heard(self) -> bool:
        return 0.0 <= time.monotonic() - self._heard_s < _SILENT_S

    def _answer_topic(self, samples: TopicWaiter[Sample], stopping: threading.Event) -> None:
        while not stopping.is_set():
            sample = samples.wait_newest(_WAIT_S if self._waiting is None else 0.0) or self._waiting
            self._waiting = None
            if sample is not None and (answer := self._answer_to(sample)) is not None:
                self._send(answer)
            self.spare_time()

    def _leave_to_the_sampling_thread(
        self, direct: DirectHandover, stopping: threading.Event
    ) -> None:
        def give(sample: Sample) -> None:
            if (answer := self._answer_to(sample)) is not None:
                direct.give(answer, lambda: self._send(answer))

        with direct.answering(give, self.spare_time):
            while not stopping.wait(_WAIT_S):
                direct.check()

    def _answer_to(self, sample: Sample) -> Command | None:
        """Return the answer to a sample; None to one that was answered before."""
        if not self._count.is_new(sample.sequence, sample.taken_ns):
            return None
        received_s = self._heard_s = time.monotonic()
        self._taken_ns = sample.taken_ns
        if self._count.begins(sample.sequence, sample.taken_ns):
            self.begin()
        efforts, compensations = self.answer(sample)
        # Stamped by the sample's clock: in virtual time no other one is the arm's.
        command = Command(
            self._count.next(), sample.sequence, efforts, compensations, sample.taken_ns
        )
        self._took_s = time.monotonic() - received_s
        return command

    def _send(self, command: Command) -> None:
        self.before_command(command.stamp_ns)
        self._commands.publish(self.codec.commands.pack(command))
        self.answered(command.stamp_ns)
        self._answer_s.add(self._took_s)
