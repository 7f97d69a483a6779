"""The controller: answers every sample of `state` with one `command`.

A managed node. The law, its gains and the reference are parameters; a change is checked as a whole
and takes effect between two samples. While the node is not active the DAQ node's watchdog holds the
drive at zero.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from std_msgs.msg import Float64

from flexarm_control.laws.registry import LAWS, build_law, law_rate_hz
from flexarm_control.laws.scheduled import ScheduledPdpc
from flexarm_control.laws.switching import Handover
from flexarm_control.references import REFERENCES, Reference, build_reference
from flexarm_control.sample_rate import SampleRate, suits
from flexarm_core.channels import TRAVEL_V
from flexarm_core.errors import SettingError
from flexarm_core.specs import ParameterSpec
from flexarm_msgs.msg import ArmState, CommanderInfo, MotorCommand, PayloadEstimate
from flexarm_node import qos
from flexarm_node.loop_node import LoopNode
from flexarm_node.process import run
from flexarm_node.stamps import set_stamp, stamp_ns
from flexarm_node.statistics import Window
from flexarm_node.waiting import TopicWaiter

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator, Mapping

    from builtin_interfaces.msg import Time

    from flexarm_control.laws.law import Law

_WAIT_S = 0.1
# A recorder that was not heard of yet when the reference changed learns it so soon.
_TELL_AGAIN_S = 1.0
_PAYLOAD_S = 0.1
_SILENT_S = 1.0
_STATISTICS_SAMPLES = 3000
TOPIC = "topic"
"""The reference comes from the topic `reference` and not from a built-in profile."""


def _declared(prefix: str, specs: tuple[ParameterSpec, ...]) -> list[ParameterSpec]:
    return [replace(spec, name=f"{prefix}.{spec.name}") for spec in specs]


PARAMETERS = (
    ParameterSpec("law", "pd", "the control law", choices=tuple(LAWS)),
    ParameterSpec(
        "reference", TOPIC, "a built-in profile, or the topic", choices=(TOPIC, *REFERENCES)
    ),
    *(spec for name, law in LAWS.items() for spec in _declared(name, law.parameters)),
    *(
        spec
        for name, reference in REFERENCES.items()
        for spec in _declared(name, reference.parameters)
    ),
)
_NAMES = {spec.name for spec in PARAMETERS}


@dataclass(frozen=True)
class Setup:
    """What answers the samples; replaced as a whole, by one assignment.

    Attributes
    ----------
    name, law
        The control law.
    rate_hz
        Sampling rate that it is made for; None when it suits any.
    profile
        The built-in reference, or None when it comes from the topic.
    """

    name: str
    law: Law
    rate_hz: float | None
    profile: Reference | None

    def check_rate(self, measured_hz: float | None) -> None:
        """Raise when the samples come at another rate than the law is made for."""
        if self.rate_hz is None or measured_hz is None or suits(self.rate_hz, measured_hz):
            return
        set_it = f"{self.name}.rate_hz"
        advice = f"set {set_it}" if set_it in _NAMES else "sample at that rate or take another law"
        raise SettingError(
            f"law {self.name} is made for {self.rate_hz:g} Hz and the samples come at "
            f"{measured_hz:.0f} Hz: {advice}"
        )


def _setup(values: Mapping[str, Any]) -> Setup:
    """Build law and reference from the parameters.

    Raises
    ------
    SettingError
        When a value is out of range or the values do not fit together.
    """
    name, reference = values["law"], values["reference"]
    profile = None
    if reference != TOPIC:
        profile = build_reference(reference, _below(reference, values))
    chosen = _below(name, values)
    return Setup(name, build_law(name, chosen), law_rate_hz(name, chosen), profile)


def _below(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    start = prefix + "."
    return {name.removeprefix(start): values[name] for name in values if name.startswith(start)}


class ControllerNode(LoopNode):
    """Wires parameters and topics to a law and a reference."""

    def __init__(self) -> None:
        super().__init__(
            "controller",
            PARAMETERS,
            accept=_setup,
            apply=self._replace,
            expected=(SettingError,),
        )
        self._setup = _setup(self.parameters.values())
        self._reference_v = 0.0
        self._heard_s = math.inf
        self._answered = 0
        self._skipped = 0
        self._answer_s = Window(_STATISTICS_SAMPLES)
        self.start_if_asked()

    def make_topics(self) -> None:
        """Make the topics of the loop."""
        self._states: TopicWaiter[Any] = TopicWaiter(self, ArmState, "state", qos.NEWEST)
        self._commands = self.create_publisher(MotorCommand, "command", qos.SENT)
        self._commander = self.create_publisher(CommanderInfo, "commander", qos.STATUS)
        self._references_out = self.create_publisher(Float64, "reference", qos.STATUS_SENT)
        self._payloads = self.create_publisher(PayloadEstimate, "payload", qos.STATUS)
        self._references_in = self.create_subscription(
            Float64, "reference", self._on_reference, qos.NEWEST
        )

    def release_topics(self) -> None:
        """Give the topics back."""
        self._states.close()
        self.destroy_publisher(self._commands)
        self.destroy_publisher(self._commander)
        self.destroy_publisher(self._references_out)
        self.destroy_publisher(self._payloads)
        self.destroy_subscription(self._references_in)

    def prepare(self) -> None:
        """Wait for every reader of the commands, drop an old sample, tell law and set-point."""
        self.await_listeners(self._commands, least=1)
        self._states.wait_newest(0.0)
        self._declare(self._setup.name)
        if self._setup.profile is None:
            # A record shall have the set-point in force from its first sample on.
            self._references_out.publish(Float64(data=self._reference_v))

    def loop(self, stopping: threading.Event) -> None:
        """Answer until told to stop."""
        last_sequence = 0
        start_ns = 0
        told_v, told_s, weighed_ns = None, 0.0, 0
        command = MotorCommand()
        command.header.frame_id = "flexarm"
        handover = Handover(self._setup.law)
        rate = SampleRate()
        self._heard_s = math.inf
        while not stopping.is_set():
            state = self._states.wait_newest(_WAIT_S)
            if state is None:
                self.spare_time()
                continue
            received_s = self._heard_s = time.monotonic()
            setup = self._setup
            handover.replace(setup.law)
            taken_ns = stamp_ns(state.header.stamp)
            if state.sequence <= last_sequence or last_sequence == 0:
                start_ns, last_sequence, told_v = taken_ns, state.sequence - 1, None
                handover.reset()
                rate.reset()
            self._skipped += state.sequence - last_sequence - 1
            last_sequence = state.sequence
            setup.check_rate(rate.add(taken_ns))
            if setup.profile is not None:
                time_s = (taken_ns - start_ns) * 1e-9
                self._reference_v = setup.profile(time_s)
                if self._reference_v != told_v or time_s - told_s >= _TELL_AGAIN_S:
                    told_v, told_s = self._reference_v, time_s
                    self._references_out.publish(Float64(data=told_v))
            effort = handover.step(
                (state.position_v, state.base_strain_v, state.middle_strain_v, state.speed_v),
                self._reference_v,
            )
            set_stamp(command.header.stamp, self.get_clock().now().nanoseconds)
            command.sequence += 1
            command.state_sequence = state.sequence
            command.effort_v, command.compensation_v = effort
            self._commands.publish(command)
            self._answered += 1
            if isinstance(setup.law, ScheduledPdpc) and taken_ns - weighed_ns >= _PAYLOAD_S * 1e9:
                weighed_ns = taken_ns
                self._tell_payload(setup.law, state.header.stamp)
            self._answer_s.add(time.monotonic() - received_s)
            self.spare_time()
        # A recorder shall have everything before the run counts as ended.
        self.await_acknowledged(self._commands, self._references_out, self._commander)

    def _tell_payload(self, law: ScheduledPdpc, stamp: Time) -> None:
        payload_kg, deviation_kg, detected = law.payload
        message = PayloadEstimate(
            payload_kg=payload_kg, deviation_kg=deviation_kg, detected=detected
        )
        message.header.stamp = stamp
        self._payloads.publish(message)

    def _declare(self, law: str) -> None:
        info = CommanderInfo(node=self.get_fully_qualified_name(), law=law, uses_outputs=True)
        info.header.stamp = self.get_clock().now().to_msg()
        self._commander.publish(info)

    def _replace(self, values: Mapping[str, Any]) -> None:
        before, self._setup = self._setup, _setup(values)
        if self.running and self._setup.name != before.name:
            self._declare(self._setup.name)

    def _on_reference(self, message: Float64) -> None:
        if self._setup.profile is not None:
            return
        if not abs(message.data) <= TRAVEL_V:
            self.get_logger().error(
                f"reference {message.data} V refused: the travel is +-{TRAVEL_V:.3f} V"
            )
            return
        self._reference_v = message.data

    def warning(self) -> str:
        """Return that the samples have stopped, when they have."""
        if time.monotonic() - self._heard_s < _SILENT_S:
            return ""
        return "no samples any more: is the DAQ node active?"

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        answer = self._answer_s.percentiles()
        yield {
            "law": self._setup.name,
            "answered samples": self._answered,
            "skipped periods": self._skipped,
            "answer p50 ms": f"{answer.p50 * 1e3:.3f}",
            "answer p99 ms": f"{answer.p99 * 1e3:.3f}",
        }


def main() -> int:
    """Run the node."""
    return run(ControllerNode, realtime=True)
