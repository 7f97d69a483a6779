"""Verb ros2: the real `ros2` in place of this process, where it is installed."""

from __future__ import annotations

import os
import shlex
import shutil

import click

from flexarm_bringup.console.verb_group import RUN_ON
from flexarm_bringup.graph.processes import LaunchError
from flexarm_node.transport import set_up_middleware

_REQUIREMENTS = "requirements/ros2cli.in"
_THEIRS = "jazzy"
"""Distribution whose sources the requirements name."""


@click.command(context_settings=RUN_ON, add_help_option=False)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def ros2(arguments: tuple[str, ...]) -> None:
    """Run the real ros2 command, where it is installed."""
    program = shutil.which("ros2")
    if program is None:
        raise LaunchError(f"no ros2 command here: {_way_out()}")
    # Without it rmw_fastrtps would listen on every address, and hold the loops back when it joins.
    set_up_middleware()
    os.execv(program, [program, *arguments])  # noqa: S606 - this is what the verb is for


def _way_out() -> str:
    """Return how to come by the command."""
    root, distribution = os.environ.get("FLEXARM_ROOT"), os.environ.get("ROS_DISTRO")
    if root is None or distribution != _THEIRS:
        return "source a ROS 2 installation that has it (ros-DISTRO-ros-base)"
    return (
        "source a ROS 2 installation, or install its sources: ./flexarm exec python -m pip install "
        f"--no-deps --no-build-isolation -r {shlex.quote(f'{root}/{_REQUIREMENTS}')}"
    )
