"""Watch of a sampled run: the newest sample, stalls, and the figures at its end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message

from flexarm_bringup.graph.figures import Run
from flexarm_core.patience import Patience
from flexarm_msgs.msg import ArmState, IoSample
from flexarm_node import qos
from flexarm_node.loop_node import ENDED
from flexarm_node.stamps import stamp_ns, stamp_text
from flexarm_node.topics.waiting import RawTopicsWaiter

if TYPE_CHECKING:
    from rclpy.node import Node

STALLED_S = 30.0
"""A run with hardly a new sample in this time has stalled."""
_SLOWEST = 10
"""So many samples come within that time however slow the run; in virtual time one whose answer does
not come may take a third of it."""


_SAMPLES = (("state", ArmState), ("io", IoSample))
"""Topics of samples, of which a rig has one, and their types."""


class RunWatch:
    """Watch of one run of the DAQ node at a time.

    It looks at the newest sample when it is asked. An executor would call for every one of them,
    and take as much of the processor as the law.

    Parameters
    ----------
    node : Node
        Node for the readers, in the namespace of the arm; whoever waits spins it.

    Attributes
    ----------
    trouble : str
        What holds the drive at zero or has ended the run, and when, as the node reports it; ""
        while all is well.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._reporter = f"{node.get_namespace().rstrip('/')}/daq"
        self.trouble = ""
        self._states: RawTopicsWaiter | None = None
        self._newest = 0
        self._sampled_s = ""
        self._figures: dict[str, str] | None = None
        self._counted = 0
        self._patience = Patience(STALLED_S)

    def __enter__(self) -> RunWatch:  # noqa: PYI034 - Self needs Python 3.11
        self.trouble = ""
        self.listen()
        self._figures = {}
        topics = [(kind, name, qos.NEWEST) for name, kind in _SAMPLES]
        self._states = RawTopicsWaiter(self._node, topics)
        return self

    def __exit__(self, *_: object) -> None:
        if self._states is not None:
            self._states.close()
            self._states = None
        self._newest = 0

    def listen(self) -> None:
        """Hear the reports of the DAQ node from now on; a run does so by itself."""
        if self._figures is None:
            self._figures = {}
            topic = "/diagnostics"
            self._node.create_subscription(DiagnosticArray, topic, self._on_report, qos.EVERY)

    @property
    def has_ended(self) -> bool:
        """Whether the loop has ended by a failure, which is the trouble then."""
        return self.trouble.startswith(ENDED)

    @property
    def sequence(self) -> int:
        """Number of the newest sample of the run; 0 before the first and between runs."""
        waiting = [] if self._states is None else self._states.wait(0.0)
        if waiting:
            _, kind = _SAMPLES[waiting[-1].topic]
            sample = deserialize_message(waiting[-1].raw, kind)
            self._newest = sample.sequence
            self._sampled_s = stamp_text(stamp_ns(sample.header.stamp))
        return self._newest

    def restart_clock(self) -> None:
        """Count stalls from now on."""
        self._counted, self._patience = 0, Patience(STALLED_S)

    def stall(self) -> str:
        """Return a stall of the run in words, or nothing."""
        newest = self.sequence
        if newest >= self._counted + _SLOWEST:
            self._counted, self._patience = newest, Patience(STALLED_S)
        if not self._patience.is_over:
            return ""
        new = newest - self._counted
        return f"{new} new samples in {self._patience.waited_s:.0f} s after {self._counted}"

    def has_reported(self) -> bool:
        """Return whether the newest figures are those of the run's last sample."""
        figures = self._figures or {}
        # The last sample may have come since the last look.
        is_newest = self.sequence > 0 and figures.get("last sample s") == self._sampled_s
        return is_newest and figures["drive"] == "off"

    def run(self) -> Run:
        """Return the figures of the run, once they have been reported."""
        figures = self._figures or {}
        return Run(
            int(figures["samples"]),
            int(figures["missed periods"]),
            float(figures["real-time factor"]),
            off_rate=figures["off rate"],
            reply_s=1e-3 * float(figures["reply p50 ms"]),
        )

    def _on_report(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._reporter:
                self._figures = {each.key: each.value for each in status.values}
                self.trouble = trouble_in(status) or self.trouble


def trouble_in(status: DiagnosticStatus) -> str:
    """Return what holds the drive or has ended its run by a report, and when; "" without it."""
    if status.level != DiagnosticStatus.ERROR:
        return ""
    trouble = str(status.message).partition(": ")[2]
    after_s = next((each.value for each in status.values if each.key == "held after s"), "")
    return f"{trouble}, after {after_s} s of the run" if after_s else trouble
