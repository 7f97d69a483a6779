"""Verb reproduce: the study of the folder `reproduction` in place of this process."""

from __future__ import annotations

import os
import sys

import click

from flexarm_bringup.console.first_word import say_word
from flexarm_bringup.console.verb_group import RUN_ON
from flexarm_bringup.verbs.checkout.folder import checkout, environment


@click.command(context_settings=RUN_ON, add_help_option=False)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def reproduce(arguments: tuple[str, ...]) -> None:
    """Set tables and figures of the thesis beside our own."""
    root = checkout("programs of the reproduction")
    command = [sys.executable, "-m", "reproduction", *arguments]
    say_word("reproduce")
    # In place of this process: exit code, terminal and Ctrl-C are its own.
    os.execve(sys.executable, command, environment(root))  # noqa: S606 - our own program
