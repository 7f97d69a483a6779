"""Base of managed nodes with one loop in a thread of its own, beside the executor."""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from flexarm_core.errors import SettingError, one_line, with_place
from flexarm_core.rig_description import load_rig
from flexarm_core.tables import read_table
from flexarm_node import collector
from flexarm_node.codecs import codec_of
from flexarm_node.parameters import Parameters
from flexarm_node.reports import Level, Report, Reporter, entries
from flexarm_node.stamps import NodeTime
from flexarm_node.topics.waiting import has_every_reader, wait_until
from flexarm_node.transport import complaint_about_transport

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from lifecycle_msgs.srv import ChangeState
    from rclpy.publisher import Publisher

    from flexarm_core.specs import ParameterSpec

    Figures = Mapping[str, object]

PARAMETERS = read_table("flexarm_node", "loop_node")
"""Parameters of every node with a loop, beside its own."""
ENDED = "the loop has ended"
"""Begin of the trouble of a node whose loop has failed."""
_REPORT_S = 1.0
_STEP_S = 0.05


class LoopNode(LifecycleNode):
    """Base of the nodes that sample and control.

    Configuring makes the topics, activating starts the thread, deactivating ends it, cleaning up
    removes the topics. The node reports once a second on `/diagnostics`, after a run with its last
    figures.

    A running loop reports by itself, in pieces in its `spare_time`: a report from another thread
    would hold the interpreter when the next sample comes. The executor sleeps.

    An error never leaves the node active without a loop: it is logged in one line, reported on
    `/diagnostics`, and the node returns to its previous state, inactive after an error of the loop.

    Parameters
    ----------
    name : str
        Node name, in the namespace `/flexarm`.
    specs, open_group, accept, apply, usual
        The node's parameters, see `Parameters`.
    expected : tuple of type
        Errors with a complete message. Others are reported with their place in the code.
    cli_args : sequence of str
        ROS arguments of this node alone, beside those of its process.
    """

    def __init__(
        self,
        name: str,
        specs: Sequence[ParameterSpec],
        *,
        open_group: str = "",
        accept: Callable[[Mapping[str, Any]], object] | None = None,
        apply: Callable[[Mapping[str, Any]], None] | None = None,
        usual: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None,
        expected: tuple[type[Exception], ...] = (),
        cli_args: Sequence[str] = (),
    ) -> None:
        super().__init__(
            name,
            namespace="/flexarm",
            allow_undeclared_parameters=bool(open_group),
            cli_args=[*cli_args],
        )
        self.parameters = Parameters(
            self,
            (*specs, *PARAMETERS),
            open_group=open_group,
            accept=accept,
            apply=apply,
            usual=usual,
        )
        self._expected = expected
        self._trouble = ""
        self._warning = ""
        self._last_entries: list[bytes] = []
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._ended = self.create_guard_condition(self._deactivate_ended)
        self.time = NodeTime(self)
        self._reporter = Reporter(self)
        # On the node's own clock a wall clock set back would silence the reports.
        self._idle_reports = self.create_timer(
            _REPORT_S, self._idle, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        if warning := complaint_about_transport():
            self.get_logger().warning(warning)
        # rclpy's own answer to a transition that the present state does not have is an exception.
        self._answer_transition = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    @abstractmethod
    def make_topics(self) -> None:
        """Make the publishers and subscriptions of the loop."""

    @abstractmethod
    def release_topics(self) -> None:
        """Remove the publishers and subscriptions."""

    @abstractmethod
    def prepare(self) -> None:
        """Prepare a run: called in the executor's thread before the loop starts."""

    @abstractmethod
    def loop(self, stopping: threading.Event) -> None:
        """Work until told to stop, or until nothing is left to do."""

    @abstractmethod
    def figures(self) -> Iterator[Figures]:
        """Yield the figures of the running loop for the diagnostics, a piece at a time."""

    def sampled_ns(self) -> int:
        """Return the stamp of the newest sample, ns, the time of a running loop; 0 without one."""
        return 0

    def alarm(self) -> str:
        """Return the loop's complaint, while it runs and when it has ended; "" without one."""
        return ""

    def warning(self) -> str:
        """Return what a user should know of a loop that runs as it should; "" without a warning."""
        return ""

    def rig(self) -> str:
        """Return the name of the rig that the node drives; empty for none."""
        return ""

    def describe_rig(self) -> None:
        """Read the description of the rig, which says what the topics of the loop carry.

        Raises
        ------
        SettingError
            If there is no such description, or it is wrong.
        """
        self.description = load_rig(self.parameters.values()["rig"])
        self.codec = codec_of(self.description, self.frame)

    def _require_rig(self) -> None:
        """Refuse another rig than that of the topics."""
        rig = self.parameters.values()["rig"]
        if load_rig(rig).text != self.description.text:
            raise SettingError(
                f"rig = {rig!r} is another one than the node was configured for: clean it up and "
                "configure it again"
            )

    @property
    def frame(self) -> str:
        """The tf frame of the arm's base by REP 105: frames of an arm begin with its namespace."""
        return f"{self.get_namespace()}/base_link".lstrip("/")

    @property
    def trouble(self) -> str:
        """What went wrong since the last activation, in words; empty for nothing."""
        return self._trouble

    @property
    def running(self) -> bool:
        """True while the loop's thread exists."""
        return self._thread is not None

    def listen(self) -> None:
        """Take what has come on topics beside the samples.

        It is called in the loop's spare time, and once a second without a loop.
        """

    def spare_time(self) -> None:
        """Listen, and do a piece of the report when one is due.

        The loop calls it in its own thread, whenever it waits for the next sample.
        """
        collector.collect_youngest()
        self.listen()
        next(self._reports)

    def report_beside(self, warning: str) -> None:
        """Warn on `/diagnostics` and in the log, while the loop's own thread hangs."""
        self.get_logger().warning(warning)
        self._report(Report(Level.WARN, f"active: {warning}"))

    def await_listeners(self, *publishers: Publisher, least: int = 0) -> None:
        """Wait until every reader will get the first messages; warn when it takes long.

        At least `least` readers of one of the topics, and as many as the parameter `listeners`
        says, must be there: this node may not have discovered all of them.
        """
        least = max(least, self.parameters.values()["listeners"])
        if not wait_until(lambda: has_every_reader(self, publishers, least)):
            names = ", ".join(publisher.topic_name for publisher in publishers)
            self.get_logger().warning(
                f"not every reader of {names} is there: it may miss the first messages"
            )

    def start_if_asked(self) -> None:
        """Configure and activate when the parameter `autostart` says so."""
        if self.parameters.values()["autostart"]:
            self.trigger_configure()
            self.trigger_activate()

    def stop(self) -> None:
        """End the loop, since the process ends."""
        self._end_loop()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Make the topics."""
        try:
            self.describe_rig()
            self.make_topics()
        except Exception as error:  # noqa: BLE001 - rclpy would swallow it
            self._report_trouble(f"not configured: {self._reason(error)}")
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the loop."""
        self._trouble = ""
        self._last_entries = []
        try:
            self._require_rig()
            self.prepare()
        except Exception as error:  # noqa: BLE001 - rclpy would swallow it
            self._report_trouble(f"not activated: {self._reason(error)}")
            return TransitionCallbackReturn.FAILURE
        self._stopping.clear()
        self._idle_reports.cancel()
        self._reports = self._report_now_and_then()
        self._thread = threading.Thread(target=self._run, daemon=True, name=self.get_name())
        self._thread.start()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the loop."""
        self._end_loop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """Remove the topics."""
        self.release_topics()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: ARG002
        """End the loop."""
        self._end_loop()
        return TransitionCallbackReturn.SUCCESS

    def _end_loop(self) -> None:
        """End the loop, if it runs, and wait for it."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self._idle_reports.reset()

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        try:
            return self._answer_transition(request, response)
        except RuntimeError as error:
            self.get_logger().error(f"transition {request.transition.id} refused: {error}")
            response.success = False
            return response

    def _run(self) -> None:
        try:
            with collector.resting():
                self.loop(self._stopping)
            self._report_trouble(self.alarm())
        except Exception as error:  # noqa: BLE001 - the node outlives its loop, and shows it
            self._report_trouble(f"{ENDED}: {self._reason(error)}")
        self._last_entries = [each for figures in self.figures() for each in entries(figures)]
        self._report_idle()
        if not self._stopping.is_set():
            self._ended.trigger()

    def _reason(self, error: Exception) -> str:
        return one_line(error) if isinstance(error, self._expected) else with_place(error)

    def _report_trouble(self, trouble: str) -> None:
        """Log trouble once and keep it for the diagnostics, until the next activation."""
        if trouble and trouble != self._trouble:
            self.get_logger().error(trouble)
            self._trouble = trouble

    def _deactivate_ended(self) -> None:
        if self.running:
            self.trigger_deactivate()

    def _idle(self) -> None:
        self.listen()
        self._report_idle()

    def _report_idle(self) -> None:
        self._report(Report(Level.OK, "not active", self._last_entries))

    def _report_now_and_then(self) -> Iterator[None]:
        """Report once a second, in short steps, and as soon as there is another alarm.

        A report that is late keeps its distance to the next.
        """
        due_s = time.monotonic()
        alarm = self.alarm()
        while True:
            due_s = max(due_s + _REPORT_S, time.monotonic())
            while time.monotonic() < due_s and self.alarm() == alarm:
                yield
            due_s = min(due_s, time.monotonic())
            alarm = self.alarm()
            self._report_trouble(alarm)
            warning = self.warning()
            if warning and warning != self._warning:
                self.get_logger().warning(warning)
            self._warning = warning
            listed: list[bytes] = []
            for figures in self.figures():
                listed += entries(figures)
                next_s = time.monotonic() + _STEP_S
                while time.monotonic() < next_s:
                    yield
            level = Level.WARN if warning else Level.OK
            self._report(Report(level, f"active: {warning}" if warning else "active", listed))

    def _report(self, report: Report) -> None:
        if self._trouble:
            message = f"{report.message}: {self._trouble}"
            report = report._replace(level=Level.ERROR, message=message)
        now_ns = self.time.now_ns()
        # In virtual time the wall clock is not the arm's.
        sampled_ns = self.sampled_ns() if self.running else 0
        self._reporter.publish(report, sampled_ns or now_ns, self.rig())
