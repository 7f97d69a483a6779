"""Topics of the sampling loop: samples and their SI view out, commands in."""

from __future__ import annotations

import json
import time
from array import array
from typing import TYPE_CHECKING

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float32MultiArray, String

from flexarm_core.signals import Sample
from flexarm_daq.nodes.joint_view import joint_view
from flexarm_daq.rigs.rig_protocol import bodies_of
from flexarm_msgs.msg import ChannelInfo
from flexarm_node import qos
from flexarm_node.stamps import beside_steady_clock, set_stamp
from flexarm_node.topics.handover import CommandWaiter
from flexarm_node.topics.waiting import TopicWaiter, await_acknowledged, node_names, wait_until

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from flexarm_core.signals import Command
    from flexarm_daq.loop.exchange import Record
    from flexarm_daq.rigs.rig_protocol import Bodies, Rig
    from flexarm_node.loop_node import LoopNode
    from flexarm_node.topics.handover import DirectHandover

_JOINT_STATES_HZ = 50.0
_CLOCK = "/clock"
_BACKLOG = 2000
"""Samples that a reader may be behind in virtual time: less than it holds."""
_SHARED_REPORTS = 3
"""Reports, one a second, after which another publisher of the time is one that stays."""
_POSES_HZ = 20.0


class TopicLink:
    """Two topics of the loop, used by the sampling thread alone.

    Parameters
    ----------
    node : LoopNode
        Owner of the topics.
    handover : DirectHandover, optional
        Way to a commander in the same process.

    Attributes
    ----------
    newest_ns : int
        Stamp of the newest sample of the run, ns; 0 before the first.
    newest_outputs : tuple of float
        Its outputs; empty before the first.
    """

    def __init__(self, node: LoopNode, handover: DirectHandover | None = None) -> None:
        self._node = node
        self._handover = handover
        codec = node.codec
        self._samples = codec.samples
        self._publisher = node.create_publisher(
            codec.samples.message_type, codec.sample_topic, qos.SENT
        )
        self._channels = node.create_publisher(ChannelInfo, "io_channels", qos.STATUS)
        self._description = node.create_publisher(String, "rig_description", qos.STATUS)
        self._joint_states = node.create_publisher(JointState, "joint_states", qos.SENT)
        # The commands of this process come on the topic too, and must not hide another one.
        heard = TopicWaiter(
            *(node, codec.commands, codec.command_topic),
            qos.NEWEST if handover is None else qos.EVERY,
        )
        self._commands = heard if handover is None else CommandWaiter(handover, heard)
        self._clock: Publisher[Clock] | None = None
        self._shared = 0
        self._now = Clock()
        self._view = joint_view(node.description)
        self._joint = JointState(name=[*self._view.names])
        self._joint.header.frame_id = node.frame
        self._joint_every = 1
        self._bodies = BodyTopics(node)
        self._start_ns = 0
        self.newest_ns = 0
        self.newest_outputs: tuple[float, ...] = ()
        self._unsent: tuple[Sample, Record] | None = None
        self._is_others_turn = False
        self._virtual = False

    def start(
        self, rig: Rig, rate_hz: float, *, virtual: bool, clock: bool, await_commander: bool
    ) -> None:
        """Prepare for a run: match every reader, drop the commands of an earlier run."""
        self._virtual = virtual
        self.newest_ns = 0
        self.newest_outputs = ()
        self._publish_rig()
        if not (virtual and clock):
            self._release_clock()
        elif self._clock is None:
            self._clock = self._node.create_publisher(Clock, _CLOCK, qos.NEWEST)
        if virtual and await_commander and not wait_until(self.has_commander):
            self._node.get_logger().warning("no commander is there: the arm moves on without")
        self._node.await_listeners(self._publisher)
        while self._commands.wait_newest(0.0) is not None:
            pass
        self._joint_every = max(1, round(rate_hz / _JOINT_STATES_HZ))
        self._bodies.start(rig, rate_hz)

    def has_commander(self) -> bool:
        """Return whether a node is there that could send commands."""
        return self._commands.publishers() > 0

    def publish(self, record: Record) -> None:
        """Publish one sample, and the SI view of some samples for its subscribers."""
        if record.sequence == 1:
            # The rig's clock began when it was opened, and the first sample comes later. The node
            # that makes the time of `/clock` cannot follow it.
            clock = self._node.time.now_ns if self._clock is None else time.time_ns
            self._start_ns = record.start_ns(*beside_steady_clock(clock))
        self.newest_ns = self._start_ns + round(record.time_s * 1e9)
        sample = Sample(
            self.newest_ns,
            record.sequence,
            tuple(record.outputs.tolist()),
            record.commands,
            record.compensations,
            record.command_sequence,
        )
        self.newest_outputs = sample.outputs
        if self._handover is None or not self._handover.answers:
            self._send(sample, record)
            return
        self._unsent = sample, record
        self._handover.ask(sample)

    def acted(self) -> None:
        """Publish the sample whose answer has acted, and let the commander publish that."""
        if self._unsent is not None and self._handover is not None:
            unsent, self._unsent = self._unsent, None
            self._send(*unsent)
            self._handover.acted()

    def _send(self, sample: Sample, record: Record) -> None:
        self._publisher.publish(self._samples.pack(sample))
        if self._virtual and record.sequence % _BACKLOG == 0:
            # The arm's time waits for its recorder as well.
            self.await_readers()
        if self._clock is not None and self._clock.get_subscription_count():
            set_stamp(self._now.clock, self.newest_ns)
            self._clock.publish(self._now)
        if record.sequence % self._joint_every == 0 and self._joint_states.get_subscription_count():
            self._publish_joints(record)
        self._bodies.publish(record.sequence)

    def wait(self, timeout_s: float) -> Command | None:
        """Return the newest command, or None when none came in time."""
        until_s = time.monotonic() + timeout_s
        command = None
        if self._unsent is not None:
            command = self._commands.wait_newest(0.0)
        if command is None:
            self.acted()
            command = self._commands.wait_newest(max(0.0, until_s - time.monotonic()))
        return command

    def spare_time(self) -> None:
        """Let the node report its figures, or the commander of this process."""
        self._is_others_turn = self._handover is not None and not self._is_others_turn
        if self._handover is not None and self._is_others_turn:
            self._handover.spare_time()
        else:
            self._node.spare_time()

    def commanders(self) -> list[str]:
        """Return the nodes that could send commands; a killed node stays listed for a while."""
        return node_names(self._node.get_publishers_info_by_topic(self._commands.topic))

    def share_clock(self) -> None:
        """Leave `/clock` to the first by name of several: their times would take turns."""
        if self._clock is None:
            return
        own = self._node.get_fully_qualified_name()
        publishers = node_names(self._node.get_publishers_info_by_topic(_CLOCK))
        others = [name for name in publishers if name != own]
        if others and others[0] < own:
            self._release_clock()
            self._node.get_logger().info(
                f"{_CLOCK} is left to {others[0]}: nodes with use_sim_time follow the time of that "
                f"arm; for this one's own, start its nodes with -r {_CLOCK}:=NAMESPACE{_CLOCK}"
            )
            return
        self._shared = self._shared + 1 if others else 0
        # Another arm leaves it with its next report.
        if self._shared == _SHARED_REPORTS:
            self._node.get_logger().warning(
                f"{_CLOCK} is published by {', '.join(others)} too: "
                "end that, or set clock=false before the next run of this node"
            )

    def await_readers(self) -> None:
        """Wait until every reader has every sample."""
        await_acknowledged(self._publisher)

    def close(self) -> None:
        """Release the topics."""
        self._commands.close()
        self._release_clock()
        self._node.destroy_publisher(self._publisher)
        self._node.destroy_publisher(self._joint_states)
        self._node.destroy_publisher(self._channels)
        self._node.destroy_publisher(self._description)
        self._bodies.close()

    def _release_clock(self) -> None:
        if self._clock is not None:
            self._node.destroy_publisher(self._clock)
            self._clock = None

    def _publish_joints(self, record: Record) -> None:
        joint = self._joint
        set_stamp(joint.header.stamp, self.newest_ns)
        joint.position, joint.velocity, joint.effort = self._view.of(
            record.outputs.tolist(), record.commands
        )
        self._joint_states.publish(joint)

    def _publish_rig(self) -> None:
        """Publish what the signals mean, for recorders and latecomers."""
        rig = self._node.description
        info = ChannelInfo(
            sampling_rate_hz=rig.rate_hz,
            input_names=list(rig.input_names),
            input_units=[each.unit for each in rig.inputs],
            output_names=list(rig.output_names),
            output_units=[each.unit for each in rig.outputs],
            source=rig.name,
        )
        info.header.frame_id = self._node.frame
        set_stamp(info.header.stamp, self._node.time.now_ns())
        self._channels.publish(info)
        self._description.publish(String(data=rig.text))


class BodyTopics:
    """Topics `bodies` and `body_poses`, silent for a rig without bodies.

    A pose is a row of seven numbers, as of `Bodies.poses`: as `geometry_msgs/PoseArray` it would
    take ten times as long, in the thread that samples.

    Parameters
    ----------
    node : LoopNode
        Owner of the topics.
    """

    def __init__(self, node: LoopNode) -> None:
        self._node = node
        self._solids = node.create_publisher(String, "bodies", qos.STATUS)
        self._poses = node.create_publisher(Float32MultiArray, "body_poses", qos.NEWEST)
        self._bodies: Bodies | None = None
        self._every = 1

    def start(self, rig: Rig, rate_hz: float) -> None:
        """Prepare for a run."""
        self._bodies = bodies_of(rig)
        self._every = max(1, round(rate_hz / _POSES_HZ))

    def publish(self, sequence: int) -> None:
        """Publish what is due with a sample of the open rig."""
        if self._bodies is None:
            return
        if sequence == 1:
            self._solids.publish(String(data=json.dumps(self._bodies.solids())))
        if sequence % self._every == 0 and self._poses.get_subscription_count():
            poses = array("f", self._bodies.poses().ravel())
            self._poses.publish(Float32MultiArray(data=poses))

    def close(self) -> None:
        """Release the topics."""
        self._node.destroy_publisher(self._solids)
        self._node.destroy_publisher(self._poses)
