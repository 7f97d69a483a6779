"""Controller node: answers every sample of the rig with one command of a control law.

The node is a managed node. The law, its gains, the model of its design and the reference are
parameters. A change is checked as a whole and takes effect between two samples. While the node is
not active, the watchdog of the DAQ node holds the drive at zero.
"""

from __future__ import annotations

import math
from importlib import import_module
from importlib.util import find_spec
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_control.loop_setup import MODEL_CHOICES, PARAMETERS, TOPIC
from flexarm_control.models.nominal_models import PREFIX, ModelChoices
from flexarm_control.rig_setup import RigSetup, first_references
from flexarm_control.sample_rate import SampleRate
from flexarm_core.channels import TRAVEL_DEG, is_thesis_arm
from flexarm_core.errors import SettingError
from flexarm_ident.models.control_library import control_library
from flexarm_msgs.msg import LawInForce, PayloadEstimate
from flexarm_msgs.srv import SetReference
from flexarm_node import qos
from flexarm_node.answering_node import AnsweringNode
from flexarm_node.process import run
from flexarm_node.stamps import set_stamp
from flexarm_node.topics.waiting import SharedTopic

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rclpy.publisher import Publisher

    from flexarm_control.following import Following
    from flexarm_control.laws.law_protocol import Memory
    from flexarm_core.rig_description import Track
    from flexarm_core.signals import Sample
    from flexarm_node.answering_node import Answer
    from flexarm_node.topics.handover import DirectHandover

# An unchanged reference is published again, for a recorder that was not yet there when it changed.
_REPEAT_NS = 1_000_000_000
# Shortest time between two estimates of the payload.
_PAYLOAD_NS = 100_000_000
# A stream of set-points that are refused is reported so often.
_REFUSED_S = 5.0
_NOT_ACTIVE = "the controller is not active, activate controller"
_NOT_DRIVING = "no command drives the arm: flexarm status says what holds it"


class _InForce(NamedTuple):
    """Origin of the answers from a sample on, beside the samples."""

    taken_ns: int
    setup: RigSetup
    references: tuple[float, ...]
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
        # Of a rig that nobody gave a set-point: it stays where it is.
        self._references: tuple[float, ...] | None = None
        self._reference_topic: SharedTopic[Any] | None = None
        self.create_service(SetReference, "set_reference", self._on_set_reference)
        self._followed: Following | None = None
        self._trajectories = self._trajectory_action()
        # State of a run, which `begin` resets.
        self._loop = self._setup.loop()
        self._rate = SampleRate()
        self._sent: tuple[float, ...] | None = None
        self._sent_ns = 0
        self._weighed_ns = 0
        self._in_force: _InForce | None = None
        self._drives = True
        self.start_if_asked()

    def commander(self) -> tuple[str, bool]:
        """Return the name of the law, and whether it uses the outputs."""
        return self._setup.law, self._setup.uses_outputs

    def make_topics(self) -> None:
        """Make the topics of the loop."""
        super().make_topics()
        self._reference_topic = SharedTopic(
            self,
            self.codec.reference_type,
            self.codec.reference_topic,
            sent=qos.STATUS_SENT,
            read=qos.NEWEST,
        )
        self._payloads = self.create_publisher(PayloadEstimate, "payload", qos.STATUS)
        self._laws = self.create_publisher(LawInForce, "law", qos.SENT)

    def release_topics(self) -> None:
        """Release the topics."""
        super().release_topics()
        if self._reference_topic is not None:
            self._reference_topic.close()
            self._reference_topic = None
        self.destroy_publisher(self._payloads)
        self.destroy_publisher(self._laws)

    def publishers(self) -> tuple[Publisher, ...]:
        """Return the publishers whose messages a recorder needs in full before a run ends."""
        shared = () if self._reference_topic is None else (self._reference_topic.publisher,)
        return (*super().publishers(), self._laws, *shared)

    def prepare(self) -> None:
        """Prepare a run, and publish the set-point."""
        super().prepare()
        if self.direct is None or not self.direct.waits:
            # A law that is set during the run may need these libraries, and loading them then would
            # cost the loop some periods.
            control_library()
            import_module("scipy.special")
            import_module("scipy.sparse.linalg")
        if self._references is None and is_thesis_arm(self.description):
            self._references = (0.0,)
        self.listen()
        if not self._setup.has_profile:
            # A record needs the set-point in force from its first sample on.
            self._publish_reference()

    def begin(self) -> None:
        """Forget an earlier run of samples."""
        self._loop = self._setup.loop()
        self._loop.reset()
        self._rate.reset()
        self._measured_hz = None
        self._sent = None
        self._sent_ns = 0
        self._weighed_ns = 0
        self._in_force = None
        self._drives = True
        self._followed = None

    def answer(self, sample: Sample) -> Answer:
        """Return the law's answer to the sample and the references at its instant."""
        setup, taken_ns = self._setup, sample.taken_ns
        if self._references is None:
            self._references = first_references(setup, sample)
            self._publish_reference()
        if (followed := self._followed) is not None:
            self._references = followed.references(taken_ns, sample.outputs)
        references = self._references
        self._drives = sample.command_sequence > 0
        self._loop.replace(setup.laws)
        self._measured_hz = self._rate.add(taken_ns) or self._measured_hz
        setup.check_rate(self._measured_hz)
        self._note_law(taken_ns, setup, references, self.upcoming)
        if setup.has_profile:
            references = setup.profile((taken_ns - self.run_start_ns) * 1e-9)
            self._references = references
        return self._loop.step(sample, references)

    def before_command(self, taken_ns: int) -> None:
        """Publish a reference that changes by itself: in virtual time the command ends the sample.

        A record has it from the sample on behind which it was published.
        """
        if self._setup.has_profile or self._followed is not None:
            self._send_reference(taken_ns)

    def answered(self, taken_ns: int) -> None:
        """Publish what is in force for the law, when that is due, and the payload at intervals."""
        self._send_law(taken_ns)
        setup = self._setup
        if setup.payload is None or taken_ns - self._weighed_ns < _PAYLOAD_NS:
            return
        self._weighed_ns = taken_ns
        message = PayloadEstimate(**setup.payload()._asdict())
        set_stamp(message.header.stamp, taken_ns)
        self._payloads.publish(message)

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        unit = self._setup.tracks[0].unit
        yield {"law": self._setup.law, f"set-point {unit}": self._reference_text()}
        yield from super().figures()

    def _note_law(
        self, taken_ns: int, setup: RigSetup, references: tuple[float, ...], command_sequence: int
    ) -> None:
        """Note what the next answer follows from, when it has changed and at intervals."""
        before = self._in_force
        if (
            before is None
            or setup is not before.setup
            or (not setup.has_profile and references != before.references)
            or taken_ns - before.taken_ns >= _REPEAT_NS
        ):
            memory = setup.recorded_memory(self._loop, references)
            self._in_force = _InForce(taken_ns, setup, references, command_sequence, memory)

    def _send_law(self, taken_ns: int) -> None:
        """Publish what was noted for a sample: the command did not wait for it."""
        if self._in_force is None or self._in_force.taken_ns != taken_ns:
            return
        _, setup, references, command_sequence, memory = self._in_force
        message = LawInForce(
            command_sequence=command_sequence,
            run_time_ns=taken_ns - self.run_start_ns,
            reference_v=references[0],
            parameters=setup.text,
            memory_names=list(memory),
            memory_sizes=[len(group) for group in memory.values()],
            memory=list(chain.from_iterable(memory.values())),
        )
        set_stamp(message.header.stamp, taken_ns)
        self._laws.publish(message)

    def _send_reference(self, taken_ns: int) -> None:
        """Publish the reference of a built-in profile, when it has changed and at intervals."""
        if self._references == self._sent and taken_ns - self._sent_ns < _REPEAT_NS:
            return
        self._sent, self._sent_ns = self._references, taken_ns
        self._publish_reference()

    def _on_request(self, values: Mapping[str, Any]) -> None:
        """Check parameters: they make a setup, which is kept, since a design takes time."""
        self._model_choices.check(values)
        accepted = RigSetup.of(values)
        if self.is_answering():
            accepted.check_rate(self._measured_hz)
        self._accepted = accepted
        self._model_choices.take(values)

    def _on_parameters(self, _: Mapping[str, Any]) -> None:
        """Put accepted parameters into force, from the next sample on."""
        before, self._setup = self._setup, self._accepted
        if self.running and self._setup.law != before.law:
            self.declare_commander()

    def _publish_reference(self) -> None:
        if self._reference_topic is not None and self._references is not None:
            self._reference_topic.publish(self.codec.reference_message(self._references))

    def _reference_text(self) -> str:
        """Return the set-points in force; of a rig of several joints, all of them."""
        return ", ".join(f"{each:g}" for each in self._references or ())

    def listen(self) -> None:
        """Take the set-point from the topic."""
        message = None if self._reference_topic is None else self._reference_topic.newest()
        if message is None:
            return
        references = self.codec.references(message)
        if refusal := self._refusal(references):
            self.get_logger().error(refusal, throttle_duration_sec=_REFUSED_S)
            return
        self._followed = None
        self._references = references

    def start_references(self) -> tuple[float, ...]:
        """Return the set-points in force; see `trajectory_action.Controller`."""
        self.listen()
        if self._references is None or not self.is_answering():
            raise SettingError(self._hindrance() or _NOT_DRIVING)
        if refusal := self._refusal(self._references):
            raise SettingError(refusal)
        return self._references

    def follow(self, following: Following) -> None:
        """Follow a trajectory from the next sample on."""
        self._followed = following

    def follows(self, following: Following) -> bool:
        """Return whether the set-points still come from a trajectory."""
        return self._followed is following and self.is_answering()

    def hold(self, following: Following) -> None:
        """Keep the set-points where a trajectory has brought them."""
        if self._followed is following:
            self._followed = None

    def _trajectory_action(self) -> object:
        """Return the server of the action, where an installation of ROS 2 has its message."""
        if find_spec("control_msgs") is None:
            return None
        from flexarm_control.trajectory_action import TrajectoryAction  # noqa: PLC0415

        return TrajectoryAction(self)

    def _on_set_reference(
        self, request: SetReference.Request, response: SetReference.Response
    ) -> SetReference.Response:
        """Take the set-point of a call, and publish it for recorders and viewers."""
        # What came on the topic before is older.
        self.listen()
        place = self._setup.place(request.joint)
        known = self._references or (math.nan,) * len(self._setup.tracks)
        if place is None:
            response.message = f"reference refused: {self._setup.unknown(request.joint)}"
        elif self._references is None and len(known) > 1:
            response.message = (
                "reference refused: the positions of the other joints are not known "
                "yet: start sampling, and send it again"
            )
        else:
            wanted = (*known[:place], request.reference_v, *known[place + 1 :])
            response.message = self._refusal(wanted)
        response.success = not response.message
        if response.success:
            self._followed = None
            self._references = wanted
            self._publish_reference()
            response.message = self._hindrance()
        response.reference_v = (self._references or known)[place or 0]
        return response

    def _hindrance(self) -> str:
        """Return why the arm does not follow the set-point in force; empty when it does."""
        if not self.running:
            return _NOT_ACTIVE
        return self.warning() or ("" if self._drives else _NOT_DRIVING)

    def _refusal(self, references: tuple[float, ...]) -> str:
        """Return why set-points do not come into force; empty when they do."""
        tracks = self._setup.tracks
        if len(references) != len(tracks):
            names = ", ".join(each.name for each in tracks)
            return f"{len(references)} set-points refused: one each for {names}"
        texts = [f"{value:g} {each.unit}" for value, each in zip(references, tracks, strict=True)]
        refused = f"reference {', '.join(texts)} refused: "
        if self.trouble:
            why = f"the controller is not active, {self.trouble}"
            return f"{refused}{why}; then activate controller"
        if self._setup.has_profile:
            values = self.parameters.values()
            if values["trajectory"]:
                return f"{refused}the controller plays a trajectory: set trajectory to nothing"
            name = values["reference"]
            return f"{refused}the controller follows its own, {name}: set reference to {TOPIC}"
        beyond = [
            track
            for value, track in zip(references, tracks, strict=True)
            if not track.low <= value <= track.high
        ]
        return f"{refused}{self._travel(beyond[0])}" if beyond else ""

    def _travel(self, track: Track) -> str:
        """Return the travel of a set-point in words."""
        if is_thesis_arm(self._setup.rig):
            return f"the travel is +-{track.high:.3f} V, {TRAVEL_DEG:g} deg"
        return f"the travel of {track.name} is {track.low:g} to {track.high:g} {track.unit}"


def main() -> int:
    """Run the node."""
    return run(ControllerNode, realtime=True)
