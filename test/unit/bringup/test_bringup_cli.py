from __future__ import annotations

import re
import subprocess
import sys
from typing import TYPE_CHECKING

import click
import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import GROUPS, main
from flexarm_bringup.console.verb_group import LazyVerbGroup

if TYPE_CHECKING:
    from collections.abc import Iterator

VERBS = [verb for verbs in GROUPS.values() for verb in verbs]


def test_help___lists_every_verb_without_importing_what_they_need() -> None:
    program = (
        "import sys; from flexarm_bringup.cli import main; main(['--help'], standalone_mode=False);"
        "print({'numpy', 'rclpy', 'flexarm_ident', 'flexarm_daq'} & set(sys.modules))"
    )
    done = subprocess.run(  # noqa: S603 - our own command
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    *listing, imported = done.stdout.splitlines()
    assert imported == "set()"
    below = listing[listing.index(f"{next(iter(GROUPS))}:") :]
    listed = [line.split(maxsplit=1)[0] if line[:1] == " " else line for line in below if line]
    assert listed == [word for title, verbs in GROUPS.items() for word in (f"{title}:", *verbs)]
    assert not [line for line in below if line.endswith("...")]


def test_verbs___that_compute_nothing___load_no_mathematics_and_no_ros() -> None:
    verbs = ("bag", "catalogue", "doctor", "exec", "import", "play", "record", "run", "test")
    program = (
        "import sys; from flexarm_bringup.cli import main\n"
        "for each in sys.argv[1:]: main.load(each)\n"
        "print({'matplotlib', 'numpy', 'rclpy', 'rosbags'} & set(sys.modules))"
    )
    done = subprocess.run(  # noqa: S603 - our own command
        [sys.executable, "-c", program, *verbs], capture_output=True, text=True, check=True
    )
    assert done.stdout == "set()\n"


@pytest.mark.parametrize("verb", VERBS)
def test_verb___help___is_that_of_the_list_and_has_examples(verb: str) -> None:
    assert isinstance(main, LazyVerbGroup)
    command = main.load(verb)
    context = click.Context(command, info_name=verb)
    reported = command.get_help(context)
    # A group has verbs of its own; the study says its own examples.
    assert "Examples:" in reported or "Commands:" in reported or not command.add_help_option
    listed = main.get_command(context, verb)
    assert listed is not None
    assert listed.get_short_help_str(200) in " ".join(reported.split())


def commands(name: str, command: click.Command) -> Iterator[tuple[str, click.Command]]:
    """Return a verb and those below it, with their names."""
    yield name, command
    if isinstance(command, click.Group):
        for below, each in command.commands.items():
            yield from commands(f"{name} {below}", each)


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("verb", VERBS)
def test_verb___help_page___has_no_blanks_inside_a_sentence(verb: str, width: int) -> None:
    assert isinstance(main, LazyVerbGroup)
    for name, command in commands(verb, main.load(verb)):
        context = click.Context(command, info_name=name, max_content_width=width)
        context.terminal_width = width
        reported, _, _ = command.get_help(context).partition("\nOptions:")
        _, *lines = reported.split("\n\n", 1)[1].partition("Examples:")[0].splitlines()
        assert not [line for line in lines if re.search(r"\S {2,}\S", line)]
        assert not [line for line in lines if line.strip() and not re.match(r" {2}\S", line)]
        assert not command.get_short_help_str(60).endswith("...")
        helps = [each.help or "" for each in command.params if isinstance(each, click.Option)]
        assert not [text for text in helps if re.search(r"\s{2}|\n", text)]


def test_verb_that_is_not_there___is_refused() -> None:
    done = CliRunner().invoke(main, ["identity"])
    assert done.exit_code == 2
    assert "No such command" in done.output


@pytest.mark.parametrize(("misspelt", "verb"), [("demmo", "demo"), ("identfy", "identify")])
def test_verb___misspelt___is_reported_with_the_nearest(misspelt: str, verb: str) -> None:
    done = CliRunner().invoke(main, [misspelt])
    assert done.exit_code == 2
    assert f"No such command '{misspelt}'. Did you mean {verb}?" in done.output


@pytest.mark.parametrize("verb", VERBS)
def test_place_of_results___is_called_the_same_by_every_verb(verb: str) -> None:
    command = main.get_command(click.Context(main), verb)
    assert command is not None
    names = [option.opts for option in command.params]
    assert all("-o" in each for each in names if "--out" in each)
