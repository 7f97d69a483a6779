"""Identification node: a service and an action from bags to a validated reduced model.

`identify` and the action `identify_bags` read the bags, and answer with the model as parameters;
the action also reports its progress, and can be cancelled; `ident/cancel` ends either, and so does
the last caller that leaves the graph. A job that does not stop at once is left behind and can write
nothing any more. The node declares these parameters on
itself and writes a folder with `model.yaml`, ready for `--params-file`, and `report.html`. It works
on one job at a time, beside the executor, which stays free for parameters and for cancelling.
"""

from __future__ import annotations

import threading
import time
import traceback
from dataclasses import fields
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias
from urllib.parse import unquote, urlsplit

from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from flexarm_core.errors import FlexarmError, IdentificationError, one_line
from flexarm_core.own_files import user_path
from flexarm_core.tables import read_table
from flexarm_ident.background import Background, Cancelled
from flexarm_ident.job import identify_bags, model_name
from flexarm_ident.models.files import parse_exports
from flexarm_ident.reading.channels import selection
from flexarm_ident.workflow.request import Request
from flexarm_msgs.action import IdentifyBags
from flexarm_msgs.msg import ModeSummary
from flexarm_msgs.srv import Identify
from flexarm_node import qos
from flexarm_node.parameters import Parameters
from flexarm_node.process import run as run_node

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from rclpy.action.server import ServerGoalHandle
    from rclpy.timer import Timer

    from flexarm_core.arrays import Progress
    from flexarm_ident.job import Results
    from flexarm_ident.models.modes import Mode
    from flexarm_ident.reading.channels import Selection

    Asked: TypeAlias = "Identify.Request | IdentifyBags.Goal"
    Answer: TypeAlias = "Identify.Response | IdentifyBags.Result"

# A compiled function that takes longer must not keep a process that was told to stop.
_STOP_S = 0.8
_LOOK_S = 0.1
_ACTION = "identify_bags"
_SERVICE = "identify"

PARAMETERS = read_table("flexarm_ident", "ident")


class _AtWork(NamedTuple):
    """Job at work; `goal` is None for a call of the service."""

    job: Background[Results]
    name: str
    goal: ServerGoalHandle | None
    started_s: float

    def __str__(self) -> str:
        return f"{self.name}, {self.job.stage}, {time.monotonic() - self.started_s:.0f} s so far"


class IdentNode(Node):
    """Node that wires the service and the action to `job.identify_bags`."""

    def __init__(self) -> None:
        super().__init__("ident", namespace="/flexarm")
        self._settings = Parameters(self, PARAMETERS, accept=_accept)
        self._at_work: _AtWork | None = None
        self._news = Future()
        self._stopping = threading.Event()
        # A call that is being worked on must not keep the next one, or the parameters, waiting.
        group = ReentrantCallbackGroup()
        self.create_service(
            Identify, _SERVICE, self._on_identify, qos_profile=qos.CALLS, callback_group=group
        )
        self.create_service(Trigger, "~/cancel", self._on_cancel, callback_group=group)
        self._action = ActionServer(
            self,
            IdentifyBags,
            _ACTION,
            self._on_goal,
            cancel_callback=self._on_cancelled_goal,
            callback_group=group,
            goal_service_qos_profile=qos.CALLS,
            result_service_qos_profile=qos.CALLS,
            cancel_service_qos_profile=qos.CALLS,
        )

    def stop(self) -> None:
        """Cancel the job, if there is one."""
        self._stopping.set()
        if self._at_work is not None:
            self._at_work.job.cancel()
            self._at_work.job.join(_STOP_S)
        self._action.destroy()

    async def _on_identify(
        self, request: Identify.Request, response: Identify.Response
    ) -> Identify.Response:
        await self._answer(request, response)
        return response

    async def _on_goal(self, goal: ServerGoalHandle) -> IdentifyBags.Result:
        result = IdentifyBags.Result()
        await self._answer(goal.request, result, goal)
        if result.success:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return result

    def _on_cancelled_goal(self, goal: ServerGoalHandle) -> CancelResponse:
        if self._at_work is not None and self._at_work.goal is goal:
            self._at_work.job.cancel()
        return CancelResponse.ACCEPT

    def _on_cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Cancel the job, whoever asked for it."""
        response.success = self._at_work is not None
        response.message = "no identification is at work"
        if self._at_work is not None:
            self._at_work.job.cancel()
            response.message = f"cancelled: {self._at_work}"
        return response

    async def _answer(
        self, asked: Asked, answer: Answer, goal: ServerGoalHandle | None = None
    ) -> None:
        """Fill the answer: the model, or why there is none."""
        try:
            started_s = time.monotonic()
            results = await self._identified(asked, goal)
            self._keep(results.parameters)
            _fill(answer, results, time.monotonic() - started_s)
            self.get_logger().info(answer.message)
        except Cancelled as stopped:
            answer.message = f"{stopped}: nothing was written"
            self.get_logger().info(answer.message)
        except (FlexarmError, OSError) as error:
            answer.message = one_line(error)
            self.get_logger().error(answer.message)
        except Exception as error:  # noqa: BLE001 - a defect in one job does not end the node
            answer.message = f"internal error, see the log of the node: {error!r}"
            self.get_logger().error(traceback.format_exc())

    async def _identified(self, asked: Asked, goal: ServerGoalHandle | None) -> Results:
        """Run the job in a thread; the executor is free meanwhile."""
        if self._at_work is not None:
            raise IdentificationError(
                f"busy with another identification ({self._at_work}); no call is queued: try again "
                "when it is done"
            )
        bags, executor = as_bags(asked.bag_uris), self.executor
        work = self._work(bags, as_request(asked), as_channels(asked))

        def notify() -> None:
            if not self._stopping.is_set():
                self._news.set_result(None)
                executor.wake()

        job = Background(work, notify=notify, patience_s=_STOP_S)
        self._at_work = _AtWork(job, model_name(bags[0]), goal, time.monotonic())
        if goal is not None and goal.is_cancel_requested:
            job.cancel()
        watching = self._watched(job, has_goal=goal is not None)
        try:
            while True:
                # Made before looking: what comes after the look ends the wait.
                self._news = news = Future()
                ended = job.ended
                for stage, fraction in job.progress():
                    if goal is not None:
                        goal.publish_feedback(IdentifyBags.Feedback(stage=stage, fraction=fraction))
                if ended:
                    return job.result()
                await news
        finally:
            self.destroy_timer(watching)
            self._at_work = None

    def _watched(self, job: Background[Results], *, has_goal: bool) -> Timer:
        """Cancel a job when the last one who may have asked for it has left the graph."""
        has_callers = False

        def look() -> None:
            nonlocal has_callers
            callers = (
                self.count_subscribers(f"{_ACTION}/_action/feedback")
                if has_goal
                else self.count_clients(_SERVICE)
            )
            if has_callers and not callers:
                job.cancel()
            # A call may come before its caller is discovered.
            has_callers = has_callers or callers > 0

        look()
        return self.create_timer(_LOOK_S, look)

    def _work(
        self, bags: Sequence[Path], request: Request, channels: Selection | None
    ) -> Callable[[Progress], Results]:
        """Return the work of a request with the settings of now."""
        settings = self._settings.values()
        root = user_path(settings["output_folder"]).absolute()
        folder, exports = root / model_name(bags[0]), parse_exports(settings["exports"])
        force = settings["force"]
        return lambda report: identify_bags(
            *(bags, folder, request),
            channels=channels,
            exports=exports,
            force=force,
            progress=report,
        )

    def _keep(self, parameters: Mapping[str, Any]) -> None:
        known = []
        for key, value in parameters.items():
            if self.has_parameter(key):
                known.append(Parameter(key, value=value))
            else:
                self.declare_parameter(key, value, ignore_override=True)
        self.set_parameters_atomically(known)


def as_bags(uris: Sequence[str]) -> list[Path]:
    """Convert the URIs of a request to paths; IdentificationError when there is none."""
    if not uris:
        raise IdentificationError("bag_uris is empty: name at least one bag")
    return [_path(uri) for uri in uris]


def as_request(message: Asked) -> Request:
    """Convert a service request or a goal to a `Request`.

    Zero and empty fields take the defaults of `Request`; booleans have them in the message.

    Raises
    ------
    IdentificationError
        When a field is invalid.
    """
    asked = {each.name: getattr(message, each.name) for each in fields(Request)}
    asked["known_modes_hz"] = tuple(message.known_modes_hz)
    given: dict[str, Any] = {key: value for key, value in asked.items() if value or value is False}
    return Request(**given)


def as_channels(message: Asked) -> Selection | None:
    """Convert the named signals of a service request or a goal; None when none is named.

    Raises
    ------
    BagError
        When a name is invalid, or only inputs or outputs are named.
    """
    if message.inputs or message.outputs:
        return selection(
            *(message.inputs, message.outputs),
            clock=message.clock or None,
            interpolated=message.interpolated,
        )
    if message.clock or message.interpolated:
        raise IdentificationError("clock and interpolated belong to named inputs and outputs")
    return None


def _accept(values: Mapping[str, Any]) -> None:
    user_path(values["output_folder"])
    try:
        parse_exports(values["exports"])
    except IdentificationError as error:
        raise IdentificationError(f"parameter exports: {error}") from error


def _path(uri: str) -> Path:
    is_uri = uri.lower().startswith("file:")
    try:
        return user_path(unquote(urlsplit(uri).path) if is_uri else uri)
    except ValueError as error:
        raise IdentificationError(f"{uri}: no URI of a bag: {error}") from error


def _fill(answer: Answer, results: Results, elapsed_s: float) -> None:
    answer.parameters = [
        Parameter(key, value=value).to_parameter_msg() for key, value in results.parameters.items()
    ]
    answer.warnings = list(results.outcome.warnings)
    answer.modes = [_summary(mode) for mode in results.outcome.modes]
    answer.dmv = list(results.dmv)
    answer.sfv = list(results.sfv)
    answer.left_out = list(results.left_out)
    answer.report_path = str(results.folder)
    answer.success = True
    answer.message = results.text(elapsed_s)


def _summary(mode: Mode) -> ModeSummary:
    return ModeSummary(
        eigenvalue_real=mode.eigenvalue.real,
        eigenvalue_imaginary=abs(mode.eigenvalue.imag),
        frequency_hz=mode.frequency_hz,
        damping_ratio=mode.damping_ratio,
        msv=mode.msv,
        mrm=mode.mrm,
        msv_rank=mode.msv_rank,
        mrm_rank=mode.mrm_rank,
        kept=mode.kept,
    )


def main() -> int:
    """Run the node."""
    return run_node(IdentNode)
