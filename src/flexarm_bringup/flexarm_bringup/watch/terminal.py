"""Terminal that shows a running arm: a screen and its keys, or a line a second for a file."""

from __future__ import annotations

import curses
import locale
import time
from typing import TYPE_CHECKING

import click

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.watch.screen import plain_line, screen

if TYPE_CHECKING:
    from flexarm_bringup.watch.follower import Follower

_DRAW_MS = 100
_LINE_S = 1.0
# The keys of the page; left is positive, as seen from above.
_STEPS_DEG = {
    curses.KEY_LEFT: 1.0,
    curses.KEY_UP: 1.0,
    curses.KEY_RIGHT: -1.0,
    curses.KEY_DOWN: -1.0,
    curses.KEY_SLEFT: 5.0,
    curses.KEY_SR: 5.0,
    curses.KEY_SRIGHT: -5.0,
    curses.KEY_SF: -5.0,
    curses.KEY_PPAGE: 10.0,
    curses.KEY_NPAGE: -10.0,
}
_COLOURS = {
    "READY": curses.COLOR_CYAN,
    "DRIVING": curses.COLOR_GREEN,
    "warning": curses.COLOR_YELLOW,
    "failure": curses.COLOR_RED,
}


def show_screen(arm: Follower) -> None:
    """Show an arm on the terminal until q; a `LaunchError` when it cannot be drawn on."""
    locale.setlocale(locale.LC_ALL, "")
    try:
        curses.wrapper(_run, arm)
    except curses.error as error:
        raise LaunchError(
            f"this terminal cannot be drawn on ({error}): set TERM, or read lines with: "
            "flexarm watch | cat"
        ) from error


def print_lines(arm: Follower) -> None:
    """Print a line a second until Ctrl-C."""
    while True:
        click.echo(plain_line(arm.state, arm.history, arm.units))
        time.sleep(_LINE_S)


def _run(window: curses.window, arm: Follower) -> None:
    styles = _styles()
    window.timeout(_DRAW_MS)
    while (key := window.getch()) != ord("q"):
        _act(key, arm)
        window.erase()
        size = window.getmaxyx()
        for piece in screen(arm.state, arm.history, arm.units, arm.note, size):
            window.addstr(piece.row, piece.column, piece.text, styles.get(piece.style, 0))
        window.refresh()


def _act(key: int, arm: Follower) -> None:
    if key == ord(" "):
        arm.stop()
    elif key == ord("r"):
        arm.release()
    elif key == curses.KEY_HOME:
        arm.move_to(0.0)
    elif key in _STEPS_DEG:
        arm.move_by(_STEPS_DEG[key])


def _styles() -> dict[str, int]:
    curses.curs_set(0)
    styles = {"strong": curses.A_BOLD, "weak": curses.A_DIM}
    if not curses.has_colors():
        return styles | dict.fromkeys(_COLOURS, curses.A_REVERSE)
    curses.use_default_colors()
    for pair, (word, colour) in enumerate(_COLOURS.items(), start=1):
        curses.init_pair(pair, colour, -1)
        styles[word] = curses.color_pair(pair) | curses.A_REVERSE | curses.A_BOLD
    return styles
