from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from flexarm_bringup.console.completion import completed
from flexarm_control.laws.registry import LAWS
from flexarm_control.loop_setup import PARAMETERS
from flexarm_daq.experiments.catalogue import catalogue
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

_HEAVY = "import atexit, sys; atexit.register(lambda: print({'numpy', 'rclpy'} & set(sys.modules)))"


def words(verb: str, *given: str, start: str = "") -> list[str]:
    found = completed(verb, given, start)
    assert found is not None
    return [str(each.value) for each in found]


def test_experiments_and_laws___are_those_that_there_are() -> None:
    assert words("experiment", "O_dat1") == list(catalogue())
    assert words("catalogue", start="R_dat1") == ["R_dat1", "R_dat10"]
    assert words("up", "--law") == list(LAWS)


def test_set___completes_a_node_and_its_parameters() -> None:
    assert words("set", start="con") == ["controller"]
    reported = words("set", "controller")
    assert "law=" in reported
    assert {each.removesuffix("=") for each in reported} <= {spec.name for spec in PARAMETERS}


def test_bags___are_found_also_in_a_folder_of_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(PROJECT)
    assert "bags/c_dat3_0g" in words("identify", start="ba")
    assert words("play", start="bags/q") == ["bags/quanser_2dsfl"]
    monkeypatch.chdir(tmp_path)
    found = completed("identify", (), "mine")
    assert found is not None
    assert [(each.value, each.type) for each in found] == [("mine", "file")]


@pytest.mark.parametrize(("verb", "start"), [("identify", "--me"), ("bench", "")])
def test_line___of_which_nothing_is_known___asks_the_verb(verb: str, start: str) -> None:
    assert completed(verb, (), start) is None


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("flexarm iden", "identify"),
        ("flexarm experiment C_dat3", "C_dat3"),
        ("flexarm -", "--help"),
    ],
)
def test_shell___completes_without_importing_what_verbs_need(line: str, word: str) -> None:
    program = f"{_HEAVY}; from flexarm_bringup.cli import main; main(prog_name='flexarm')"
    asked = {
        "_FLEXARM_COMPLETE": "bash_complete",
        "COMP_WORDS": line,
        "COMP_CWORD": str(line.count(" ")),
    }
    done = subprocess.run(  # noqa: S603 - our own command
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | asked,
    )
    *found, imported = done.stdout.splitlines()
    assert f"plain,{word}" in found
    assert imported == "set()"
