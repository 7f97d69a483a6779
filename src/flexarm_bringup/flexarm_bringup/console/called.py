"""Name by which the user calls this program: commands that it prints can be copied to the shell."""

from __future__ import annotations

import os
import re

import click

CALLED = "FLEXARM_CALLED"
"""Environment variable: how the launcher of a checkout was called, `./flexarm` or a path.

Inside the environment, and where flexarm was installed by pip, the name is `flexarm`."""
_NAME = "flexarm"


def called() -> str:
    """Return how the user called this program."""
    return os.environ.get(CALLED, _NAME)


def as_called(text: str) -> str:
    """Return a text with the commands of this program as the user can type them.

    A command is the name of the program before one of its verbs: in other sentences it stays.
    """
    context = click.get_current_context(silent=True)
    program = context and context.find_root().command
    if not isinstance(program, click.Group) or context is None:
        return text
    verbs = "|".join(map(re.escape, program.list_commands(context)))
    return re.sub(rf"(?<![\w./-]){_NAME}(?= (?:{verbs})\b)", lambda _: called(), text)
