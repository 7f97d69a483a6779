"""Action of trajectories on a controller, with doubles of the messages that the wheels lack."""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType, SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from builtin_interfaces.msg import Duration
from std_msgs.msg import Header

from flexarm_core.rig_description import load_rig

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flexarm_control.following import Following

PER_RAD, PER_RAD_PER_S = 4.9110668154070565, 0.2014


class _Result(SimpleNamespace):
    SUCCESSFUL, INVALID_GOAL, INVALID_JOINTS = 0, -1, -2
    PATH_TOLERANCE_VIOLATED, GOAL_TOLERANCE_VIOLATED = -4, -5


class _Feedback(SimpleNamespace):
    def __init__(self, **fields: Any) -> None:  # noqa: ANN401
        super().__init__(header=Header(), **fields)


class _Goal:
    """Goal of a client, and what has become of it."""

    def __init__(
        self,
        name: str,
        *,
        path_rad: float = 0.0,
        path_rad_per_s: float = 0.0,
        goal_rad: float = 0.0,
        goal_s: int = 0,
    ) -> None:
        point = SimpleNamespace(positions=[0.4], velocities=[], time_from_start=Duration(sec=2))
        self.request = SimpleNamespace(
            trajectory=SimpleNamespace(joint_names=[name], points=[point]),
            path_tolerance=[SimpleNamespace(name=name, position=path_rad, velocity=path_rad_per_s)],
            goal_tolerance=[SimpleNamespace(name=name, position=goal_rad, velocity=0.0)],
            goal_time_tolerance=Duration(sec=goal_s),
        )
        self.is_cancel_requested = False
        self.state = ""
        self.feedback: list[Any] = []
        self.publish_feedback = self.feedback.append

    def succeed(self) -> None:
        self.state = "succeeded"

    def abort(self) -> None:
        self.state = "aborted"

    def canceled(self) -> None:
        self.state = "canceled"


class _Controller:
    """Controller of the thesis's arm, whose set-point is zero."""

    description = load_rig("thesis")
    executor = SimpleNamespace(wake=lambda: None)
    followed: Following | None = None
    look: Callable[[], None] | None = None
    action: Any = None

    def create_timer(self, _: float, look: Callable[[], None]) -> None:
        self.look = look

    def destroy_timer(self, _: None) -> None:
        pass

    def start_references(self) -> tuple[float, ...]:
        return (0.0,)

    def follow(self, following: Following) -> None:
        self.followed = following

    def follows(self, following: Following) -> bool:
        return self.followed is following

    def hold(self, following: Following) -> None:
        if self.followed is following:
            self.followed = None


@pytest.fixture
def controller(monkeypatch: pytest.MonkeyPatch) -> Iterator[_Controller]:
    doubles: Sequence[tuple[str, dict[str, object]]] = (
        (
            "control_msgs.action",
            {"FollowJointTrajectory": SimpleNamespace(Result=_Result, Feedback=_Feedback)},
        ),
        ("trajectory_msgs.msg", {"JointTrajectoryPoint": SimpleNamespace}),
    )
    for name, content in doubles:
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name.partition(".")[0], ModuleType(name.partition(".")[0]))
        monkeypatch.setitem(sys.modules, name, module)
    name = "flexarm_control.trajectory_action"
    monkeypatch.delitem(sys.modules, name, raising=False)
    module = import_module(name)
    monkeypatch.setattr(module, "ActionServer", lambda *_, **__: None)
    made = _Controller()
    made.action = module.TrajectoryAction(made)
    yield made
    sys.modules.pop(name, None)


def run(
    controller: Any,  # noqa: ANN401
    goal: _Goal,
    *steps: Callable[[], None],
) -> _Result:
    """Carry a goal out, with a look after each step."""
    work = controller.action._on_goal(goal)
    for step in (None, *steps, None):
        if step is not None:
            step()
        if controller.look is not None:
            controller.look()
        try:
            work.send(None)
        except StopIteration as ended:
            result: _Result = ended.value
            return result
    pytest.fail("the goal goes on")


def sample(
    controller: Any,  # noqa: ANN401
    time_s: float,
    position_rad: float,
    rad_per_s: float = 0.0,
) -> Callable[[], None]:
    outputs = [PER_RAD * position_rad, 0.0, 0.0, PER_RAD_PER_S * rad_per_s]

    def take() -> None:
        (controller.reference,) = controller.followed.references(round(1e9 * time_s), outputs)

    return take


def test_goal___followed_to_its_end___succeeds_with_feedback_in_rad(controller: Any) -> None:  # noqa: ANN401
    goal = _Goal("hub")
    steps = [sample(controller, time_s, 0.1) for time_s in (5.0, 6.0, 7.0)]
    result = run(controller, goal, *steps)
    assert (goal.state, result.error_code) == ("succeeded", 0)
    assert [each.desired.positions[0] for each in goal.feedback] == pytest.approx([0.0, 0.2, 0.4])
    assert goal.feedback[1].error.positions[0] == pytest.approx(0.1)
    assert goal.feedback[1].error.velocities[0] == pytest.approx(0.2)
    assert controller.reference == pytest.approx(0.4 * PER_RAD)
    assert controller.followed is None


def test_goal___cancelled_replaced_or_off_its_path___is_held(controller: Any) -> None:  # noqa: ANN401
    goal = _Goal("hub")

    def cancel() -> None:
        goal.is_cancel_requested = True

    run(controller, goal, sample(controller, 5.0, 0.0), cancel)
    assert goal.state == "canceled"

    def replace() -> None:
        controller.followed = None

    # Samples that have stopped for a while end a goal, also when they come again at once.
    silent = _Goal("hub")
    heard = iter([False, *[True] * 9])
    controller.follows = lambda _: next(heard)
    assert "took over" in run(controller, silent).error_string
    assert silent.state == "aborted"
    del controller.follows
    replaced = _Goal("hub")
    assert "took over" in run(controller, replaced, replace).error_string
    strict = _Goal("hub", path_rad=0.1)
    result = run(controller, strict, sample(controller, 5.0, 0.2))
    assert (strict.state, result.error_code) == ("aborted", -4)
    assert "path tolerance violated, the errors are -0.2 rad and 0.2 rad/s" in result.error_string


def test_goal___of_another_joint___is_refused(controller: Any) -> None:  # noqa: ANN401
    result = run(controller, _Goal("elbow"))
    assert (result.error_code, controller.followed) == (-2, None)
    assert "no joint 'elbow' (known: hub)" in result.error_string


def test_goal___with_tolerances___is_as_in_joint_trajectory_controller(controller: Any) -> None:  # noqa: ANN401
    slow = _Goal("hub", path_rad_per_s=0.05)
    steps = [sample(controller, time_s, 0.0, rate) for time_s, rate in ((5.0, 0.2), (6.0, 0.1))]
    result = run(controller, slow, *steps)
    assert (slow.state, result.error_code) == ("aborted", -4)
    assert "and 0.1 rad/s" in result.error_string
    # No time to reach the goal waits for ever, one second does not.
    late = [sample(controller, time_s, 0.1) for time_s in (5.0, 7.5, 8.5, 1000.0)]
    strict = _Goal("hub", goal_rad=0.01, goal_s=1)
    assert run(controller, strict, *late).error_code == -5
    patient = _Goal("hub", goal_rad=0.01)
    assert run(controller, patient, *late, sample(controller, 1001.0, 0.4)).error_code == 0
