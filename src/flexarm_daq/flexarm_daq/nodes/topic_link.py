"""Topics of the sampling loop: samples and their SI view out, commands in."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from flexarm_core.channels import CHANNELS, COMMAND, DRIVE_A_PER_V
from flexarm_daq.loop.commander import Command
from flexarm_daq.rigs.arm_shape import BEND_JOINTS, HUB, bend_angles
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_msgs.msg import ArmState, MotorCommand
from flexarm_node import qos
from flexarm_node.node_time import beside_steady_clock
from flexarm_node.stamps import joined_ns, set_stamp, stamp_members
from flexarm_node.topics.handover import CommandWaiter
from flexarm_node.topics.layout import Layout
from flexarm_node.topics.waiting import TopicWaiter, await_acknowledged, node_names, wait_until

if TYPE_CHECKING:
    from rclpy.publisher import Publisher

    from flexarm_daq.loop.exchange import Record
    from flexarm_node.loop_node import LoopNode
    from flexarm_node.topics.handover import DirectHandover
    from flexarm_node.topics.layout import Numbers

_POSITION, _, _, _SPEED = CHANNELS
_ARM = RigParameters()
_TORQUE_NM_PER_A = _ARM.motor_gain_nm_per_v / DRIVE_A_PER_V
_BEND_ANGLES = bend_angles(_ARM)
_UNKNOWN = [math.nan] * len(BEND_JOINTS)
"""Speed and torque of a virtual joint: no sensor tells them."""
_JOINT_STATES_HZ = 50.0
_CLOCK = "/clock"
_BACKLOG = 2000
"""Samples that a reader may be behind in virtual time: less than it holds."""
_SHARED_REPORTS = 3
"""Reports, one a second, after which another publisher of the time is one that stays."""


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
    """

    def __init__(self, node: LoopNode, handover: DirectHandover | None = None) -> None:
        self._node = node
        self._handover = handover
        self._publisher = node.create_publisher(ArmState, "state", qos.SENT)
        self._joint_states = node.create_publisher(JointState, "joint_states", qos.SENT)
        frame = {"header.frame_id": node.frame}
        self._layout = Layout(ArmState, frame)
        commands = Layout(MotorCommand, frame)
        self._commands = (
            TopicWaiter(node, commands, "command", qos.NEWEST)
            if handover is None
            # Its own commands come there too, and must not hide another one.
            else CommandWaiter(handover, TopicWaiter(node, commands, "command", qos.EVERY))
        )
        self._clock: Publisher[Clock] | None = None
        self._shared = 0
        self._now = Clock()
        self._joint = JointState(name=[HUB, *BEND_JOINTS])
        self._joint.header.frame_id = node.frame
        self._joint_every = 1
        self._start_ns = 0
        self.newest_ns = 0
        self._unsent: tuple[Numbers, Record] | None = None
        self._is_others_turn = False
        self._virtual = False

    def start(self, rate_hz: float, *, virtual: bool, clock: bool, await_commander: bool) -> None:
        """Prepare for a run: match every reader, drop the commands of an earlier run."""
        self._virtual = virtual
        self.newest_ns = 0
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
        state = (
            *stamp_members(self.newest_ns),
            record.sequence,
            *record.volts.tolist(),
            record.command_v,
            record.compensation_v,
            record.command_sequence,
        )
        sample = self._layout.named(*state)
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

    def _send(self, sample: Numbers, record: Record) -> None:
        self._publisher.publish(self._layout.pack(*sample))
        if self._virtual and record.sequence % _BACKLOG == 0:
            # The arm's time waits for its recorder as well.
            self.await_readers()
        if self._clock is not None and self._clock.get_subscription_count():
            set_stamp(self._now.clock, self.newest_ns)
            self._clock.publish(self._now)
        if record.sequence % self._joint_every == 0 and self._joint_states.get_subscription_count():
            self._publish_joints(record)

    def wait(self, timeout_s: float) -> Command | None:
        """Return the newest command, or None when none came in time."""
        until_s = time.monotonic() + timeout_s
        message = None
        if self._unsent is not None:
            message = self._commands.wait_newest(0.0)
        if message is None:
            self.acted()
            message = self._commands.wait_newest(max(0.0, until_s - time.monotonic()))
        if message is None:
            return None
        return Command(
            message.sequence,
            message.state_sequence,
            message.effort_v,
            message.compensation_v,
            joined_ns(message.header_stamp_sec, message.header_stamp_nanosec),
        )

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

    def _release_clock(self) -> None:
        if self._clock is not None:
            self._node.destroy_publisher(self._clock)
            self._clock = None

    def _publish_joints(self, record: Record) -> None:
        joint = self._joint
        set_stamp(joint.header.stamp, self.newest_ns)
        position_v, *strains_v, speed_v = record.volts.tolist()
        joint.position = [_POSITION.to_si(position_v), *(_BEND_ANGLES @ strains_v)]
        joint.velocity = [_SPEED.to_si(speed_v), *_UNKNOWN]
        joint.effort = [COMMAND.to_si(record.command_v) * _TORQUE_NM_PER_A, *_UNKNOWN]
        self._joint_states.publish(joint)
