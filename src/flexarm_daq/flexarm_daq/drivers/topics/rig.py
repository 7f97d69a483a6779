"""Rig that is a ROS 2 robot with effort controllers."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flexarm_daq.drivers.topics.inbox import Inbox
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from typing import Protocol

    from flexarm_daq.drivers.topics.inbox import TopicsSettings
    from flexarm_daq.rigs.rig_protocol import RigSample

    class Robot(Protocol):
        """Way to a robot; `robot_node.RobotNode` is one."""

        def await_listener(self, patience_s: float) -> bool:
            """Wait for a reader of the commands; return whether there is one."""

        def has_listener(self) -> bool:
            """Return whether anybody reads the commands."""

        def other_reader(self) -> str:
            """Return who reads their topic otherwise; empty where nobody does."""

        def command(self, values: Sequence[float]) -> None:
            """Send a command."""

        def close(self) -> None:
            """Leave the robot."""


_DISCOVERY_S: Final = 5.0
"""Nodes find each other in some seconds at most."""


class TopicsRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` on the topics of a robot.

    Each message of joint states is a sample, at the instant of its stamp; other sensors are taken
    as they are then. Nothing stops the robot when this process is killed: `ros2_control` keeps the
    last command of a forward controller.

    Parameters
    ----------
    settings : TopicsSettings
        Topics and sources.
    inputs : int
        Number of commands.
    """

    has_own_clock: ClassVar[bool] = True

    def __init__(self, settings: TopicsSettings, inputs: int) -> None:
        self.settings = settings
        self._inputs = inputs
        self._robot: Robot | None = None

    def open(self) -> None:
        """Find the robot, wait for its first sample and command zero; see `Rig.open`."""
        if self._robot is not None:
            return
        self._inbox = Inbox(self.settings)
        self._robot = self._joined()
        try:
            self._begin(self._robot)
        except BaseException:
            self.close()
            raise

    def read(self) -> RigSample:
        """Wait for the next joint states; see `Rig.read`."""
        self._opened()
        try:
            return self._inbox.sample(self.settings.stale_s)
        except BaseException:
            self.safe_stop()
            raise

    def write(self, commands: Sequence[float]) -> None:
        """Publish a command; see `Rig.write`."""
        robot = self._opened()
        values = np.asarray(commands, dtype=float)
        if values.shape != (self._inputs,) or not np.isfinite(values).all():
            self.safe_stop()
            raise RigError(f"commands must be {self._inputs} finite numbers, got {commands}")
        if not robot.has_listener():
            raise RigError(
                f"nobody reads {self.settings.commands} any more: activate the robot's controller, "
                "then activate again"
            )
        robot.command(values.tolist())

    def safe_stop(self) -> None:
        """Command zero; never raises."""
        if self._robot is not None:
            # A context that a signal has ended publishes no more.
            with suppress(Exception):
                self._robot.command([0.0] * self._inputs)

    def close(self) -> None:
        """Command zero and leave the robot; see `Rig.close`."""
        self.safe_stop()
        robot, self._robot = self._robot, None
        if robot is not None:
            robot.close()

    def _begin(self, robot: Robot) -> None:
        if not robot.await_listener(_DISCOVERY_S):
            remedy = "is the robot's effort controller active, in this ROS_DOMAIN_ID?"
            raise RigError(
                f"nobody reads {self.settings.commands}: {robot.other_reader() or remedy}"
            )
        robot.command([0.0] * self._inputs)
        self._inbox.sample(_DISCOVERY_S)

    def _opened(self) -> Robot:
        if self._robot is None:
            raise RigError("the rig of topics is not open: call open() first")
        return self._robot

    def _joined(self) -> Robot:
        try:
            from flexarm_daq.drivers.topics.robot_node import RobotNode  # noqa: PLC0415
        except ImportError as error:
            raise RigError(f"the driver topics needs ROS 2 ({error}): source it") from None
        return RobotNode(self.settings, self._inbox)
