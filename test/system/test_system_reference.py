"""Set-points by the documented ways: each is in force, and stays so."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from flexarm_msgs.srv import SetReference
from flexarm_node import qos
from flexarm_node.topics.waiting import SharedTopic
from support.system_graph import ROOT, Graph

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.system


def in_force(graph: Graph) -> float:
    """Return the set-point in force: a refusal tells it and changes nothing."""
    response = graph.call(SetReference, "set_reference", SetReference.Request(reference_v=math.nan))
    assert not response.success
    return float(response.reference_v)


def set_reference(graph: Graph, reference_v: float) -> SetReference.Response:
    """Call the service."""
    request = SetReference.Request(reference_v=reference_v)
    response: SetReference.Response = graph.call(SetReference, "set_reference", request)
    return response


@pytest.fixture
def running(graph: Graph, tmp_path: Path) -> Graph:
    """Return a loop that runs and is recorded."""
    graph.start("recorder", {"bag": str(tmp_path / "bag")})
    graph.start("controller", {"law": "pd"})
    graph.start("daq", {"rate_hz": 100.0})
    graph.activate_loop()
    graph.operator.start_sampling()
    return graph


@pytest.mark.exhaustive
def test_set_points_by_the_service___beside_a_recorder___are_all_in_force_and_reported(
    running: Graph,
) -> None:
    reported: list[float] = []
    running.node.create_subscription(
        Float64, "reference", lambda message: reported.append(message.data), qos.EVERY
    )
    given = np.linspace(-2.0, 2.0, 100).tolist()
    running.operator.acquaint("controller")

    replies = [set_reference(running, reference_v) for reference_v in given]

    assert [(reply.success, reply.reference_v) for reply in replies] == [
        (True, pytest.approx(each)) for each in given
    ]
    running.wait(lambda: reported[-100:] == given, "every set-point on the topic")
    assert in_force(running) == pytest.approx(given[-1])


@pytest.mark.exhaustive
def test_set_point_while_the_drive_is_held___says_so(running: Graph) -> None:
    assert running.call(Trigger, "emergency_stop", Trigger.Request()).success

    # What was on its way when the stop was asked for still shows the command.
    running.wait(lambda: set_reference(running, 0.5).message != "", "words of the held drive")

    held = set_reference(running, 0.5)
    assert held.success
    assert held.message == "no command drives the arm: flexarm status says what holds it"


@pytest.fixture(scope="module")
def lone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return a controller that nobody asks for commands."""
    with Graph(tmp_path_factory.mktemp("lone")) as graph:
        graph.start("controller")
        yield graph


def test_shared_topic___hears_others_and_not_itself(graph: Graph) -> None:
    heard: list[float] = []
    shared: SharedTopic[Float64] = SharedTopic(
        graph.node,
        Float64,
        "shared",
        sent=qos.SENT,
        read=qos.EVERY,
    )

    def hears(number: float) -> bool:
        if (message := shared.newest()) is not None:
            heard.append(message.data)
        return number in heard

    other = graph.node.create_publisher(Float64, "shared", qos.SENT)
    graph.wait(lambda: shared.publisher.get_subscription_count() == 1, "the node itself")
    graph.wait(lambda: other.get_subscription_count() == 1, "the other")

    for number in range(20):
        shared.publish(Float64(data=-1.0))
        other.publish(Float64(data=float(number)))
        graph.wait(lambda number=number: hears(number), "the other's message")  # type: ignore[misc]

    assert heard == [float(number) for number in range(20)]


def test_set_points_by_the_verb_and_by_a_stream___are_in_force(running: Graph) -> None:
    process = running.run([str(ROOT / "flexarm"), "reference", "-1.25"])
    assert process.exit_code() == 0
    assert process.printed == "set-point -1.25 V\n"
    assert in_force(running) == pytest.approx(-1.25)

    stream = running.node.create_publisher(Float64, "reference", qos.SENT)

    def follows() -> bool:
        stream.publish(Float64(data=0.75))
        return in_force(running) == pytest.approx(0.75)

    running.wait(follows, "the stream")


def test_set_point_on_the_topic___of_a_controller_that_is_not_active___is_that_of_its_start(
    lone: Graph,
) -> None:
    assert lone.refusal("controller", {"reference": "topic"}) == ""
    lone.operator.configure("controller")
    stream = lone.node.create_publisher(Float64, "reference", qos.SENT)
    lone.wait(lambda: stream.get_subscription_count() == 1, "the controller")

    def follows() -> bool:
        stream.publish(Float64(data=-0.25))
        return in_force(lone) == pytest.approx(-0.25)

    lone.wait(follows, "the set-point")


@pytest.mark.parametrize(
    ("reference_v", "profile", "reason"),
    [
        (7.0, "topic", "reference 7 V refused: the travel is +-6.857 V, 80 deg"),
        (-math.inf, "topic", "reference -inf V refused: the travel is +-6.857 V, 80 deg"),
        (
            1.0,
            "step",
            "reference 1 V refused: the controller follows its own, step: set reference to topic",
        ),
    ],
)
def test_set_point_that_cannot_be_in_force___is_refused_with_the_one_that_is(
    lone: Graph, reference_v: float, profile: str, reason: str
) -> None:
    assert lone.refusal("controller", {"reference": "topic"}) == ""
    before = set_reference(lone, 0.5)
    assert before.success
    assert before.message == "the controller is not active, activate controller"
    assert lone.refusal("controller", {"reference": profile}) == ""

    response = set_reference(lone, reference_v)

    assert (response.success, response.message) == (False, reason)
    assert response.reference_v == pytest.approx(0.5)
