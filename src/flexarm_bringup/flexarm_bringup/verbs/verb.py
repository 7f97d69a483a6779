"""What verbs have in common.

A verb imports what it needs when it runs: `--help` and tab completion stay quick.
"""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING, Any

import click

from flexarm_core.errors import FlexarmError, one_line

if TYPE_CHECKING:
    from collections.abc import Callable

RUN_ON = {"ignore_unknown_options": True, "allow_interspersed_args": False}
"""Settings of a verb that hands its arguments on."""


class Verbs(click.Group):
    """Turns the errors that a user can mend into one line, and Ctrl-C into exit code 130."""

    def invoke(self, context: click.Context) -> Any:  # noqa: ANN401 - as click has it
        """Run the verb."""
        try:
            return super().invoke(context)
        except KeyboardInterrupt:
            click.echo("flexarm: interrupted", err=True)
            sys.exit(130)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except (FlexarmError, OSError) as error:
            if os.environ.get("FLEXARM_DEBUG"):
                raise
            click.echo(f"flexarm: {one_line(error)}", err=True)
            sys.exit(1)

    def list_commands(self, context: click.Context) -> list[str]:  # noqa: ARG002
        """Return the verbs in the order in which they were added."""
        return list(self.commands)


def examples(*lines: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Add command lines to the help of a verb, each without its `flexarm`."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        text = "\n".join(f"  flexarm {line}" for line in lines)
        function.__doc__ = f"{function.__doc__}\n\n\b\nExamples:\n{text}"
        return function

    return add
