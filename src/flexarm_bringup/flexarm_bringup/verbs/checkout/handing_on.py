"""Verbs that hand on to other programs: exec, ros2, reproduce, docs and clean."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from typing import TYPE_CHECKING

import click

from flexarm_bringup.console.first_word import say_word
from flexarm_bringup.console.verb_group import RUN_ON, examples
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.checkout.folder import checkout, environment

if TYPE_CHECKING:
    from pathlib import Path

_REQUIREMENTS = "requirements/ros2cli.in"
_THEIRS = "jazzy"
"""Distribution whose sources the requirements name."""


@click.command("exec", context_settings=RUN_ON)
@click.argument("command", nargs=-1, required=True, type=click.UNPROCESSED)
@examples("exec python -c 'import rclpy'", "exec bash")
def execute(command: tuple[str, ...]) -> None:
    """Run any command inside the environment."""
    try:
        os.execvp(command[0], command)  # noqa: S606 - this is what the verb is for
    except FileNotFoundError:
        raise click.ClickException(f"no command {command[0]}") from None


@click.command(context_settings=RUN_ON, add_help_option=False)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def reproduce(arguments: tuple[str, ...]) -> None:
    """Set tables and figures of the thesis beside our own."""
    root = checkout("programs of the reproduction")
    say_word("reproduce")
    _become(root, "reproduction", arguments)


@click.command(context_settings=RUN_ON, add_help_option=False)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def docs(arguments: tuple[str, ...]) -> None:
    """Build the pages as a site, and run what they show."""
    _become(checkout("pages"), "docs.pages", arguments)


def _become(root: Path, program: str, arguments: tuple[str, ...]) -> None:
    """Run a program of the checkout in place of this process: exit code and Ctrl-C are its own."""
    command = [sys.executable, "-m", program, *arguments]
    os.execve(sys.executable, command, environment(root))  # noqa: S606 - our own program


@click.command()
@examples("clean")
def clean() -> None:
    """Remove the environment and the build.

    Bags, models and results stay.
    """
    # The script at the root does it, since an environment cannot remove itself.
    root = checkout("set-up")
    raise click.ClickException(
        f"this shell is inside the environment, which cannot remove itself: leave it, then call "
        f"{root / 'flexarm'} clean"
    )


@click.command(context_settings=RUN_ON, add_help_option=False)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def ros2(arguments: tuple[str, ...]) -> None:
    """Run the real ros2 command, where it is installed."""
    program = shutil.which("ros2")
    if program is None:
        raise LaunchError(f"no ros2 command here: {_way_out()}")
    # It loads rclpy, which the other verbs do without.
    from flexarm_node.transport import set_up_middleware  # noqa: PLC0415

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
