"""DAQ node: samples the rig, publishes the samples, applies commands, reports its own figures.

The node is a managed node. Configuration checks the parameters and makes the topics. Activation
starts the sampling, and deactivation stops it with the drive at zero.
"""

from __future__ import annotations

import math
import time
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from std_srvs.srv import Trigger

from flexarm_core.channels import CHANNEL_NAMES, INPUT_RANGE_V, MAX_COMMAND_V, is_thesis_arm
from flexarm_core.errors import SettingError
from flexarm_core.rig_description import SHORT_NAMES, load_rig
from flexarm_core.tables import defaults, read_table
from flexarm_daq.loop.acquisition import Acquisition, LockStep
from flexarm_daq.loop.commander import Verdict
from flexarm_daq.loop.complaints import Complaints
from flexarm_daq.loop.deadman import Deadman
from flexarm_daq.loop.limiter import LIMITS, Gate, LimiterSettings, arm_gate, rig_gate
from flexarm_daq.loop.safety import COUNTED
from flexarm_daq.loop.self_test import run_self_test
from flexarm_daq.loop.sensor_check import SensorCheck, SensorLimits
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.nodes.rig_choice import (
    NOISE_V,
    is_virtual,
    make_rig,
    rig_name,
    wants_self_test,
)
from flexarm_daq.nodes.topic_link import TopicLink
from flexarm_daq.rigs.faulty import Fault, FaultyRig
from flexarm_daq.rigs.nidaq.terminals import TERMINALS, NidaqSettings
from flexarm_daq.rigs.rig_protocol import Rig, RigError, absent_channels, has_own_clock
from flexarm_daq.rigs.simulated import SimulatedRig
from flexarm_node.loop_node import LoopNode
from flexarm_node.process import run
from flexarm_node.stamps import stamp_text
from flexarm_node.statistics import Rate

if TYPE_CHECKING:
    import threading
    from collections.abc import Iterator, Mapping, Sequence

    from flexarm_node.topics.handover import DirectHandover

_NO_FAULT = "none"

PARAMETERS = read_table(
    "flexarm_daq.nodes",
    "daq",
    {
        **defaults(NidaqSettings()),
        **defaults(LimiterSettings()),
        **defaults(SensorLimits()),
        "max_command_v": MAX_COMMAND_V,
        "input_range_v": INPUT_RANGE_V,
        "channels": CHANNEL_NAMES,
        "first_channel": CHANNEL_NAMES[0],
        "noises": tuple(NOISE_V),
        "terminals": TERMINALS,
        "faults": (_NO_FAULT, *(fault.value for fault in Fault)),
    },
)
_LIVE = {spec.name for spec in PARAMETERS if spec.live}
_SLOWEST_PACE = 0.01


class DaqNode(LoopNode):
    """Node that connects parameters, topics and services to an `Acquisition`.

    Parameters
    ----------
    handover : DirectHandover, optional
        Way to a commander in the same process.
    cli_args : sequence of str
        ROS arguments of this node alone.
    """

    # Parameters are checked before the rest of the node is there.
    _acquisition: Acquisition | None = None

    def __init__(
        self, handover: DirectHandover | None = None, cli_args: Sequence[str] = ()
    ) -> None:
        super().__init__(
            "daq",
            PARAMETERS,
            accept=self._accept,
            apply=self._on_changed,
            usual=_usual,
            expected=(RigError,),
            cli_args=cli_args,
        )
        self._handover = handover
        self._report_pace(self.parameters.values())
        self._rig: Rig | None = None
        self.create_service(Trigger, "emergency_stop", self._on_emergency_stop)
        self.start_if_asked()

    def make_topics(self) -> None:
        """Make the topics of the loop."""
        self._link = TopicLink(self, self._handover)

    def release_topics(self) -> None:
        """Release the topics."""
        self._link.close()

    def prepare(self) -> None:
        """Build the rig, and wait until every reader will get the first sample."""
        values = self.parameters.values()
        rig = _checked_rig(values)
        self._rig = rig
        gate = self._gate(values)
        virtual = is_virtual(values)
        if wants_self_test(values):
            run_self_test(rig, gate, self.description, values["rate_hz"], paced=not virtual)
            self.get_logger().info("self-test: every channel answers with the right sign")
        self._link.start(
            rig,
            values["rate_hz"],
            virtual=virtual,
            clock=values["clock"],
            await_commander=values["await_commander"],
        )
        lockstep = LockStep(
            values["real_time_factor"],
            values["answer_timeout_s"],
            is_answered=self._link.has_commander(),
        )
        self._rate = Rate()
        self._complaints = Complaints(values["rate_hz"])
        age_periods = values["max_age_periods"] or self.description.safety.max_age_periods
        watchdog = Watchdog(1.0 / values["rate_hz"], age_periods)
        deadman = None
        if self._handover is not None and not virtual:
            deadman = Deadman(watchdog.longest_answer_s, rig.safe_stop, self._report_held_up)
        self._acquisition = Acquisition(
            rig,
            gate,
            watchdog,
            self._sensors(values, rig),
            self._link,
            rate_hz=values["rate_hz"],
            samples=values["samples"],
            paced_by_rig=has_own_clock(rig),
            lockstep=lockstep if virtual else None,
            statistics_s=values["statistics_s"],
            deadman=deadman,
        )

    def _gate(self, values: Mapping[str, Any]) -> Gate:
        """Return the limits of the commands: parameters of the thesis's arm, or the description."""
        if is_thesis_arm(self.description):
            return arm_gate(_limits(values))
        return rig_gate(self.description)

    def _sensors(self, values: Mapping[str, Any], rig: Rig) -> SensorCheck:
        """Return the check of the sensors; without noise, a resting arm looks stuck."""
        rate_hz, absent = values["rate_hz"], absent_channels(rig)
        if is_thesis_arm(self.description):
            return SensorCheck(rate_hz, _sensor_limits(values), absent)
        limits = SensorLimits(stuck_samples=self.description.safety.stuck_samples)
        return SensorCheck(rate_hz, limits, absent, self.description)

    def loop(self, stopping: threading.Event) -> None:
        """Sample until told to stop, or until all samples are taken."""
        assert self._acquisition is not None  # noqa: S101 - prepared before
        try:
            self._acquisition.run(stopping)
            taken = self._acquisition.taken
            self.get_logger().info(f"{taken} sample{'s' * (taken != 1)}, the drive is at zero")
        finally:
            self._link.acted()
            if not stopping.is_set():
                self._link.await_readers()

    def sampled_ns(self) -> int:
        """Return the stamp of the newest sample; see `LoopNode.sampled_ns`."""
        return self._link.newest_ns

    def _report_held_up(self, passed_s: float) -> None:
        """Report in the place of the loop's thread, which the law has not left."""
        self.report_beside(
            f"the controller has delayed the sampling for {passed_s:.0f} s: the drive is at zero"
        )

    def alarm(self) -> str:
        """Return why the drive is held at zero, or was to the end of the run."""
        assert self._acquisition is not None  # noqa: S101 - asked only in and after a run
        reason = self._acquisition.safety.reason
        return f"the drive is held at zero: {reason}" if reason else ""

    def warning(self) -> str:
        """Return what a user should know of the running loop; empty when all is well."""
        assert self._acquisition is not None  # noqa: S101 - asked only while the loop runs
        return self._complaints.look(self._acquisition)

    def rig(self) -> str:
        """Return the name of the rig."""
        return rig_name(self.parameters.values())

    def figures(self) -> Iterator[Mapping[str, object]]:
        """Yield the figures of the loop."""
        acquisition = self._acquisition
        assert acquisition is not None  # noqa: S101 - asked only while the loop runs
        self._link.share_clock()
        rate_hz = self._rate.update(acquisition.taken, time.monotonic())
        safety, verdicts = acquisition.safety, acquisition.commander.verdicts
        yield {
            "drive": safety.state.value,
            "held after s": "" if math.isnan(acquisition.held_s) else f"{acquisition.held_s:.3f}",
            **{
                drive.name: drive.text(command)
                for drive, command in zip(
                    self.description.inputs, acquisition.applied.commands, strict=True
                )
            },
            **{
                sensor.name: sensor.text(value)
                for sensor, value in zip(
                    self.description.outputs, self._link.newest_outputs, strict=False
                )
            },
            "last sample s": stamp_text(self._link.newest_ns),
            "samples": acquisition.taken,
            "rate Hz": f"{rate_hz:.1f}",
            "off rate": acquisition.off_rate,
            "real-time factor": f"{acquisition.real_time_factor:.3f}",
            "missed periods": acquisition.missed,
            "unanswered samples": acquisition.unanswered,
        }
        yield {
            "refused commands": acquisition.refused,
            **{
                f"refused commands: {verdict.value}": verdicts[verdict]
                for verdict in Verdict
                if verdict is not Verdict.ACCEPTED
            },
        }
        yield {
            "limited commands": acquisition.limited,
            **{f"limited commands: {name}": acquisition.limited_by[name] for name in LIMITS},
            **{f"events: {event.value}": safety.counts[event] for event in COUNTED},
        }
        yield {"commanders": ", ".join(self._link.commanders())}
        for name, window in (("late", acquisition.late_s), ("reply", acquisition.reply_s)):
            late = window.percentiles()
            yield {
                f"{name} p50 ms": f"{1e3 * late.p50:.3f}",
                f"{name} p99 ms": f"{1e3 * late.p99:.3f}",
                f"{name} p999 ms": f"{1e3 * late.p999:.3f}",
                f"{name} max ms": f"{1e3 * late.maximum:.3f}",
            }
            yield {f"{name} histogram": " ".join(map(str, window.histogram()))}

    def _accept(self, values: Mapping[str, Any]) -> None:
        """Refuse values that do not fit together, or cannot change while the loop runs."""
        _limits(values)
        _checked_rig(values)
        pace = values["real_time_factor"]
        if 0.0 < pace < _SLOWEST_PACE:
            raise SettingError(
                f"parameter real_time_factor = {pace:g}: must be 0, as fast as "
                f"it goes, or {_SLOWEST_PACE:g} to 100"
            )
        if self._acquisition is None or not self.running:
            return
        before = self.parameters.values()
        fixed = [name for name in values if values[name] != before[name] and name not in _LIVE]
        if fixed:
            raise SettingError(f"{', '.join(fixed)}: deactivate the node first")

    def _on_changed(self, values: Mapping[str, Any]) -> None:
        """Take the limits and the payload at once."""
        self._report_pace(values)
        if self._acquisition is not None:
            self._acquisition.limit(self._gate(values).limits)
        if isinstance(self._rig, SimulatedRig):
            self._rig.change_payload(values["payload_kg"])

    def _report_pace(self, values: Mapping[str, Any]) -> None:
        """Tell a commander in the same process whether samples wait for it."""
        if self._handover is not None:
            self._handover.waits = is_virtual(values)

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


def _usual(given: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the rate that the description of another rig than the thesis's says."""
    rig = str(given.get("rig", "simulated"))
    return {} if rig in SHORT_NAMES else {"rate_hz": load_rig(rig).rate_hz}


def _checked_rig(values: Mapping[str, Any]) -> Rig:
    """Build the rig; raise SettingError when the values do not fit together."""
    rig = make_rig(values)
    if values["fault"] == _NO_FAULT:
        return rig
    if not isinstance(rig, SimulatedRig):
        raise SettingError(f"fault = '{values['fault']}' needs rig = 'simulated'")
    return FaultyRig(
        rig,
        Fault(values["fault"]),
        after_samples=values["fault_after_samples"],
        channel=values["fault_channel"],
    )


def _limits(values: Mapping[str, Any]) -> LimiterSettings:
    return LimiterSettings(**{field.name: values[field.name] for field in fields(LimiterSettings)})


def _sensor_limits(values: Mapping[str, Any]) -> SensorLimits:
    """Return the limits; without noise, a resting arm looks stuck and is not checked."""
    has_noise = values["rig"] != "simulated" or values["noise"] != "none"
    return SensorLimits(stuck_samples=values["stuck_samples"] if has_noise else 0)


def main() -> int:
    """Run the node."""
    return run(DaqNode, realtime=True)
