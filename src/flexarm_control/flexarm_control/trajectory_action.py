"""Action `FollowJointTrajectory` of the controller, by which MoveIt and others drive the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectoryPoint

from flexarm_control.following import Following, Tolerances
from flexarm_control.planning.joint_trajectory import Moment, Point, places_of, trajectory_through
from flexarm_core.errors import SettingError
from flexarm_node.stamps import set_stamp

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import RigDescription

_FEEDBACK_S = 0.05
_Result = FollowJointTrajectory.Result


class Controller(Protocol):
    """What the action needs of the controller."""

    description: RigDescription

    def start_references(self) -> tuple[float, ...]:
        """Return the set-points in force; SettingError when a trajectory cannot begin."""

    def follow(self, following: Following) -> None:
        """Follow a trajectory from the next sample on."""

    def follows(self, following: Following) -> bool:
        """Return whether the set-points still come from a trajectory."""

    def hold(self, following: Following) -> None:
        """Keep the set-points where a trajectory has brought them."""


class TrajectoryAction:
    """Server of the action on a controller node.

    A trajectory begins at the next sample. A set-point of anybody, or another trajectory, takes its
    place.

    Parameters
    ----------
    node : Controller
        The node.
    """

    def __init__(self, node: Any) -> None:  # noqa: ANN401 - a Controller that is a Node
        self._node = node
        self.server = ActionServer(
            node,
            FollowJointTrajectory,
            "~/follow_joint_trajectory",
            self._on_goal,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    async def _on_goal(self, goal: Any) -> FollowJointTrajectory.Result:  # noqa: ANN401
        controller: Controller = self._node
        tracks = controller.description.tracks
        names = [each.name for each in tracks]
        try:
            places = places_of(goal.request.trajectory.joint_names, names)
        except SettingError as error:
            return _aborted(goal, _Result.INVALID_JOINTS, str(error))
        try:
            following = following_of(goal.request, places, controller)
        except SettingError as error:
            return _aborted(goal, _Result.INVALID_GOAL, str(error))
        controller.follow(following)
        news = Future()

        def look() -> None:
            news.set_result(None)
            self._node.executor.wake()

        timer = self._node.create_timer(_FEEDBACK_S, look)
        try:
            while (
                following.ended is None
                and controller.follows(following)
                and not goal.is_cancel_requested
            ):
                await news
                news = Future()
                if following.feedback is not None:
                    goal.publish_feedback(_feedback(following, names))
        finally:
            self._node.destroy_timer(timer)
        controller.hold(following)
        return _ended(goal, following)


def following_of(
    request: FollowJointTrajectory.Goal, places: Sequence[int], controller: Controller
) -> Following:
    """Return the trajectory of a goal, whose joints stand in places of its own.

    Raises
    ------
    SettingError
        When it cannot be followed.
    """
    rig = controller.description
    outputs = [rig.output(each.output) for each in rig.tracks]
    per_rad = np.array([each.per_si or 1.0 for each in outputs])
    start = np.array(controller.start_references()) / per_rad
    points = [
        Point(
            _seconds(each.time_from_start),
            _in_order(each.positions, places),
            _in_order(each.velocities, places),
        )
        for each in request.trajectory.points
    ]
    travels = {
        each.name: (each.low / unit, each.high / unit)
        for each, unit in zip(rig.tracks, per_rad, strict=True)
    }
    goal_s = _seconds(request.goal_time_tolerance)
    tolerances = Tolerances(
        _largest(request.path_tolerance, list(travels)),
        _largest(request.goal_tolerance, list(travels)),
        # As in joint_trajectory_controller, no time waits for ever.
        goal_s if goal_s > 0.0 else np.inf,
    )
    return Following(
        trajectory_through(start.tolist(), points, travels), tolerances, _measured(rig), per_rad
    )


def _measured(rig: RigDescription) -> Callable[[Sequence[float]], Moment]:
    """Return the function that takes positions and velocities of the joints from outputs.

    A joint without an output for its rate has a velocity that is not a number.
    """
    rates = {joint.angle: joint.rate for joint in rig.joints}

    def scaled(names: Sequence[str | None]) -> tuple[list[int], FloatArray]:
        places = [rig.output_names.index(name) if name else 0 for name in names]
        found = [rig.output(name).per_si or 1.0 if name else np.nan for name in names]
        return places, np.array(found)

    angle_places, per_rad = scaled([each.output for each in rig.tracks])
    rate_places, per_rad_per_s = scaled([rates.get(each.output) for each in rig.tracks])

    def measured(outputs: Sequence[float]) -> Moment:
        values = np.asarray(outputs)
        return Moment(values[angle_places] / per_rad, values[rate_places] / per_rad_per_s)

    return measured


def _in_order(values: Sequence[float], places: Sequence[int]) -> list[float]:
    """Return the values of a point in the order of the joints; of another number as they are."""
    return [values[place] for place in places] if len(values) == len(places) else list(values)


def _largest(tolerances: Sequence[Any], names: Sequence[str]) -> FloatArray:
    """Return the largest errors, (2, joints), rad and rad/s; zero and less are none in the message.

    Those of accelerations are not taken: no joint measures one.
    """
    errors = {each.name: (each.position, each.velocity) for each in tolerances}
    given = np.array([errors.get(name, (0.0, 0.0)) for name in names]).T
    return np.where(given > 0.0, given, np.inf)


def _seconds(duration: Any) -> float:  # noqa: ANN401
    return float(duration.sec + 1e-9 * duration.nanosec)


def _feedback(following: Following, names: Sequence[str]) -> FollowJointTrajectory.Feedback:
    feedback = following.feedback
    assert feedback is not None  # noqa: S101 - the caller has looked
    message = FollowJointTrajectory.Feedback(
        joint_names=list(names),
        desired=_point(feedback.desired),
        actual=_point(feedback.actual),
        error=_point(feedback.error),
    )
    set_stamp(message.header.stamp, feedback.taken_ns)
    return message


def _point(moment: Moment) -> JointTrajectoryPoint:
    """Return a point with velocities where all joints have one."""
    point = JointTrajectoryPoint(positions=moment.positions)
    if np.isfinite(moment.velocities).all():
        point.velocities = moment.velocities
    return point


def _ended(goal: Any, following: Following) -> FollowJointTrajectory.Result:  # noqa: ANN401
    if following.ended == "":
        goal.succeed()
        return _Result(error_code=_Result.SUCCESSFUL)
    if following.ended is not None:
        codes = {
            Following.PATH: _Result.PATH_TOLERANCE_VIOLATED,
            Following.GOAL: _Result.GOAL_TOLERANCE_VIOLATED,
        }
        assert following.feedback is not None  # noqa: S101 - a sample has ended it
        errors = [", ".join(f"{each:.3g}" for each in row) for row in following.feedback.error]
        said = "{} tolerance violated, the errors are {} rad and {} rad/s".format(
            following.ended, *errors
        )
        return _aborted(goal, codes[following.ended], said)
    if goal.is_cancel_requested:
        goal.canceled()
        return _Result(error_string="cancelled: the joints are held")
    return _aborted(goal, _Result.INVALID_GOAL, "another set-point or the end of the run took over")


def _aborted(goal: Any, code: int, said: str) -> FollowJointTrajectory.Result:  # noqa: ANN401
    goal.abort()
    return _Result(error_code=code, error_string=said)
