"""Verb exec: any command inside the environment."""

from __future__ import annotations

import os

import click

from flexarm_bringup.console.verb_group import RUN_ON, examples


@click.command("exec", context_settings=RUN_ON)
@click.argument("command", nargs=-1, required=True, type=click.UNPROCESSED)
@examples("exec python -c 'import rclpy'", "exec bash")
def execute(command: tuple[str, ...]) -> None:
    """Run any command inside the environment."""
    try:
        os.execvp(command[0], command)  # noqa: S606 - this is what the verb is for
    except FileNotFoundError:
        raise click.ClickException(f"no command {command[0]}") from None
