"""Robot with two joints that talks as ros2_control does: its broadcaster's and controller's names.

A joint is a turning mass with drag: inertia 0.1, drag 0.2. The command is kept until the next one,
as a forward_command_controller keeps it. Its time is that of its stamps: while it is driven, it
waits some seconds for the answer to each state, so that a busy machine only makes it slow.
"""

from __future__ import annotations

import sys

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

# The broadcaster has its own order, not that of the commands.
NAMES = ("elbow", "shoulder")
COMMANDED = ("shoulder", "elbow")
RATE_HZ = 200
PATIENCE_TICKS = 10 * RATE_HZ
INERTIA, DRAG = 0.1, 0.2


class Robot(Node):  # type: ignore[misc]
    """Node of the robot."""

    def __init__(self) -> None:
        super().__init__("robot")
        self.waited = 0
        self.time_ns = self.get_clock().now().nanoseconds
        self.states = self.create_publisher(JointState, "joint_states", 10)
        self.imu = self.create_publisher(Imu, "tip/imu", 10)
        self.create_subscription(
            Float64MultiArray, "effort_controller/commands", self.on_command, 10
        )
        self.efforts = dict.fromkeys(NAMES, 0.0)
        self.angles = dict.fromkeys(NAMES, 0.0)
        self.rates = dict.fromkeys(NAMES, 0.0)
        self.create_timer(1.0 / RATE_HZ, self.step)

    def on_command(self, command: Float64MultiArray) -> None:
        """Keep a command, and say when it is another one; one of another length is ignored."""
        if len(command.data) != len(COMMANDED):
            self.get_logger().error(f"{len(command.data)} numbers for {len(COMMANDED)} joints")
            return
        efforts = dict(zip(COMMANDED, command.data, strict=True))
        if any(efforts.values()) != any(self.efforts.values()):
            print("driven" if any(efforts.values()) else "zero", flush=True)  # noqa: T201
        self.efforts = efforts
        self.waited = 0

    def step(self) -> None:
        """Move by a period and publish the states."""
        if any(self.efforts.values()) and 0 < self.waited < PATIENCE_TICKS:
            self.waited += 1
            return
        self.waited = 1
        self.time_ns += round(1e9 / RATE_HZ)
        for name in NAMES:
            self.rates[name] += (self.efforts[name] - DRAG * self.rates[name]) / INERTIA / RATE_HZ
            self.angles[name] += self.rates[name] / RATE_HZ
        state = JointState(name=list(NAMES))
        state.header.stamp = Time(nanoseconds=self.time_ns).to_msg()
        state.position = [self.angles[name] for name in NAMES]
        state.velocity = [self.rates[name] for name in NAMES]
        state.effort = [self.efforts[name] for name in NAMES]
        imu = Imu()
        imu.angular_velocity.z = self.rates["shoulder"] + self.rates["elbow"]
        self.imu.publish(imu)
        self.states.publish(state)


def main() -> None:
    """Run until a signal."""
    rclpy.init()
    robot = Robot()
    print("ready", flush=True)  # noqa: T201
    try:
        rclpy.spin(robot)
    except (KeyboardInterrupt, ExternalShutdownException):
        sys.exit()


if __name__ == "__main__":
    main()
