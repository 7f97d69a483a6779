"""The DAQ driver: samples the rig, publishes `state`, lets commands act, reports on itself.

A managed node. Configuring checks the parameters and makes the topics, activating starts the
sampling, deactivating stops it with the drive at zero.
"""

from __future__ import annotations

import time
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock as SystemClock
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from flexarm_core.channels import CHANNEL_NAMES, CHANNELS, COMMAND, DRIVE_A_PER_V
from flexarm_core.errors import SettingError
from flexarm_core.specs import ParameterSpec
from flexarm_daq.loop.acquisition import Acquisition, LockStep, Record
from flexarm_daq.loop.commander import Command, Verdict
from flexarm_daq.loop.limiter import LIMITS, Limiter, LimiterSettings
from flexarm_daq.loop.safety import COUNTED
from flexarm_daq.loop.self_test import run_self_test
from flexarm_daq.loop.sensor_check import SensorCheck, SensorLimits
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.nodes.rig_choice import RIG_PARAMETERS, is_virtual, make_rig, wants_self_test
from flexarm_daq.rigs.faulty import Fault, FaultyRig
from flexarm_daq.rigs.rig import Rig, RigError
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_daq.rigs.simulated import SimulatedRig
from flexarm_msgs.msg import ArmState, MotorCommand
from flexarm_node import qos
from flexarm_node.loop_node import LoopNode, wait_until
from flexarm_node.process import run
from flexarm_node.stamps import set_stamp, stamp_ns, stamp_text
from flexarm_node.statistics import Rate
from flexarm_node.waiting import TopicWaiter

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator, Mapping

    from rclpy.publisher import Publisher

_NO_FAULT = "none"

PARAMETERS = (
    *RIG_PARAMETERS,
    ParameterSpec("rate_hz", 300.0, "sampling rate", 10.0, 2000.0, "Hz"),
    ParameterSpec("samples", 0, "deactivate after that many periods; 0: never", 0, 2**40),
    ParameterSpec(
        "real_time_factor",
        1.0,
        "virtual time: its pace, 0.01 or more; 0: as fast as the answers come",
        0.0,
        100.0,
    ),
    # Under settings of the user's own the middleware may repeat a lost message only after 3 s.
    ParameterSpec(
        "answer_timeout_s", 5.0, "virtual time: how long a sample waits", 0.01, 60.0, "s"
    ),
    ParameterSpec(
        "await_commander",
        default=False,
        description="virtual time: activating waits for a commander, some seconds, and the first"
        " sample for its answer",
    ),
    ParameterSpec("max_command_v", 10.0, "limiter: largest command", 0.1, 10.0, "V"),
    ParameterSpec(
        "max_slew_v_per_s", 6000.0, "limiter: fastest change of the command", 1.0, 1e6, "V/s"
    ),
    ParameterSpec("position_bound_v", 6.5, "limiter: no outward command beyond", 0.1, 10.0, "V"),
    ParameterSpec("statistics_s", 10.0, "how long the percentiles look back", 1.0, 7200.0, "s"),
    ParameterSpec("max_age_periods", 3, "watchdog: periods without an answer until zero", 1, 1000),
    ParameterSpec(
        "stuck_samples",
        SensorLimits().stuck_samples,
        "sensor check: equal readings in a row that mean a stuck sensor; 0: never",
        0,
        2**31 - 1,
    ),
    ParameterSpec(
        "fault",
        _NO_FAULT,
        "simulated rig: a fault to inject",
        choices=(_NO_FAULT, *(fault.value for fault in Fault)),
    ),
    ParameterSpec(
        "fault_after_samples", 0, "simulated rig: samples before the fault sets in", 0, 2**31 - 1
    ),
    ParameterSpec(
        "fault_channel",
        CHANNEL_NAMES[0],
        "simulated rig: the sensor of a sensor fault",
        choices=CHANNEL_NAMES,
    ),
)

_LIVE = ("payload_kg", *(field.name for field in fields(LimiterSettings)))
"""Parameters that may change while the loop runs, and act at once."""
_POSITION, _, _, _SPEED = CHANNELS
_TORQUE_NM_PER_A = RigParameters().motor_gain_nm_per_v / DRIVE_A_PER_V
_JOINT_STATES_HZ = 50.0
_SILENT_S = 1.0
_SLOWEST_PACE = 0.01


class DaqNode(LoopNode):
    """Wires parameters, topics and services to an `Acquisition`."""

    # Parameters are checked before the rest of the node is there.
    _acquisition: Acquisition | None = None

    def __init__(self) -> None:
        super().__init__(
            "daq",
            PARAMETERS,
            accept=self._accept,
            apply=self._on_changed,
            expected=(RigError,),
        )
        self._rig: Rig | None = None
        self.create_service(Trigger, "emergency_stop", self._on_emergency_stop)
        self.start_if_asked()

    def make_topics(self) -> None:
        """Make the topics of the loop."""
        self._link = _TopicLink(self)

    def release_topics(self) -> None:
        """Give the topics back."""
        self._link.close()

    def prepare(self) -> None:
        """Build the rig, and wait until everybody who listens will get the first sample."""
        values = self.parameters.values()
        rig, settings = _rig_and_limits(values)
        self._rig = rig
        virtual = is_virtual(values)
        if wants_self_test(values):
            run_self_test(rig, Limiter(settings), values["rate_hz"], paced=not virtual)
            self.get_logger().info("self-test: every channel answers with the right sign")
        self._link.start(
            values["rate_hz"], virtual=virtual, await_commander=values["await_commander"]
        )
        lockstep = LockStep(
            values["real_time_factor"],
            values["answer_timeout_s"],
            is_answered=self._link.has_commander(),
        )
        self._rate = Rate()
        self._acquisition = Acquisition(
            rig,
            Limiter(settings),
            Watchdog(1.0 / values["rate_hz"], values["max_age_periods"]),
            SensorCheck(values["rate_hz"], _sensor_limits(values)),
            self._link,
            rate_hz=values["rate_hz"],
            samples=values["samples"],
            paced_by_rig=values["rig"] != "simulated",
            lockstep=lockstep if virtual else None,
            statistics_s=values["statistics_s"],
        )

    def loop(self, stopping: threading.Event) -> None:
        """Sample until told to stop, or until all samples are taken."""
        assert self._acquisition is not None  # noqa: S101 - prepared before
        try:
            self._acquisition.run(stopping)
            self.get_logger().info(f"{self._acquisition.taken} samples, the drive is at zero")
        finally:
            if not stopping.is_set():
                self._link.await_readers()

    def alarm(self) -> str:
        """Return why the drive is held at zero, or was to the end of the run."""
        assert self._acquisition is not None  # noqa: S101 - asked only in and after a run
        reason = self._acquisition.safety.reason
        return f"the drive is held at zero: {reason}" if reason else ""

    def warning(self) -> str:
        """Return that the commands have stopped, when they have."""
        acquisition = self._acquisition
        assert acquisition is not None  # noqa: S101 - asked only while the loop runs
        answered = acquisition.commander.answered
        rate_hz = self.parameters.values()["rate_hz"]
        if not answered or acquisition.sequence - answered < _SILENT_S * rate_hz:
            return ""
        return f"no command since the one for sample {answered}: the drive is at zero"

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        acquisition = self._acquisition
        assert acquisition is not None  # noqa: S101 - asked only while the loop runs
        rate_hz = self._rate.update(acquisition.taken, time.monotonic())
        safety, verdicts = acquisition.safety, acquisition.commander.verdicts
        yield {
            "drive": safety.state.value,
            "last sample s": self._link.newest_s,
            "samples": acquisition.taken,
            "rate Hz": f"{rate_hz:.1f}",
            "real-time factor": f"{acquisition.real_time_factor:.3f}",
            "missed periods": acquisition.missed,
            "unanswered samples": acquisition.unanswered,
            "refused commands": acquisition.refused,
            **{
                f"refused commands: {verdict.value}": verdicts[verdict]
                for verdict in Verdict
                if verdict is not Verdict.ACCEPTED
            },
            "limited commands": acquisition.limited,
            **{f"limited commands: {name}": acquisition.limited_by[name] for name in LIMITS},
            **{f"events: {event.value}": safety.counts[event] for event in COUNTED},
        }
        yield {"commanders": ", ".join(self._link.commanders())}
        for name, window in (("late", acquisition.late_s), ("reply", acquisition.reply_s)):
            figures = window.percentiles()
            yield {
                f"{name} p50 ms": f"{figures.p50 * 1e3:.3f}",
                f"{name} p99 ms": f"{figures.p99 * 1e3:.3f}",
                f"{name} p999 ms": f"{figures.p999 * 1e3:.3f}",
                f"{name} max ms": f"{figures.maximum * 1e3:.3f}",
            }

    def _accept(self, values: Mapping[str, Any]) -> None:
        """Raise when the values do not fit together, or cannot change while the loop runs."""
        _rig_and_limits(values)
        _check_pace(values["real_time_factor"])
        if self._acquisition is None or not self.running:
            return
        before = self.parameters.values()
        fixed = [name for name in values if values[name] != before[name] and name not in _LIVE]
        if fixed:
            raise SettingError(f"{', '.join(fixed)}: deactivate the node first")

    def _on_changed(self, values: Mapping[str, Any]) -> None:
        """Take the limits and the payload at once."""
        if self._acquisition is not None:
            self._acquisition.limit(_limits(values))
        if isinstance(self._rig, SimulatedRig):
            self._rig.change_payload(values["payload_kg"])

    def _on_emergency_stop(
        self, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.success = True
        if self._acquisition is None or not self.running:
            response.message = "not active: the drive is at zero"
            return response
        self._acquisition.emergency_stop()
        self.get_logger().warning("emergency stop")
        response.message = "the drive is held at zero until the node is deactivated"
        return response


class _TopicLink:
    """The loop's two topics, used by the sampling thread alone."""

    def __init__(self, node: LoopNode) -> None:
        self._node = node
        self._publisher = node.create_publisher(ArmState, "state", qos.SENT)
        self._joint_states = node.create_publisher(JointState, "joint_states", qos.SENT)
        self._commands: TopicWaiter[Any] = TopicWaiter(node, MotorCommand, "command", qos.NEWEST)
        self._clock: Publisher[Clock] | None = None
        self._now = Clock()
        self._state = ArmState()
        self._state.header.frame_id = "flexarm"
        self._joint = JointState(name=["hub"])
        self._joint.header.frame_id = "flexarm"
        self._joint_every = 1
        self._start_ns = 0

    def start(self, rate_hz: float, *, virtual: bool, await_commander: bool) -> None:
        """Prepare for a run: match every reader, drop the commands of an earlier run."""
        if virtual and self._clock is None:
            self._clock = self._node.create_publisher(Clock, "/clock", qos.NEWEST)
        if not virtual:
            self._release_clock()
        if virtual and await_commander and not wait_until(self.has_commander):
            self._node.get_logger().warning("no commander is there: the arm moves on without")
        self._node.await_listeners(self._publisher)
        self._commands.wait_newest(0.0)
        self._joint_every = max(1, round(rate_hz / _JOINT_STATES_HZ))

    @property
    def newest_s(self) -> str:
        """Stamp of the newest sample, in seconds since the epoch."""
        return stamp_text(self._state.header.stamp)

    def has_commander(self) -> bool:
        """Tell whether somebody is there who could send commands."""
        return self._commands.publishers() > 0

    def publish(self, record: Record) -> None:
        """Publish one sample, and the SI view of some when somebody listens."""
        if record.sequence == 1:
            # The rig's clock began when it was opened, which may have taken its time; and the
            # first sample takes its own until it is here.
            # The node whose time is `/clock` cannot follow it.
            clock = self._node.get_clock() if self._clock is None else SystemClock()
            now_ns = clock.now().nanoseconds
            self._start_ns = record.start_ns(now_ns, time.monotonic())
        state = self._state
        set_stamp(state.header.stamp, self._start_ns + round(record.time_s * 1e9))
        state.sequence = record.sequence
        (
            state.position_v,
            state.base_strain_v,
            state.middle_strain_v,
            state.speed_v,
        ) = record.volts.tolist()
        state.command_v = record.command_v
        state.compensation_v = record.compensation_v
        state.command_sequence = record.command_sequence
        self._publisher.publish(state)
        if self._clock is not None and self._clock.get_subscription_count():
            self._now.clock = state.header.stamp
            self._clock.publish(self._now)
        if record.sequence % self._joint_every == 0 and self._joint_states.get_subscription_count():
            self._publish_joints(state)

    def wait(self, timeout_s: float) -> Command | None:
        """Return the newest command, or None when none came in time."""
        message = self._commands.wait_newest(timeout_s)
        if message is None:
            return None
        return Command(
            message.sequence,
            message.state_sequence,
            message.effort_v,
            message.compensation_v,
            stamp_ns(message.header.stamp),
        )

    def spare_time(self) -> None:
        """Have the node report on itself."""
        self._node.spare_time()

    def commanders(self) -> list[str]:
        """Return the nodes that could send commands; one that was killed is seen for a while."""
        found = self._node.get_publishers_info_by_topic(self._commands.topic)
        return sorted(f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in found)

    def await_readers(self) -> None:
        """Wait until every reader has every sample."""
        self._node.await_acknowledged(self._publisher)

    def close(self) -> None:
        """Give the topics back."""
        self._commands.close()
        self._release_clock()
        self._node.destroy_publisher(self._publisher)
        self._node.destroy_publisher(self._joint_states)

    def _release_clock(self) -> None:
        if self._clock is not None:
            self._node.destroy_publisher(self._clock)
            self._clock = None

    def _publish_joints(self, state: ArmState) -> None:
        joint = self._joint
        joint.header.stamp = state.header.stamp
        joint.position = [_POSITION.to_si(state.position_v)]
        joint.velocity = [_SPEED.to_si(state.speed_v)]
        joint.effort = [COMMAND.to_si(state.command_v) * _TORQUE_NM_PER_A]
        self._joint_states.publish(joint)


def _rig_and_limits(values: Mapping[str, Any]) -> tuple[Rig, LimiterSettings]:
    """Build what the parameters describe; ValueError when they do not fit together."""
    settings = _limits(values)
    rig = make_rig(values)
    if values["fault"] == _NO_FAULT:
        return rig, settings
    if values["rig"] != "simulated":
        raise SettingError(f"fault = '{values['fault']}' needs rig = 'simulated'")
    faulty = FaultyRig(
        rig,
        Fault(values["fault"]),
        after_samples=values["fault_after_samples"],
        channel=values["fault_channel"],
    )
    return faulty, settings


def _check_pace(factor: float) -> None:
    if 0.0 < factor < _SLOWEST_PACE:
        raise SettingError(
            f"parameter real_time_factor = {factor:g}: must be 0, as fast as it goes, or "
            f"{_SLOWEST_PACE:g} to 100"
        )


def _limits(values: Mapping[str, Any]) -> LimiterSettings:
    return LimiterSettings(**{field.name: values[field.name] for field in fields(LimiterSettings)})


def _sensor_limits(values: Mapping[str, Any]) -> SensorLimits:
    """Return the limits; where there is no noise, a resting arm looks stuck."""
    has_noise = values["rig"] != "simulated" or values["noise"] != "none"
    return SensorLimits(stuck_samples=values["stuck_samples"] if has_noise else 0)


def main() -> int:
    """Run the node."""
    return run(DaqNode, realtime=True)
