from __future__ import annotations

import signal
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rclpy
from rcl_interfaces.srv import GetParameters
from rclpy.action import ActionClient
from rclpy.action.client import GoalStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter, parameter_value_to_python

from flexarm_ident.job import identify_bags
from flexarm_ident.models.files import load_model
from flexarm_ident.models.model_parameters import model_from_parameters
from flexarm_ident.workflow.request import Request
from flexarm_msgs.action import IdentifyBags
from flexarm_msgs.srv import Identify
from support.exhaustive import first_of
from support.identification_service import as_plain
from support.project import BAGS
from support.system_graph import Graph, eventually

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.system

# A second, and what a busy machine takes for the answers.
SOON_S = 2.0
# Takes some seconds, most of them for the choice of the order.
BAG = BAGS / "c_dat3_0g"
STAGES = [
    "reading",
    "Hankel matrices",
    "subspace",
    "refinement",
    "order",
    "fit",
    "reduction",
    "validation",
    "writing",
]


class Goal:
    """One goal and what came of it."""

    def __init__(self, graph: Graph, client: ActionClient, **fields: Any) -> None:  # noqa: ANN401
        self.feedback: list[IdentifyBags.Feedback] = []
        self._graph = graph
        future = client.send_goal_async(
            IdentifyBags.Goal(**fields), feedback_callback=self._on_feedback
        )
        graph.wait(future.done, "the answer to the goal")
        self._handle = future.result()
        assert self._handle.accepted
        self._result = self._handle.get_result_async()

    @property
    def ended(self) -> bool:
        """Whether the result is there."""
        return bool(self._result.done())

    def wait_for_feedback(self) -> None:
        """Wait until the work has begun."""
        self._graph.wait(lambda: bool(self.feedback), "feedback")

    def cancel(self) -> int:
        """Ask to cancel it; return how many goals are being cancelled."""
        future = self._handle.cancel_goal_async()
        self._graph.wait(future.done, "the answer to the cancelling")
        return len(future.result().goals_canceling)

    def result(self) -> tuple[int, IdentifyBags.Result]:
        """Wait for the end and return status and result."""
        self._graph.wait(self._result.done, "the result")
        answer = self._result.result()
        return answer.status, answer.result

    def _on_feedback(self, message: Any) -> None:  # noqa: ANN401 - generated type
        self.feedback.append(message.feedback)


@pytest.fixture
def models(tmp_path: Path) -> Path:
    return tmp_path / "models"


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return one graph with a node for all goals that leave it alive."""
    with Graph(tmp_path_factory.mktemp("running")) as graph:
        graph.start("ident", {"exports": "json,mat,h"})
        yield graph


@pytest.fixture(scope="module")
def client(running: Graph) -> Iterator[ActionClient]:
    with client_of(running) as made:
        yield made


@pytest.fixture
def laboratory(running: Graph, models: Path) -> Graph:
    """Return that graph, its node with a folder of this test alone."""
    assert running.refusal("ident", {"output_folder": str(models)}) == ""
    return running


@contextmanager
def client_of(graph: Graph) -> Iterator[ActionClient]:
    client = ActionClient(graph.node, IdentifyBags, "identify_bags")
    graph.wait(client.server_is_ready, "the action server")
    graph.operator.acquaint("ident")
    try:
        yield client
    finally:
        client.destroy()


def files_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*")) if folder.exists() else []


def test_goal___says_its_stages_and_answers_as_the_service_does(
    laboratory: Graph, client: ActionClient, models: Path
) -> None:
    fields: dict[str, Any] = {
        "bag_uris": [str(BAG)],
        "block_rows": 20,
        "reduction": "mrm",
        "remove_compensation": True,
        "stabilise": True,
    }
    goal = Goal(laboratory, client, **fields)
    status, result = goal.result()

    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert result.success
    laboratory.wait(lambda: goal.feedback[-1].stage == "writing", "the last feedback")
    fractions = [each.fraction for each in goal.feedback]
    assert fractions == sorted(fractions)
    news = [(each.stage, each.fraction) for each in goal.feedback]
    assert len(set(news)) == len(news)
    stages = [stage for k, (stage, _) in enumerate(news) if k == 0 or news[k - 1][0] != stage]
    assert len(set(stages)) == len(stages)
    assert 0.0 <= fractions[0] < 0.1
    assert fractions[-1] <= 1.0
    assert list(dict.fromkeys(each.stage for each in goal.feedback)) == STAGES

    response = laboratory.call(Identify, "identify", Identify.Request(**fields))
    assert response.success
    for field in ("parameters", "modes", "dmv", "sfv", "warnings", "report_path"):
        assert getattr(result, field) == getattr(response, field)

    folder = models / BAG.name
    assert result.report_path == str(folder)
    assert files_in(models) == [
        BAG.name,
        *(f"model.{suffix}" for suffix in ("h", "json", "mat", "yaml")),
        "report.html",
    ]
    answered = {each.name: Parameter.from_parameter_msg(each).value for each in result.parameters}
    expected = model_from_parameters(
        BAG.name,
        {
            key: value if isinstance(value, (str, int, float)) else list(value)
            for key, value in answered.items()
        },
    )
    for suffix in ("json", "mat", "yaml"):
        found = load_model(folder / f"model.{suffix}")
        assert found.A.tobytes() == expected.A.tobytes()
        assert found.B.tobytes() == expected.B.tobytes()


def test_cancelled_goal___ends_so_and_leaves_no_file(
    laboratory: Graph, client: ActionClient, models: Path
) -> None:
    goal = Goal(laboratory, client, bag_uris=[str(BAG)])
    goal.wait_for_feedback()

    began_s = time.monotonic()
    assert goal.cancel() == 1
    status, result = goal.result()
    assert time.monotonic() - began_s < SOON_S

    assert status == GoalStatus.STATUS_CANCELED
    assert not result.success
    assert result.message.startswith("cancelled in ")
    assert not result.parameters
    assert files_in(models) == []
    again = Goal(laboratory, client, bag_uris=[str(BAG)], order=8, block_rows=20)
    assert again.result()[0] == GoalStatus.STATUS_SUCCEEDED


def test_goal_whose_client_is_gone___is_cancelled_and_leaves_no_file(
    graph: Graph, tmp_path: Path
) -> None:
    # A graph of its own: the node goes on while any client of its action is there.
    models = tmp_path / "models"
    graph.start("ident", {"output_folder": str(models)})
    context = rclpy.Context()
    context.init(domain_id=graph.node.context.get_domain_id())
    node = rclpy.create_node("leaving", namespace="/flexarm", context=context)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    leaving = ActionClient(node, IdentifyBags, "identify_bags")
    heard: list[Any] = []

    def begun() -> bool:
        executor.spin_once(timeout_sec=0.1)
        return bool(heard)

    graph.wait(leaving.server_is_ready, "the action server")
    # Long enough for its end to be noticed on a busy machine.
    goal = IdentifyBags.Goal(bag_uris=[str(BAG)], refine=True)
    leaving.send_goal_async(goal, feedback_callback=heard.append)
    eventually(begun, "feedback")
    leaving.destroy()
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()
    context.destroy()

    request = Identify.Request(bag_uris=["/nowhere/run"])

    def is_free() -> bool:
        return "busy" not in graph.call(Identify, "identify", request).message

    graph.wait(is_free, "the end of the job")
    assert files_in(models) == []


def test_node_at_work___answers_and_says_that_it_is_busy(
    laboratory: Graph, client: ActionClient
) -> None:
    goal = Goal(laboratory, client, bag_uris=[str(BAG)])
    goal.wait_for_feedback()

    names = ["output_folder", "exports"]
    values = laboratory.call(
        GetParameters, "ident/get_parameters", GetParameters.Request(names=names)
    ).values
    refused = laboratory.call(Identify, "identify", Identify.Request(bag_uris=[str(BAG)]))
    status, result = Goal(laboratory, client, bag_uris=[str(BAG)]).result()

    assert not goal.ended
    assert parameter_value_to_python(values[1]) == "json,mat,h"
    for answer in (refused, result):
        assert not answer.success
        assert "busy with another identification" in answer.message
    assert status == GoalStatus.STATUS_ABORTED
    status, result = goal.result()
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message


@pytest.mark.exhaustive
def test_service___call_with_the_bag_alone___is_the_model_of_the_command(
    laboratory: Graph, tmp_path: Path
) -> None:
    response = laboratory.call(Identify, "identify", Identify.Request(bag_uris=[str(BAG)]))

    assert response.success, response.message
    expected = identify_bags([BAG], tmp_path / "command", Request())
    assert list(response.dmv) == pytest.approx(list(expected.dmv), rel=1e-9)
    answered = model_from_parameters(
        BAG.name,
        {
            each.name: as_plain(Parameter.from_parameter_msg(each).value)
            for each in response.parameters
        },
    )
    assert np.abs(np.linalg.eigvals(answered.A)).max() < 1.0


def test_goal_that_fails___is_aborted_with_one_line(
    laboratory: Graph, client: ActionClient
) -> None:
    status, result = Goal(laboratory, client, bag_uris=["/nowhere/run"]).result()
    assert status == GoalStatus.STATUS_ABORTED
    assert result.message == "/nowhere/run: no such bag"


@pytest.mark.parametrize("reported", first_of([signal.SIGINT, signal.SIGTERM]))
def test_signal_at_work___ends_the_node_and_leaves_no_file(
    graph: Graph, models: Path, reported: signal.Signals
) -> None:
    ident = graph.start("ident", {"output_folder": str(models), "exports": "json,mat,h"})
    with client_of(graph) as client:
        goal = Goal(graph, client, bag_uris=[str(BAG)])
        goal.wait_for_feedback()

        assert graph.stop(ident, reported) == 0

    assert "Traceback" not in ident.printed
    assert "terminate called" not in ident.printed
    assert files_in(models) == []


def test_exports_that_are_unknown___are_refused(laboratory: Graph) -> None:
    refusal = laboratory.refusal("ident", {"exports": "json,slx"})
    assert refusal == "parameter exports: no format 'slx' to export: choose from json, mat, h"
    laboratory.check()
