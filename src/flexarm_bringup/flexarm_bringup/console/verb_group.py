"""Click groups of verbs: one-line errors, and verbs that are imported when they are called."""

from __future__ import annotations

import ast
import os
import signal
import sys
import warnings
from difflib import get_close_matches
from functools import cache, reduce
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click
from click.shell_completion import ShellComplete

from flexarm_bringup.console.called import as_called, called
from flexarm_bringup.console.completion import completed
from flexarm_bringup.console.interruption import interruptible
from flexarm_core.errors import FlexarmError, one_line

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from click.shell_completion import CompletionItem

    Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

_VERBS = "flexarm_bringup.verbs"
_FOLDER = Path(__file__).parents[1] / "verbs"
_WORDS = f"{__name__}.words"
"""Words of a line that is being completed, in the context of click."""
_ALIKE = 0.65
"""Similarity from which a word may be a misspelt verb; `validate` is not `activate`."""

RUN_ON = {"ignore_unknown_options": True, "allow_interspersed_args": False}
"""Settings of a verb that hands its arguments on."""
FORCE = click.option("--force", is_flag=True, help="Replace files that flexarm did not write too.")
"""Option of a verb that writes results."""


class VerbGroup(click.Group):
    """Group that turns an error a user can fix into one line, and Ctrl-C into exit code 130."""

    def invoke(self, ctx: click.Context) -> Any:  # noqa: ANN401 - as click has it
        """Run the verb."""
        # A shell has SIGINT ignored in what it runs in the background.
        ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        try:
            with interruptible(*() if ignored else (signal.SIGINT,)):
                return super().invoke(ctx)
        except KeyboardInterrupt:
            # Callbacks that rclpy's executor had begun end with the program.
            warnings.filterwarnings("ignore", "coroutine .* was never awaited", RuntimeWarning)
            click.echo("flexarm: interrupted", err=True)
            sys.exit(130)
        except ModuleNotFoundError as error:
            if not is_of_ros(error.name or ""):
                raise
            _end(
                error,
                f"this verb works with ROS 2 nodes, and this Python has no {error.name}: call "
                "./flexarm of a checkout, which brings it (Linux on x86-64), or source an "
                "installation of ROS 2",
            )
        # A reader that has read enough is not an error: click ends the program without a word.
        except (click.ClickException, click.exceptions.Exit, click.Abort, BrokenPipeError):
            raise
        # Libraries raise errors of their own, such as rclpy for a wrong ROS_DOMAIN_ID.
        except (FlexarmError, ValueError, RuntimeError, OSError) as error:
            _end(error, one_line(error))


class LazyVerbGroup(VerbGroup):
    """Group that lists its verbs without importing them.

    Parameters
    ----------
    groups : mapping of str to mapping of str to str
        Title of each group of verbs, and for each verb its place, as `room.module:function` below
        the folder `verbs`.
    """

    def __init__(
        self,
        *args: Any,  # noqa: ANN401 - click's own
        groups: Mapping[str, Mapping[str, str]],
        **settings: Any,  # noqa: ANN401 - click's own
    ) -> None:
        super().__init__(*args, **settings)
        self.groups = groups
        self.places = {verb: place for verbs in groups.values() for verb, place in verbs.items()}

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs below the titles of their groups."""
        longest = max(map(len, self.places))
        for title, verbs in self.groups.items():
            commands = {verb: self.get_command(ctx, verb) for verb in verbs}
            with formatter.section(title):
                formatter.write_dl(
                    [
                        (verb.ljust(longest), command.get_short_help_str(formatter.width))
                        for verb, command in commands.items()
                        if command
                    ]
                )

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the verbs in the order of their places."""
        return list(self.places)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Return a stand-in that knows the help of a verb, which is read without an import."""
        place = self.places.get(cmd_name)
        return place and click.Command(cmd_name, help=_docstring(place))  # type: ignore[return-value]

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Import the verb that is called; a misspelt one is refused with the nearest.

        A line that is being completed needs no import: `shell_complete` gets its words.
        """
        if ctx.resilient_parsing:
            ctx.meta[_WORDS] = args
            return None, None, args
        try:
            name, stand_in, rest = super().resolve_command(ctx, args)
        except click.UsageError as error:
            for near in get_close_matches(args[0], self.places, n=1, cutoff=_ALIKE):
                raise click.UsageError(f"{error.message} Did you mean {near}?", ctx) from None
            raise
        return name, stand_in and self.load(str(stand_in.name)), rest

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return verbs, or what may stand behind one."""
        verb, *given = ctx.meta.get(_WORDS, ("",))
        if verb not in self.places:
            return super().shell_complete(ctx, incomplete)
        found = completed(verb, given, incomplete)
        if found is None:
            asked = ShellComplete(self.load(verb), {}, verb, "")
            found = asked.get_completions(given, incomplete)
        return found

    def load(self, verb: str) -> click.Command:
        """Import a verb."""
        module, _, function = self.places[verb].partition(":")
        command: click.Command = getattr(import_module(f"{_VERBS}.{module}"), function)
        return command


def together(*options: Decorator) -> Decorator:
    """Return options as one decorator, in the order in which the help lists them."""
    return lambda function: reduce(lambda made, add: add(made), reversed(options), function)


def examples(*lines: str) -> Decorator:
    """Add command lines to the help of a verb, each without the name of the program."""

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        text = "\n".join(f"  {called()} {line}" for line in lines)
        # The indentation of the source would become blanks inside the sentences.
        words = cleandoc(function.__doc__ or "")
        function.__doc__ = f"{words}\n\n\b\nExamples:\n{text}"
        return function

    return add


def _end(error: Exception, words: str) -> NoReturn:
    """End the program with one line, or with the error where its place is wanted."""
    if os.environ.get("FLEXARM_DEBUG"):
        raise error
    click.echo(f"flexarm: {as_called(words)}", err=True)
    sys.exit(1)


def is_of_ros(module: str) -> bool:
    """Tell whether ROS 2 brings a module, or the build of our messages for it."""
    package = module.partition(".")[0]
    return package in {"rclpy", "ament_index_python"} or package.endswith(("_msgs", "_interfaces"))


def _docstring(place: str) -> str:
    """Return the docstring of the function at a place."""
    module, _, function = place.partition(":")
    return _docstrings(module)[function]


@cache
def _docstrings(module: str) -> dict[str, str]:
    """Return the docstrings of a module's functions; several verbs share a module."""
    source = (_FOLDER / f"{module.replace('.', '/')}.py").read_text("utf-8")
    return {
        each.name: ast.get_docstring(each) or ""
        for each in ast.parse(source).body
        if isinstance(each, ast.FunctionDef)
    }
