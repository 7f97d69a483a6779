"""Controller node: answers every sample of `state` with one `command` of a control law.

The node is a managed node. The law, its gains, the model of its design and the reference are
parameters. A change is checked as a whole and takes effect between two samples. While the node is
not active, the watchdog of the DAQ node holds the drive at zero.
"""

from __future__ import annotations

from importlib import import_module
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

from std_msgs.msg import Float64

from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.switching import Handover
from flexarm_control.loop_setup import MODEL_CHOICES, PARAMETERS, TOPIC, Setup
from flexarm_control.models.chosen_model import PREFIX, ModelChoices
from flexarm_control.sample_rate import SampleRate
from flexarm_core.channels import TRAVEL_DEG, TRAVEL_V
from flexarm_core.errors import SettingError
from flexarm_msgs.msg import LawInForce, PayloadEstimate
from flexarm_msgs.srv import SetReference
from flexarm_node import qos
from flexarm_node.answering_node import AnsweringNode
from flexarm_node.process import run
from flexarm_node.stamps import set_stamp
from flexarm_node.topics.shared_topic import SharedTopic

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rclpy.publisher import Publisher

    from flexarm_control.laws.law_protocol import Effort, Memory
    from flexarm_node.topics.handover import DirectHandover
    from flexarm_node.topics.layout import Numbers

# An unchanged reference is published again, for a recorder that was not yet there when it changed.
_TELL_AGAIN_NS = 1_000_000_000
# Shortest time between two estimates of the payload.
_PAYLOAD_NS = 100_000_000
# A stream of set-points that are refused is told so often.
_REFUSED_S = 5.0
_NOT_ACTIVE = "the controller is not active, activate controller"
_NOT_DRIVING = "no command drives the arm: flexarm status says what holds it"


class _InForce(NamedTuple):
    """Origin of the answers from a sample on, beside the samples."""

    taken_ns: int
    setup: Setup
    reference_v: float
    command_sequence: int
    memory: Memory


class ControllerNode(AnsweringNode):
    """Node that connects parameters and topics to a law and a reference.

    Samples and set-points of the topic arrive in the thread of the loop, parameters, calls and
    transitions in that of the executor. The two share the setup and the reference, each replaced by
    one assignment.

    Parameters
    ----------
    direct : DirectHandover, optional
        Way from a DAQ node in the same process.
    cli_args : sequence of str
        ROS arguments of this node alone.
    """

    _measured_hz: float | None = None

    def __init__(self, direct: DirectHandover | None = None, cli_args: Sequence[str] = ()) -> None:
        self.direct = direct
        self._model_choices = ModelChoices(MODEL_CHOICES)
        super().__init__(
            "controller",
            PARAMETERS,
            open_group=PREFIX,
            accept=self._on_request,
            apply=self._on_parameters,
            expected=(SettingError,),
            cli_args=cli_args,
        )
        self._setup = self._accepted
        self._reference_v = 0.0
        self._references: SharedTopic[Float64] | None = None
        self.create_service(SetReference, "set_reference", self._on_set_reference)
        # State of a run, which `begin` resets.
        self._handover = Handover(self._setup.law)
        self._rate = SampleRate()
        self._told_v: float | None = None
        self._told_ns = 0
        self._weighed_ns = 0
        self._in_force: _InForce | None = None
        self._drives = True
        self.start_if_asked()

    def commander(self) -> tuple[str, bool]:
        """Return the name of the law, and whether it uses the outputs."""
        law_spec = self._setup.law_spec
        return law_spec.name, bool(law_spec.uses_outputs)

    def make_topics(self) -> None:
        """Make the topics of the loop."""
        super().make_topics()
        self._references = SharedTopic(
            self,
            Float64,
            "reference",
            sent=qos.STATUS_SENT,
            read=qos.NEWEST,
        )
        self._payloads = self.create_publisher(PayloadEstimate, "payload", qos.STATUS)
        self._laws = self.create_publisher(LawInForce, "law", qos.SENT)

    def release_topics(self) -> None:
        """Release the topics."""
        super().release_topics()
        if self._references is not None:
            self._references.close()
            self._references = None
        self.destroy_publisher(self._payloads)
        self.destroy_publisher(self._laws)

    def publishers(self) -> tuple[Publisher, ...]:
        """Return the publishers whose messages a recorder needs in full before a run ends."""
        shared = () if self._references is None else (self._references.publisher,)
        return (*super().publishers(), self._laws, *shared)

    def prepare(self) -> None:
        """Prepare a run, and publish the set-point."""
        super().prepare()
        if self.direct is None or not self.direct.waits:
            # A law that is set during the run may need this library, and loading it then would
            # cost the loop some periods.
            import_module("control")
        self.listen()
        if self._setup.profile is None:
            # A record needs the set-point in force from its first sample on.
            self._publish_reference()

    def begin(self) -> None:
        """Forget an earlier run of samples."""
        self._handover.replace(self._setup.law)
        self._handover.reset()
        self._rate.reset()
        self._measured_hz = None
        self._told_v = None
        self._told_ns = 0
        self._weighed_ns = 0
        self._in_force = None
        self._drives = True

    def answer(self, state: Numbers, taken_ns: int) -> Effort:
        """Return the law's answer to the sample and the reference at its instant."""
        setup, reference_v = self._setup, self._reference_v
        self._drives = state.command_sequence > 0
        self._handover.replace(setup.law)
        self._measured_hz = self._rate.add(taken_ns) or self._measured_hz
        setup.check_rate(self._measured_hz)
        self._note_law(taken_ns, setup, reference_v, self.upcoming)
        if setup.profile is not None:
            self._reference_v = reference_v = setup.profile((taken_ns - self.run_start_ns) * 1e-9)
        volts = (state.position_v, state.base_strain_v, state.middle_strain_v, state.speed_v)
        drive = DriveCommand(state.command_v, state.compensation_v)
        return self._handover.step(volts, reference_v, drive)

    def before_command(self, taken_ns: int) -> None:
        """Publish the reference of a built-in profile: in virtual time the command ends the sample.

        A record has it from the sample on behind which it was published.
        """
        if self._setup.profile is not None:
            self._tell_reference(taken_ns)

    def answered(self, taken_ns: int) -> None:
        """Publish what is in force for the law, when that is due, and the payload at intervals."""
        self._tell_law(taken_ns)
        setup = self._setup
        if setup.payload is None or taken_ns - self._weighed_ns < _PAYLOAD_NS:
            return
        self._weighed_ns = taken_ns
        message = PayloadEstimate(**setup.payload()._asdict())
        set_stamp(message.header.stamp, taken_ns)
        self._payloads.publish(message)

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        yield {"law": self._setup.law_spec.name, "set-point V": f"{self._reference_v:g}"}
        yield from super().figures()

    def _note_law(
        self, taken_ns: int, setup: Setup, reference_v: float, command_sequence: int
    ) -> None:
        """Note what the next answer follows from, when it has changed and at intervals."""
        before = self._in_force
        if (
            before is None
            or setup is not before.setup
            or (setup.profile is None and reference_v != before.reference_v)
            or taken_ns - before.taken_ns >= _TELL_AGAIN_NS
        ):
            memory = self._handover.memory()
            self._in_force = _InForce(taken_ns, setup, reference_v, command_sequence, memory)

    def _tell_law(self, taken_ns: int) -> None:
        """Publish what was noted for a sample: the command did not wait for it."""
        if self._in_force is None or self._in_force.taken_ns != taken_ns:
            return
        _, setup, reference_v, command_sequence, memory = self._in_force
        message = LawInForce(
            command_sequence=command_sequence,
            run_time_ns=taken_ns - self.run_start_ns,
            reference_v=reference_v,
            parameters=setup.text,
            memory_names=list(memory),
            memory_sizes=[len(group) for group in memory.values()],
            memory=list(chain.from_iterable(memory.values())),
        )
        set_stamp(message.header.stamp, taken_ns)
        self._laws.publish(message)

    def _tell_reference(self, taken_ns: int) -> None:
        """Publish the reference of a built-in profile, when it has changed and at intervals."""
        if self._reference_v == self._told_v and taken_ns - self._told_ns < _TELL_AGAIN_NS:
            return
        self._told_v, self._told_ns = self._reference_v, taken_ns
        self._publish_reference()

    def _on_request(self, values: Mapping[str, Any]) -> None:
        """Check parameters: they make a setup, which is kept, since a design takes time."""
        self._model_choices.check(values)
        accepted = Setup.of(values)
        if self.is_answering():
            accepted.check_rate(self._measured_hz)
        self._accepted = accepted
        self._model_choices.take(values)

    def _on_parameters(self, _: Mapping[str, Any]) -> None:
        """Put accepted parameters into force, from the next sample on."""
        before, self._setup = self._setup, self._accepted
        if self.running and self._setup.law_spec is not before.law_spec:
            self.declare_commander()

    def _publish_reference(self) -> None:
        if self._references is not None:
            self._references.publish(Float64(data=self._reference_v))

    def listen(self) -> None:
        """Take the set-point from the topic."""
        message = None if self._references is None else self._references.newest()
        if message is None:
            return
        if refusal := self._refusal(message.data):
            self.get_logger().error(refusal, throttle_duration_sec=_REFUSED_S)
            return
        self._reference_v = message.data

    def _on_set_reference(
        self, request: SetReference.Request, response: SetReference.Response
    ) -> SetReference.Response:
        """Take the set-point of a call, and publish it for recorders and viewers."""
        # What came on the topic before is older.
        self.listen()
        response.message = self._refusal(request.reference_v)
        response.success = not response.message
        if response.success:
            self._reference_v = request.reference_v
            self._publish_reference()
            response.message = self._hindrance()
        response.reference_v = self._reference_v
        return response

    def _hindrance(self) -> str:
        """Return why the arm does not follow the set-point in force; empty when it does."""
        if not self.running:
            return _NOT_ACTIVE
        return self.warning() or ("" if self._drives else _NOT_DRIVING)

    def _refusal(self, reference_v: float) -> str:
        """Return why a set-point does not come into force; empty when it does."""
        refused = f"reference {reference_v:g} V refused: "
        if self.trouble:
            why = f"the controller is not active, {self.trouble}"
            return f"{refused}{why}; then activate controller"
        if self._setup.profile is not None:
            values = self.parameters.values()
            if values["trajectory"]:
                return f"{refused}the controller plays a trajectory: set trajectory to nothing"
            name = values["reference"]
            return f"{refused}the controller follows its own, {name}: set reference to {TOPIC}"
        if not abs(reference_v) <= TRAVEL_V:
            return f"{refused}the travel is +-{TRAVEL_V:.3f} V, {TRAVEL_DEG:g} deg"
        return ""


def main() -> int:
    """Run the node."""
    return run(ControllerNode, realtime=True)
