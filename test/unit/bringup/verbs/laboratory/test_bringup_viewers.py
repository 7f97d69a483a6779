from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import click
import pytest
from click.testing import CliRunner

from flexarm_bringup.graph import processes
from flexarm_bringup.graph.processes import LaunchError, NodeProcesses, NodeProgram
from flexarm_bringup.verbs.laboratory.live_page import FOXGLOVE, FoxgloveAddress
from flexarm_bringup.verbs.laboratory.up import up
from flexarm_core.errors import SettingError
from support.live_server import until

if TYPE_CHECKING:
    from pathlib import Path

ADDRESS = "Foxglove, Lichtblick, PlotJuggler: ws://127.0.0.1:8765"
INFORMATION = f"[INFO] [1.5] [flexarm.foxglove]: {ADDRESS}"


@click.command()
@FOXGLOVE
@click.option("--no-page", is_flag=True)
def verb(*, foxglove_port: int | None, no_page: bool) -> None:
    click.echo(f"{foxglove_port} {no_page}")


@pytest.mark.parametrize(
    ("words", "chosen"),
    [
        ([], "None False"),
        (["--foxglove"], "8765 False"),
        (["--foxglove", "9000"], "9000 False"),
        (["--foxglove", "--no-page"], "8765 True"),
    ],
)
def test_option___with_and_without_a_port(words: list[str], chosen: str) -> None:
    assert CliRunner().invoke(verb, words).output == f"{chosen}\n"


@pytest.mark.parametrize("port", ["0", "65536", "high"])
def test_option___with_what_is_no_port___is_refused(port: str) -> None:
    done = CliRunner().invoke(verb, ["--foxglove", port])
    assert done.exit_code == 2
    assert "--foxglove" in done.output


def test_up___without_the_package___is_refused_before_anything_starts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    done = CliRunner().invoke(up, ["--foxglove", "--bag", str(tmp_path / "bag")])
    assert isinstance(done.exception, SettingError)
    assert "requirements/foxglove.in" in str(done.exception)
    assert done.output == ""


def program(
    monkeypatch: pytest.MonkeyPatch, folder: Path, *lines: str
) -> tuple[list[NodeProgram], Path]:
    """Return a node that is a shell script, and the log for it."""
    node = folder / "foxglove_node"
    node.write_text("\n".join(["#!/bin/sh", *lines]))
    node.chmod(0o755)
    monkeypatch.setattr(processes, "find_executable", lambda *_: node)
    return [NodeProgram("flexarm_live", "foxglove_node", {})], folder / "nodes.log"


def test_address___once_the_node_has_reported_it___is_shown_once_and_its_end_is_not_that_of_all(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reported = tmp_path / "told"
    lines = f"while [ ! -e {reported} ]; do sleep 0.02; done", f"echo '{INFORMATION}'", "exit 1"
    with NodeProcesses(*program(monkeypatch, tmp_path, *lines)) as nodes:
        address = FoxgloveAddress(nodes)
        address.look()
        assert capsys.readouterr().out == ""
        reported.touch()
        until(lambda: bool(nodes.endings()))
        for _ in range(2):
            address.look()
        nodes.check()
    assert capsys.readouterr().out == f"{ADDRESS}\n"


def test_node_that_cannot_serve___ends_the_laboratory(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    refusal = "foxglove: cannot listen on 127.0.0.1 port 8765: taken"
    with NodeProcesses(*program(monkeypatch, tmp_path, f"echo '{refusal}'", "exit 2")) as nodes:
        until(lambda: bool(nodes.endings()))
        FoxgloveAddress(nodes).look()
        with pytest.raises(LaunchError, match=f"exit code 2: {refusal}"):
            nodes.check()
