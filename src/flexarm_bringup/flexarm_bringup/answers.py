"""Help and completions as files, from which the script `flexarm` answers without Python.

Usage: `python -m flexarm_bringup.answers FOLDER [VERB]`, with the verb `flexarm` for the list of
them; without one, all of the folder is made. What click prints for each verb stands
there in `WIDTH/WORDS`, and what it completes in `SHELL/WORDS`, with the word `-` for the options of
a verb: a line is a word, a tabulator, and what the shell is told, with `BREAK` for a line's end.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.shell_completion import ShellComplete, get_completion_class

from flexarm_bringup.console.called import CALLED
from flexarm_bringup.console.completion import completed

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from click.shell_completion import CompletionItem

    from flexarm_bringup.console.verb_group import LazyVerbGroup

NAME = "@flexarm@"
"""Name in the examples, which the script replaces by how it was called."""
WIDTHS = (80, 100, 120)
"""Columns of a terminal; the script prints the help for the most that there are."""
BREAK = "\x1f"
_SHELLS = ("bash", "zsh")
_ROOT = "flexarm"
_FIXED = (
    *((verb,) for verb in ("experiment", "catalogue", "activate", "deactivate", "set")),
    *(("set", node) for node in ("daq", "controller", "experiment", "recorder", "ident", "player")),
    ("up", "--law"),
)
"""Lines whose next words are the same in every folder."""


def write(folder: Path, group: LazyVerbGroup) -> None:
    """Write what the script answers from, all at once; of several calls beside each other, one."""
    made = folder.with_name(f"{folder.name}.{os.getpid()}")
    for name in (*WIDTHS, *_SHELLS):
        (made / str(name)).mkdir(parents=True, exist_ok=True)
    for verb in (_ROOT, *group.places):
        write_verb(made, group, verb)
    for verb, *given in _FIXED:
        _write_words(made, " ".join((verb, *given)), completed(verb, given, "") or ())
    shutil.rmtree(folder, ignore_errors=True)
    try:
        made.rename(folder)
    except OSError:  # another call's are there since
        shutil.rmtree(made)


def write_verb(folder: Path, group: LazyVerbGroup, verb: str) -> None:
    """Write help and options of a verb, or the list of all, into a folder that `write` has made."""
    root = click.Context(group, info_name=_ROOT, **group.context_settings)
    if verb == _ROOT:
        _write_words(folder, _ROOT, group.shell_complete(root, ""))
        _write_help(folder, _ROOT, root)
        return
    command = _loaded(group, verb)
    for words, context in () if command is None else _contexts(command, root, verb):
        _write_help(folder, words, context)
    if not isinstance(command, click.Group | None):
        asked = ShellComplete(command, {}, verb, "")
        _write_words(folder, f"{verb} -", asked.get_completions([], "-"))


def _loaded(group: LazyVerbGroup, verb: str) -> click.Command | None:
    """Return a verb; None for one whose libraries are not there."""
    try:
        return group.load(verb)
    except ImportError:
        return None


def _contexts(
    command: click.Command, parent: click.Context, words: str
) -> Iterator[tuple[str, click.Context]]:
    """Yield the words and the context of a verb and of those below it."""
    name = words.rpartition(" ")[2]
    context = click.Context(command, parent=parent, info_name=name, **command.context_settings)
    if command.get_help_option(context):
        yield words, context
    for each, below in command.commands.items() if isinstance(command, click.Group) else ():
        yield from _contexts(below, context, f"{words} {each}")


def _write_help(made: Path, words: str, context: click.Context) -> None:
    for width in WIDTHS:
        os.environ["COLUMNS"] = str(width)
        (made / str(width) / words).write_text(f"{context.get_help()}\n", "utf-8")


def _write_words(made: Path, words: str, found: Iterable[CompletionItem]) -> None:
    items = list(found)
    for shell in _SHELLS:
        completion = get_completion_class(shell)
        assert completion is not None  # noqa: S101 - click has them
        one = completion(click.Command(_ROOT), {}, _ROOT, "")
        lines = (
            f"{each.value}\t{one.format_completion(each).replace(chr(10), BREAK)}\n"
            for each in items
        )
        (made / shell / words).write_text("".join(lines), "utf-8")


if __name__ == "__main__":
    os.environ[CALLED] = NAME
    from flexarm_bringup.cli import main

    place, *verbs = sys.argv[1:]
    for each in verbs:
        write_verb(Path(place), main, each)
    if not verbs:
        write(Path(place), main)
