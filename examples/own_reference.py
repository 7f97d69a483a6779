"""A ROS 2 node of one's own that gives set-points: one smooth move, and how the arm follows it."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from statistics import fmean

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64

from flexarm_msgs.msg import ArmState

MOVE_V, MOVE_S, LENGTH_S, RATE_HZ = 2.0, 4.0, 8.0, 50.0
SILENT_S = 10.0

# Latched, as every writer of set-points: who comes later is told the one in force.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# Samples to look at: the DAQ node neither waits for this reader nor repeats what it has lost.
SEEN = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


class OwnReference(Node):
    """Node that leads the arm along a raised cosine, from where it is."""

    def __init__(self) -> None:
        super().__init__("own_reference", namespace="flexarm")
        self.references = self.create_publisher(Float64, "reference", LATCHED)
        self.create_subscription(ArmState, "state", self.on_state, SEEN)
        self.start: tuple[float, float] | None = None
        self.passed_s, self.sent, self.heard_s = 0.0, 0, time.monotonic()
        self.errors_v: list[float] = []

    def on_state(self, state: ArmState) -> None:
        """Give the set-point of a sample's instant: the arm's time stands when it must wait."""
        self.heard_s = time.monotonic()
        stamp_s = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
        self.start = start_s, start_v = self.start or (stamp_s, state.position_v)
        self.passed_s = stamp_s - start_s
        turn = math.pi * min(self.passed_s / MOVE_S, 1.0)
        reference_v = start_v + MOVE_V * (1.0 - math.cos(turn)) / 2.0
        self.errors_v.append(abs(reference_v - state.position_v))
        if self.passed_s * RATE_HZ >= self.sent:
            self.references.publish(Float64(data=reference_v))
            self.sent += 1


def main() -> None:
    """Lead the arm until the time is over, or until Ctrl-C."""
    rclpy.init()
    node = OwnReference()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        while node.passed_s < LENGTH_S:
            rclpy.spin_once(node, timeout_sec=1.0)
            if time.monotonic() - node.heard_s > SILENT_S:
                raise SystemExit("no samples: does ./flexarm up run in this ROS domain?")
    print(f"{node.sent} set-points in {node.passed_s:.1f} s")
    largest_v, mean_v = max(node.errors_v, default=0.0), fmean(node.errors_v or [0.0])
    print(f"following error: largest {largest_v:.3f} V, mean {mean_v:.3f} V")
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
