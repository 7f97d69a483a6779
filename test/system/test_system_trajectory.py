"""Action FollowJointTrajectory of the controller, by a client as MoveIt has one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rclpy.action import ActionClient

from flexarm_control.twin import twin_description
from flexarm_core.rig_description import described
from flexarm_ident.models.files import save_model
from flexarm_msgs.msg import IoSample
from flexarm_msgs.srv import SetReference
from flexarm_node import qos
from support.servo_plants import two_joints

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system

_FLOWING = 100
_MISSING = "control_msgs of a ROS 2 installation is not there"
actions = pytest.importorskip("control_msgs.action", reason=_MISSING)
control_messages = pytest.importorskip("control_msgs.msg", reason=_MISSING)
trajectory_messages = pytest.importorskip("trajectory_msgs.msg", reason=_MISSING)


@pytest.fixture
def client(graph: Graph, tmp_path: Path) -> Iterator[Any]:
    ends = {
        **dict.fromkeys(("input_low", "output_low"), [-1.0] * 2),
        **dict.fromkeys(("input_high", "output_high"), [1.0] * 2),
        "noise_sd": [1e-4] * 2,
    }
    model = tmp_path / "model.yaml"
    save_model(model, two_joints(), name="arm", provenance=ends)
    rig = tmp_path / "rig.yaml"
    rig.write_text(twin_description(model))
    assert [each.name for each in described(rig.read_text()).tracks] == ["joint_1", "joint_2"]
    graph.start("controller", {"rig": str(rig), "law": "pd"})
    graph.start("daq", {"rig": str(rig)})
    graph.activate_loop()
    assert graph.transition("daq", "activate")
    found = ActionClient(
        graph.node, actions.FollowJointTrajectory, "controller/follow_joint_trajectory"
    )
    graph.wait(found.server_is_ready, "the server")
    yield found
    found.destroy()


def goal_of(names: Sequence[str], *points: tuple[Any, ...]) -> Any:  # noqa: ANN401
    """Return a goal through points of a time, positions, and velocities or none."""
    goal = actions.FollowJointTrajectory.Goal()
    goal.trajectory.joint_names = list(names)
    for time_s, positions, *velocities in points:
        point = trajectory_messages.JointTrajectoryPoint(
            positions=list(positions), velocities=list(*velocities)
        )
        point.time_from_start.sec = int(time_s)
        point.time_from_start.nanosec = int(1e9 * (time_s % 1.0))
        goal.trajectory.points.append(point)
    return goal


def begun(graph: Graph, client: Any, goal: Any, feedback: list[Any]) -> Any:  # noqa: ANN401
    asked = client.send_goal_async(goal, feedback_callback=feedback.append)
    graph.wait(asked.done, "the answer to a goal")
    assert asked.result().accepted
    return asked.result()


def ended(graph: Graph, handle: Any) -> Any:  # noqa: ANN401
    asked = handle.get_result_async()
    graph.wait(asked.done, "the result")
    return asked.result().result


def test_trajectory___is_followed_cancelled_replaced_or_refused(graph: Graph, client: Any) -> None:  # noqa: ANN401
    heard: list[IoSample] = []
    graph.node.create_subscription(IoSample, "io", heard.append, qos.NEWEST)
    # The first samples of a run come slowly, and a goal ends where they stop for a second.
    graph.wait(lambda: len(heard) > _FLOWING, "samples")

    def refused(goal: Any) -> str:  # noqa: ANN401
        result = ended(graph, begun(graph, client, goal, []))
        assert result.error_code < 0
        return str(result.error_string)

    assert "no joint 'joint_3'" in refused(goal_of(["joint_3"], (1.0, [0.1])))
    both = ["joint_2", "joint_1"]
    assert "point 2 at 1 s is not after" in refused(goal_of(both, (1.0, [0, 0]), (1.0, [0, 0])))
    assert "its travel is" in refused(goal_of(both, (1.0, [0.0, 1.9])))
    assert "move at the last point, 1:" in refused(goal_of(both, (1.0, [0.1, 0.1], [0.1, 0.0])))

    feedback: list[Any] = []
    goal = goal_of(both, (1.0, [-0.2, 0.3]), (2.0, [-0.25, 0.5]))
    result = ended(graph, begun(graph, client, goal, feedback))
    assert (result.error_code, result.error_string) == (0, "")
    wanted = np.array([each.feedback.desired.positions for each in feedback])
    assert (np.diff(wanted[:, 0]) >= 0.0).all()
    assert np.ptp(wanted[:, 0]) > 0.1
    graph.wait(
        lambda: np.allclose(heard[-1].outputs, [0.5, -0.25], atol=0.02), "the end of the trajectory"
    )

    # As MoveIt plans: from a point at zero, with velocities, to rest.
    planned = goal_of(
        both,
        (0.0, [-0.25, 0.5], [0.0, 0.0]),
        (0.5, [-0.1, 0.35], [0.3, -0.3]),
        (1.0, [0.0, 0.2], [0.0, 0.0]),
    )
    assert ended(graph, begun(graph, client, planned, [])).error_code == 0
    graph.wait(
        lambda: np.allclose(heard[-1].outputs, [0.2, 0.0], atol=0.02), "the end of a planned one"
    )

    slow = goal_of(both, (600.0, [0.25, -0.5]))
    handle = begun(graph, client, slow, feedback)
    graph.wait(handle.cancel_goal_async().done, "the cancelling")
    assert "held" in ended(graph, handle).error_string
    handle = begun(graph, client, slow, feedback)
    request = SetReference.Request(reference_v=0.0, joint="joint_1")
    assert graph.call(SetReference, "set_reference", request).success
    assert "took over" in ended(graph, handle).error_string
    graph.wait(lambda: abs(heard[-1].outputs[0]) < 0.02, "the set-point")

    strict = goal_of(both, (0.1, [0.9, 0.9]))
    strict.path_tolerance = [control_messages.JointTolerance(name="joint_1", position=0.01)]
    assert "path tolerance violated" in refused(strict)
