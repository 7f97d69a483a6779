"""Session of this process on the graph: ROS context, operator and Ctrl-C."""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from flexarm_bringup.console import interruption
from flexarm_bringup.graph.operator import Operator
from flexarm_bringup.graph.processes import NAMESPACE, LaunchError
from flexarm_core.bounds import shown
from flexarm_node.process import bounded_end
from flexarm_node.transport import set_up_middleware

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

OPERATOR, REMOTE = "operator", "remote"
"""Nodes of the verbs that start nodes, and of those in another terminal.

With SROS2 all have the enclave of the first: who has its keys may operate the arm.
"""

# Ports of later ones are beyond 65535.
_LAST_DOMAIN = 232


@contextmanager
def session(
    name: str,
    check: Callable[[], None] = lambda: None,
    complaint: Callable[[str], str] = lambda _: "",
    *,
    namespace: str = NAMESPACE,
) -> Iterator[Operator]:
    """Join the graph of an arm as a node of this name and yield its operator; see `Operator`."""
    with interruptible():
        ros_domain()
        set_up_middleware()
        enclave = f"{namespace.rstrip('/')}/{OPERATOR}"
        # Signals stay Python's.
        rclpy.init(
            args=["--ros-args", "--enclave", enclave],
            signal_handler_options=SignalHandlerOptions.NO,
        )
        try:
            node = rclpy.create_node(name, namespace=namespace)
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            yield Operator(node, executor, check, complaint)
        finally:
            with bounded_end():
                try_shutdown()


@contextmanager
def interruptible() -> Iterator[None]:
    """Leave the block by a KeyboardInterrupt at SIGINT, SIGTERM or the end of the terminal.

    A binding in C++ that calls Python may report one as an error of its own, such as "Unable to
    convert call argument". The failure of a node, a `LaunchError`, is reported all the same.
    """
    # `nohup` has it ignored.
    hangs_up = signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    with interruption.interruptible(signal.SIGINT, signal.SIGTERM, *[signal.SIGHUP] * hangs_up):
        try:
            yield
        except LaunchError:
            raise
        except Exception as error:
            if interruption.is_interrupted():
                raise KeyboardInterrupt from error
            raise


def ros_domain() -> str:
    """Return the ROS domain of this process.

    Raises
    ------
    LaunchError
        If the environment has none that the middleware has ports for.
    """
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (text.isdecimal() and int(text[:9]) <= _LAST_DOMAIN):
        raise LaunchError(
            f"ROS_DOMAIN_ID = {shown(text)}: must be a whole number of 0 to {_LAST_DOMAIN}"
        )
    return text
