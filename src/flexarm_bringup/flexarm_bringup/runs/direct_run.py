"""Run of the loop in one process: sampling loop, law and recorder without nodes between them.

The sampling loop is that of the DAQ node, in virtual time. Every sample is answered before the next
one, so the samples are those of the nodes for the same seed.
"""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.schema import describe, own_types, share_of
from flexarm_bags.writer import BagWriter
from flexarm_bringup.console import terminal
from flexarm_bringup.graph.figures import Run
from flexarm_bringup.graph.processes import HeldDriveError
from flexarm_bringup.runs.recorded_run import completed_run
from flexarm_control.laws.law_protocol import DriveCommand
from flexarm_control.laws.switching import Handover
from flexarm_control.loop_setup import PARAMETERS, Setup
from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.signals import Command
from flexarm_daq.loop.acquisition import Acquisition, LockStep
from flexarm_daq.loop.limiter import arm_gate
from flexarm_daq.loop.sensor_check import SensorCheck
from flexarm_daq.loop.watchdog import Watchdog

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from flexarm_bringup.runs.recorded_run import RecordedRun
    from flexarm_control.references import Reference
    from flexarm_daq.loop.exchange import Record
    from flexarm_daq.rigs.simulated import SimulatedRig

# The law answers in the same thread: nothing is ever waited for.
_PATIENCE_S = 1.0
_REPEAT_NS = _NS = 1_000_000_000
_FRAME = "flexarm"
_TYPES = {
    "commander": "flexarm_msgs/msg/CommanderInfo",
    "state": "flexarm_msgs/msg/ArmState",
    "command": "flexarm_msgs/msg/MotorCommand",
    "reference": "std_msgs/msg/Float64",
}
_LATCHED = {"commander", "reference"}


class DirectRun(NamedTuple):
    """Setting of a run without nodes.

    Attributes
    ----------
    rig : SimulatedRig
        Rig in virtual time.
    rate_hz : float
        Its sampling rate, Hz.
    samples : int
        Length of the run.
    real_time_factor : float
        Largest ratio of the arm's time to that of the wall clock; 0: as fast as it goes.
    namespace : str
        Namespace that the topics of the record have.
    """

    rig: SimulatedRig
    rate_hz: float
    samples: int
    real_time_factor: float
    namespace: str

    def record(self, controller: Mapping[str, Any], bag: Path, *, text: str) -> RecordedRun:
        """Run the loop once and record it.

        Parameters
        ----------
        controller : mapping of str to value
            Parameters of the controller that differ from its defaults; the reference is one of the
            built-in profiles.
        bag : Path
            Bag to create.
        text : str
            Words beside the progress.

        Raises
        ------
        SettingError
            When the parameters do not fit together.
        RecordingError
            When the bag cannot be written.
        HeldDriveError
            When the drive was held at zero.
        """
        defaults = {spec.name: spec.default for spec in PARAMETERS}
        setup = Setup.of(defaults | dict(controller))
        setup.check_rate(self.rate_hz)
        loop_bag = LoopBag(bag, self.namespace)
        with terminal.progress_bar(text, self.samples) as progress:
            link = _DirectLink(setup, loop_bag, self.rig.parameters.loop_delay_s, progress)
            loop = Acquisition(
                self.rig,
                arm_gate(),
                Watchdog(1.0 / self.rate_hz),
                SensorCheck(self.rate_hz),
                link,
                rate_hz=self.rate_hz,
                samples=self.samples,
                lockstep=LockStep(self.real_time_factor, _PATIENCE_S, is_answered=True),
            )
            try:
                loop.run(threading.Event())
            finally:
                loop_bag.close()
        if reason := loop.safety.reason:
            raise HeldDriveError(
                f"the drive is held at zero: {reason}, after {loop.held_s:.3f} s of the run"
            )
        recorded = f"{loop_bag.message_count} messages in {bag}"
        run = Run(loop.taken, loop.missed, loop.real_time_factor, recorded)
        return completed_run(run, bag, lockstep=True)


class _DirectLink:
    """Far end of the loop: the law answers each sample at once, and all of it is recorded."""

    def __init__(
        self, setup: Setup, bag: LoopBag, delay_s: float, progress: Callable[[int], None]
    ) -> None:
        if setup.profile is None:
            raise ValueError("a run without nodes needs a built-in reference")
        self._setup = setup
        self._profile: Reference = setup.profile
        self._bag = bag
        self._delay_ns = round(delay_s * 1e9)
        self._progress = progress
        self._start_ns = self._run_start_ns = 0
        self._sent_v: float | None = None
        self._sent_ns = 0
        self._answer: Command | None = None
        self._law = Handover(setup.law)
        self._law.reset()

    def publish(self, record: Record) -> None:
        """Record one sample, and answer it."""
        if record.sequence == 1:
            self._start_ns = record.start_ns(time.time_ns(), time.monotonic())
        taken_ns = self._start_ns + round(record.time_s * 1e9)
        if record.sequence == 1:
            self._run_start_ns = taken_ns
            law_spec = self._setup.law_spec
            self._bag.add_commander(
                taken_ns, law_spec.name, uses_outputs=bool(law_spec.uses_outputs)
            )
        self._bag.add_state(record, taken_ns)
        reference_v = self._profile((taken_ns - self._run_start_ns) * 1e-9)
        self._send_reference(taken_ns, reference_v)
        drive = DriveCommand(*record.commands, *record.compensations)
        effort_v, compensation_v = self._law.step(record.outputs.tolist(), reference_v, drive)
        self._answer = Command(
            record.sequence,
            record.sequence,
            (effort_v,),
            (compensation_v,),
            taken_ns + self._delay_ns,
        )
        self._bag.add_command(self._answer)
        self._progress(record.sequence)

    def wait(self, timeout_s: float) -> Command | None:
        """Return the answer to the newest sample, or None once it was returned."""
        answer, self._answer = self._answer, None
        if answer is None:
            time.sleep(max(0.0, timeout_s))
        return answer

    def commanders(self) -> list[str]:
        """Return nothing: the law of this process alone commands."""
        return []

    def acted(self) -> None:
        """Do nothing: nothing waits."""

    def spare_time(self) -> None:
        """Do nothing: nobody asks for figures."""

    def _send_reference(self, taken_ns: int, reference_v: float) -> None:
        """Record the set-point when it has changed, and at intervals, as the controller does."""
        if reference_v != self._sent_v or taken_ns - self._sent_ns >= _REPEAT_NS:
            self._sent_v, self._sent_ns = reference_v, taken_ns
            self._bag.add_reference(taken_ns, reference_v)


class LoopBag:
    """Writer of the messages that the nodes of the loop would send.

    Parameters
    ----------
    path : Path
        Folder to create.
    namespace : str
        Namespace of the arm.

    Raises
    ------
    RecordingError
        If the bag cannot be created or, later, written.
    """

    def __init__(self, path: Path, namespace: str) -> None:
        self._store = own_types()
        self._names = {key: f"{namespace}/{key}" for key in _TYPES}
        topics = [
            RecordedTopic(
                self._names[key],
                describe(self._store, type_name, share_of),
                TopicQos(durability="transient_local" if key in _LATCHED else "volatile"),
            )
            for key, type_name in _TYPES.items()
        ]
        self._node = f"{namespace}/controller"
        self._bag = BagWriter(path, topics)

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        return self._bag.message_count

    def add_commander(self, stamp_ns: int, law: str, *, uses_outputs: bool) -> None:
        """Add who commands from an instant on."""
        self._add(
            "commander",
            stamp_ns,
            header=self._header(stamp_ns),
            node=self._node,
            law=law,
            uses_outputs=uses_outputs,
        )

    def add_state(self, record: Record, stamp_ns: int) -> None:
        """Add one sample."""
        (command_v,), (compensation_v,) = record.commands, record.compensations
        self._add(
            "state",
            stamp_ns,
            header=self._header(stamp_ns),
            sequence=record.sequence,
            **dict(zip(CHANNEL_NAMES, record.outputs.tolist(), strict=True)),
            command_v=command_v,
            compensation_v=compensation_v,
            command_sequence=record.command_sequence,
        )

    def add_reference(self, stamp_ns: int, reference_v: float) -> None:
        """Add a set-point, which is in force until the next one."""
        self._add("reference", stamp_ns, data=reference_v)

    def add_command(self, command: Command) -> None:
        """Add one command."""
        (effort_v,), (compensation_v,) = command.efforts, command.compensations
        self._add(
            "command",
            command.stamp_ns,
            header=self._header(command.stamp_ns),
            sequence=command.sequence,
            state_sequence=command.state_sequence,
            effort_v=effort_v,
            compensation_v=compensation_v,
        )

    def close(self) -> None:
        """Complete the bag."""
        self._bag.close()

    def _header(self, stamp_ns: int) -> object:
        types = self._store.types
        stamp = types["builtin_interfaces/msg/Time"](sec=stamp_ns // _NS, nanosec=stamp_ns % _NS)
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id=_FRAME)

    def _add(self, key: str, time_ns: int, **members: Any) -> None:  # noqa: ANN401
        type_name = _TYPES[key]
        message = self._store.types[type_name](**members)
        raw = bytes(self._store.serialize_cdr(message, type_name))
        self._bag.write(self._names[key], raw, time_ns, time_ns)
