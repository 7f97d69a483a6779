from __future__ import annotations

import subprocess
import sys

import click
import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import VERBS, main
from flexarm_bringup.console.verb_group import LazyVerbGroup


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
    listed = dict(line.split(maxsplit=1) for line in listing[listing.index("Commands:") + 1 :])
    assert list(listed) == list(VERBS)
    assert not [words for words in listed.values() if words.endswith("...")]


@pytest.mark.parametrize("verb", VERBS)
def test_verb___help___is_that_of_the_list_and_has_examples(verb: str) -> None:
    assert isinstance(main, LazyVerbGroup)
    command = main.load(verb)
    context = click.Context(command, info_name=verb)
    told = command.get_help(context)
    # A group has verbs of its own; the study says its own examples.
    assert "Examples:" in told or "Commands:" in told or not command.add_help_option
    listed = main.get_command(context, verb)
    assert listed is not None
    assert listed.get_short_help_str(200) in " ".join(told.split())


def test_verb_that_is_not_there___is_refused() -> None:
    done = CliRunner().invoke(main, ["identity"])
    assert done.exit_code == 2
    assert "No such command" in done.output


@pytest.mark.parametrize(("misspelt", "verb"), [("demmo", "demo"), ("identfy", "identify")])
def test_verb___misspelt___is_told_with_the_nearest(misspelt: str, verb: str) -> None:
    done = CliRunner().invoke(main, [misspelt])
    assert done.exit_code == 2
    assert f"No such command '{misspelt}'. Did you mean {verb}?" in done.output
