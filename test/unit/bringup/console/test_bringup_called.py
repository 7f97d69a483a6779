from __future__ import annotations

from contextlib import nullcontext

import click
import pytest

from flexarm_bringup.cli import main
from flexarm_bringup.console.called import CALLED, as_called


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("flexarm set daq rate_hz=300", "../my/flexarm set daq rate_hz=300"),
        ("try `flexarm bag repair x -o y`", "try `../my/flexarm bag repair x -o y`"),
        ("a flexarm up, or flexarm setup", "a ../my/flexarm up, or flexarm setup"),
        ("another flexarm is setting up", "another flexarm is setting up"),
        ("start it with ./flexarm up", "start it with ./flexarm up"),
        ("in /home/flexarm set", "in /home/flexarm set"),
    ],
)
def test_called___command_of_the_program_alone___has_the_name_that_was_called(
    monkeypatch: pytest.MonkeyPatch, text: str, shown: str
) -> None:
    monkeypatch.setenv(CALLED, "../my/flexarm")
    with click.Context(main):
        assert as_called(text) == shown


@pytest.mark.parametrize("context", [nullcontext(), click.Context(main)])
def test_called___without_a_launcher_or_a_command_line___texts_stay(
    monkeypatch: pytest.MonkeyPatch,
    context: click.Context,
) -> None:
    monkeypatch.delenv(CALLED, raising=False)
    with context:
        assert as_called("flexarm up") == "flexarm up"
