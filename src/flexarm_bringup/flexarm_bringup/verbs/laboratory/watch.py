"""Verb watch: a running arm on one screen of the terminal."""

from __future__ import annotations

import sys

import click

from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.verbs.laboratory.options import ARM
from flexarm_bringup.watch.follower import Follower
from flexarm_bringup.watch.terminal import print_lines, show_screen


@click.command()
@ARM
@examples("watch", "watch --namespace arm2", "watch | tee out/watch.txt")
def watch(namespace: str) -> None:
    """Show a running arm on the terminal, and move it by keys.

    Space stops the drive at once, r begins anew after it, q quits. Arrows move the set-point by
    1 degree, with Shift by 5, Page Up and Page Down by 10; Home takes it to 0. In a pipe a line is
    printed each second.
    """
    with Follower(namespace) as arm:
        if sys.stdin.isatty() and sys.stdout.isatty():
            show_screen(arm)
        else:
            print_lines(arm)
