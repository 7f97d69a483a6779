from __future__ import annotations

import os
from itertools import pairwise
from pathlib import Path

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph import processes
from flexarm_bringup.verbs.laboratory import programs
from flexarm_core.errors import BagError
from flexarm_live.terminal_socket import listen
from support.bag_samples import experiment, mcap_file, write_bag

MANY = "--topics state --topics /diagnostics --max-bag-size 1000000 --max-bag-duration 600"


@pytest.mark.parametrize(
    ("options", "given"),
    [
        ("", []),
        (
            MANY,
            [
                "topics:=['state', '/diagnostics']",
                "max_bagfile_size:=1000000",
                "max_bagfile_duration:=600.0",
            ],
        ),
        ("--snapshot-mode", ["snapshot_mode:=true"]),
    ],
)
def test_record___options___become_parameters_of_the_recorder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, options: str, given: list[str]
) -> None:
    begun: list[list[str]] = []
    monkeypatch.setattr(programs, "_become", begun.append)
    monkeypatch.setattr(processes, "find_executable", lambda *_: Path("recorder_node"))

    result = CliRunner().invoke(programs.record, [str(tmp_path / "run"), *options.split()])

    assert result.exit_code == 0, result.output
    (command,) = begun
    reported = [word for flag, word in pairwise(command) if flag == "-p"]
    assert reported == [f"bag:='{tmp_path / 'run'}'", *given]


def test_record___beside_up___is_a_node_of_another_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    begun: list[list[str]] = []
    monkeypatch.setattr(programs, "_become", begun.append)
    monkeypatch.setattr(processes, "find_executable", lambda *_: Path("recorder_node"))
    monkeypatch.setattr("flexarm_core.own_files.gettempdir", lambda: str(tmp_path))

    for _ in range(2):
        CliRunner().invoke(programs.record, ["run", "--namespace", "arm_of_a_test"])
        with listen("/arm_of_a_test"):
            CliRunner().invoke(programs.record, ["run", "--namespace", "arm_of_a_test"])

    named = [[word for word in command if word.startswith("__node:=")] for command in begun]
    assert named == [[], [f"__node:=recorder_{os.getpid()}"]] * 2


def played(monkeypatch: pytest.MonkeyPatch, *words: str) -> tuple[str, list[list[str]]]:
    """Return what `play` says before it becomes the node, and the command of that."""
    begun: list[list[str]] = []
    monkeypatch.setattr(programs, "_become", begun.append)
    monkeypatch.setattr(processes, "find_executable", lambda *_: Path("player_node"))
    done = CliRunner().invoke(programs.play, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output, begun


def test_play___says_at_once_what_it_will_play_and_when(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    # 500 samples of 2 ms and a reference: the last one is 0.998 s, its command 0.4 ms, later.
    write_bag(tmp_path / "run", experiment(500))
    output, (command,) = played(monkeypatch, f"{tmp_path / 'run'}", "--rate", "2", "--loop")
    assert output == (
        f"play {tmp_path / 'run'}, 1001 messages in 0.998 s of /flexarm/reference, /flexarm/state,"
        " /flexarm/command, at rate 2, again and again\n"
        "It begins in some 5 s: first it finds out who else publishes these topics.\n"
    )
    assert "rate:=2.0" in command


def test_play___single_file_to_stand_in___says_its_name(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = mcap_file(write_bag(tmp_path / "run", experiment(5)))
    output, _ = played(monkeypatch, str(file), "--stand-in")
    assert output.startswith(f"play {file}, at rate 1, its samples only\n")


def test_play___of_no_bag___is_refused_before_a_node_starts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with pytest.raises(BagError, match="nowhere: no such bag"):
        played(monkeypatch, str(tmp_path / "nowhere"))
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {relative_file_paths: [], message_count: 2}\n"
    )
    with pytest.raises(BagError, match=r"does not describe its messages: KeyError\('duration'\)"):
        played(monkeypatch, str(tmp_path))
