"""Identification node: a service and an action from bags to a validated reduced model.

`identify` and the action `identify_bags` read the bags, and answer with the model as parameters;
the action also reports its progress, and can be cancelled; `ident/cancel` ends either, and so does
the last caller that leaves the graph. The node declares these parameters on
itself and writes a folder with `model.yaml`, ready for `--params-file`, and `report.html`. It works
on one job at a time, in a process of its own: the executor stays free for parameters and for
cancelling.
"""

from __future__ import annotations

import threading
import time
import traceback
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, TypeAlias
from urllib.parse import unquote, urlsplit

from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from flexarm_core.computation import CancelledError, Computation
from flexarm_core.errors import FlexarmError, IdentificationError, one_line
from flexarm_core.own_files import user_path
from flexarm_core.tables import read_table
from flexarm_ident.job import model_name
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
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from rclpy.action.server import ServerGoalHandle
    from rclpy.timer import Timer

    Asked: TypeAlias = "Identify.Request | IdentifyBags.Goal"
    Answer: TypeAlias = "Identify.Response | IdentifyBags.Result"

_LOOK_S = 0.1
_ACTION = "identify_bags"
_SERVICE = "identify"
_JOB = "flexarm_ident.answer"

PARAMETERS = read_table("flexarm_ident", "ident")


@dataclass
class _AtWork:
    """Job at work; `goal` is None for a call of the service."""

    name: str
    goal: ServerGoalHandle | None
    started_s: float
    stage: str = "its beginning"

    def __str__(self) -> str:
        return f"{self.name}, {self.stage}, {time.monotonic() - self.started_s:.0f} s so far"


class IdentNode(Node):
    """Node that wires the service and the action to `job.identify_bags`."""

    def __init__(self) -> None:
        super().__init__("ident", namespace="/flexarm")
        self._settings = Parameters(self, PARAMETERS, accept=_accept)
        self._at_work: _AtWork | None = None
        self._computation = Computation(_JOB)
        self._computation.start()
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
        self._computation.close()
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
            self._computation.cancel()
        return CancelResponse.ACCEPT

    def _on_cancel(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Cancel the job, whoever asked for it."""
        response.success = self._at_work is not None
        response.message = "no identification is at work"
        if self._at_work is not None:
            self._computation.cancel()
            response.message = f"cancelled: {self._at_work}"
        return response

    async def _answer(
        self, asked: Asked, answer: Answer, goal: ServerGoalHandle | None = None
    ) -> None:
        """Fill the answer: the model, or why there is none."""
        try:
            found = await self._identified(asked, goal)
            self._keep(found["parameters"])
            _fill(answer, found)
            self.get_logger().info(answer.message)
        except CancelledError as stopped:
            answer.message = f"{stopped}: nothing was written"
            self.get_logger().info(answer.message)
        except (FlexarmError, OSError) as error:
            answer.message = one_line(error)
            self.get_logger().error(answer.message)
        except Exception as error:  # noqa: BLE001 - a defect in one job does not end the node
            answer.message = f"internal error, see the log of the node: {error!r}"
            self.get_logger().error(traceback.format_exc())

    async def _identified(self, asked: Asked, goal: ServerGoalHandle | None) -> Mapping[str, Any]:
        """Compute the answer; the executor is free meanwhile."""
        if self._at_work is not None:
            raise IdentificationError(
                f"busy with another identification ({self._at_work}); no call is queued: try again "
                "when it is done"
            )
        request, executor, answered = self._request(asked), self.executor, Future()
        name = model_name(as_bags(asked.bag_uris)[0])
        at_work = self._at_work = _AtWork(name, goal, time.monotonic())

        def report(stage: str, fraction: float | None, _: object = None, /) -> None:
            at_work.stage = stage
            if goal is not None:
                goal.publish_feedback(IdentifyBags.Feedback(stage=stage, fraction=fraction))

        def wait() -> None:
            try:
                answered.set_result(self._computation.answer(report))
            except CancelledError:
                answered.set_exception(CancelledError(f"cancelled in {at_work.stage}"))
            except Exception as error:  # noqa: BLE001 - handed to the thread that asks
                answered.set_exception(error)
            if not self._stopping.is_set():
                executor.wake()

        watching = self._watched(has_goal=goal is not None)
        try:
            self._computation.begin(request)
            if goal is not None and goal.is_cancel_requested:
                self._computation.cancel()
            # A stage may take long: it must not keep a process that was told to stop.
            threading.Thread(target=wait, daemon=True, name="computation").start()
            found: Mapping[str, Any] = await answered
            return found
        finally:
            self.destroy_timer(watching)
            self._at_work = None

    def _watched(self, *, has_goal: bool) -> Timer:
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
                self._computation.cancel()
            # A call may come before its caller is discovered.
            has_callers = has_callers or callers > 0

        look()
        return self.create_timer(_LOOK_S, look)

    def _request(self, asked: Asked) -> dict[str, Any]:
        """Return the request of a call with the settings of now, see `answer.answered`."""
        settings, bags = self._settings.values(), as_bags(asked.bag_uris)
        root = user_path(settings["output_folder"]).absolute()
        return {
            "bags": list(map(str, bags)),
            "folder": str(root / model_name(bags[0])),
            "request": asdict(as_request(asked)),
            "channels": as_channels(asked),
            "exports": parse_exports(settings["exports"]),
            "force": settings["force"],
        }

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


def as_channels(message: Asked) -> dict[str, Any] | None:
    """Return the signals that a request or a goal names, as `selection` takes them; or None.

    Raises
    ------
    BagError
        When a name is invalid, or only inputs or outputs are named.
    """
    if message.inputs or message.outputs:
        channels = {
            "inputs": list(message.inputs),
            "outputs": list(message.outputs),
            "clock": message.clock or None,
            "interpolated": message.interpolated,
        }
        selection(**channels)
        return channels
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


def _fill(answer: Answer, found: Mapping[str, Any]) -> None:
    fields_of = dict(found)
    answer.parameters = [
        Parameter(key, value=value).to_parameter_msg()
        for key, value in fields_of.pop("parameters").items()
    ]
    answer.modes = [ModeSummary(**mode) for mode in fields_of.pop("modes")]
    for name, value in fields_of.items():
        setattr(answer, name, value)
    answer.success = True


def main() -> int:
    """Run the node."""
    return run_node(IdentNode)
