from __future__ import annotations

import os
import shlex
import subprocess
from contextlib import nullcontext
from pathlib import Path

import click
import pytest

from flexarm_bringup.cli import main
from flexarm_bringup.console.called import CALLED, as_called
from support.project import PROJECT


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


@pytest.mark.parametrize("command", ["./flexarm", str(PROJECT / "flexarm"), "flexarm"])
def test_printed_command___is_as_the_launcher_was_called(command: str) -> None:
    if PROJECT not in Path(os.environ.get("FLEXARM_INSTALL", "")).parents:
        pytest.skip("this environment was not made by ./flexarm in this checkout")
    paths = "PATH", "AMENT_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH"
    made = ("FLEXARM_ROOT", "FLEXARM_INSTALL", *paths)
    outside = {name: value for name, value in os.environ.items() if name not in made}
    found_in = f":{PROJECT}" if command == "flexarm" else ""
    done = subprocess.run(  # noqa: S603 - our own script
        ["/bin/bash", "-c", f"{shlex.quote(command)} set payload_kg=0.2"],
        env=outside | {"PATH": f"/usr/local/bin:/usr/bin:/bin{found_in}"},
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=False,
    )
    printed = done.stderr.partition("is missing: ")[2]
    assert shlex.split(printed) == [command, "set", "daq", "payload_kg=0.2"]
