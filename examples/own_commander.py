"""A ROS 2 node of one's own that commands the arm: PD control in the controller's place."""

from __future__ import annotations

import math
import signal
import time

import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions

from flexarm_msgs.msg import ArmState, CommanderInfo, MotorCommand

GOAL_V, LENGTH_S = 1.5, 6.0
KP, KD, COULOMB_V = 0.6, 4.3, 0.7
# No compensation at the goal, above the noise of both signals: it would shake the arm.
AT_GOAL_V, AT_REST_V = 0.025, 0.08
# Longer than the arm's time stands when a commander leaves (answer_timeout_s, 5 s).
PATIENCE_S = 10.0

# All three are reliable, rclpy's default: the loop's ends take nothing less.
# The newest sample alone: an older one has an answer, or it is too late for one.
NEWEST = QoSProfile(depth=1)
# Kept for a recorder whose process pauses. The DAQ node reads the newest one.
SENT = QoSProfile(depth=1000)
# A recorder that starts later is told who commands.
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class OwnCommander(Node):
    """Node that answers every sample with a command, when nobody else does."""

    def __init__(self) -> None:
        super().__init__("own_commander", namespace="flexarm")
        self.commands = self.create_publisher(MotorCommand, "command", SENT)
        self.commander = self.create_publisher(CommanderInfo, "commander", LATCHED)
        self.controller = self.create_client(ChangeState, "controller/change_state")
        self.sequence, self.obeyed, self.obeyed_s = 0, 0, 0.0
        self.start_s, self.passed_s, self.position_v = math.inf, 0.0, math.nan
        self.stopping = False

    def on_state(self, state: ArmState) -> None:
        """Answer a sample, with the next number and the number of the sample."""
        if self.sequence == 0 and state.command_sequence > 0:
            return  # another node commands still: two of them stop the drive
        stamp_s = state.header.stamp.sec + 1e-9 * state.header.stamp.nanosec
        if state.command_sequence > 0:
            self.obeyed, self.obeyed_s = self.obeyed + 1, time.monotonic()
            self.start_s = min(self.start_s, stamp_s)
            self.passed_s = stamp_s - self.start_s
        self.position_v = state.position_v
        self.sequence += 1
        command = MotorCommand(sequence=self.sequence, state_sequence=state.sequence)
        command.header.stamp = self.get_clock().now().to_msg()
        command.effort_v, command.compensation_v = pd(state)
        self.commands.publish(command)

    def command(self) -> None:
        """Declare this node the commander, and answer until the time is over."""
        info = CommanderInfo(node=self.get_fully_qualified_name(), law="own_pd", uses_outputs=True)
        info.header.stamp = self.get_clock().now().to_msg()
        self.commander.publish(info)
        self.obeyed_s = time.monotonic()
        states = self.create_subscription(ArmState, "state", self.on_state, NEWEST)
        while self.passed_s < LENGTH_S and not self.stopping:
            rclpy.spin_once(self, timeout_sec=0.1)
            if time.monotonic() - self.obeyed_s > PATIENCE_S:
                print("no command of this node is in force: ./flexarm status says why")
                break
        self.destroy_subscription(states)
        print(f"{self.sequence} commands, {self.obeyed} samples with one in force")
        print(f"set-point {GOAL_V} V, position {self.position_v:.3f} V")

    def ask_controller(self, transition: int) -> bool:
        """Ask the controller for a transition, and return whether it made it."""
        if not self.controller.wait_for_service(timeout_sec=PATIENCE_S):
            return False
        request = ChangeState.Request(transition=Transition(id=transition))
        answer = self.controller.call_async(request)
        rclpy.spin_until_future_complete(self, answer, timeout_sec=PATIENCE_S)
        return answer.done() and bool(answer.result().success)


def pd(state: ArmState) -> tuple[float, float]:
    """Return effort and compensation of Coulomb friction, V."""
    error_v = GOAL_V - state.position_v
    effort_v = KP * error_v - KD * state.speed_v
    is_there = abs(error_v) < AT_GOAL_V and abs(state.speed_v) < AT_REST_V
    return effort_v, 0.0 if is_there else math.copysign(COULOMB_V, effort_v)


def main() -> None:
    """Take the controller's place, and give it back, also after Ctrl-C."""
    # rclpy's own answer to Ctrl-C would end the context, and no service could be called any more.
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = OwnCommander()
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, lambda *_: setattr(node, "stopping", True))
    has_left = node.ask_controller(Transition.TRANSITION_DEACTIVATE)
    print("the controller has left its place" if has_left else "no controller is active")
    try:
        node.command()
    finally:
        if has_left:
            is_back = node.ask_controller(Transition.TRANSITION_ACTIVATE)
            print("the controller is back" if is_back else "not back: activate the controller")
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    main()
