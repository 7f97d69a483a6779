"""Steps of `doctor --hardware --rig` on the real firmware in simavr, with the hands of the test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from flexarm_bringup.verbs.health import serial_board
from support.simulated_board import RIG, built, running

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.simulated_board import SimulatedBoard

pytestmark = [pytest.mark.system, pytest.mark.slow]

STEPS = ("board", "line", "sensors", "by hand", "watchdog", "stop button", "drive")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    try:
        return built(tmp_path_factory.mktemp("board"))
    except RuntimeError as error:
        pytest.skip(str(error))


@pytest.fixture
def board(program: tuple[Path, Path]) -> Iterator[SimulatedBoard]:
    # A board that does not wait for a busy machine would lose its commands.
    with running(*program, patience_ms=1000) as simulated:
        yield simulated


def examined(
    board: SimulatedBoard,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    change: tuple[str, str] = ("board", "board"),
    *options: str,
    presses: bool = True,
) -> tuple[int, list[str]]:
    """Examine a board whose description has a change; return the exit code and what is printed."""

    def ask(what: str) -> None:
        if "by hand" in what:
            board.say("turn 0.3")
        elif what.startswith("release"):
            board.say("release")
            board.say("free")
        elif presses:
            board.say("turn 0")
            # The arm comes to rest in the hand.
            board.wait(1.0)
            board.say("press")

    monkeypatch.setattr(serial_board, "_ask", ask)
    file = folder / "board.yaml"
    file.write_text(RIG.replace(*change).replace("PORT", board.port))
    words = ["doctor", "--hardware", "--rig", str(file), *options]
    result = CliRunner().invoke(main, words)
    return result.exit_code, result.output.splitlines()


def passed(lines: list[str]) -> tuple[str, ...]:
    return tuple(line[6:].partition(":")[0] for line in lines if line.startswith("ok "))


def test_board___wired_rightly___passes_each_step(
    board: SimulatedBoard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code, lines = examined(board, tmp_path, monkeypatch, ("board", "board"), "--pulse")
    assert (code, passed(lines)) == (0, STEPS), lines
    text = "\n".join(lines)
    assert "board atmega328p, protocol 1" in text
    assert "encoder (counter), a0 (converter)" in text
    assert "Nothing was moved." not in text
    # What the description says is the truth of the simulated board, which is at rest before.
    (silence,) = (line for line in lines if line.startswith("ok    watchdog"))
    assert 20.0 <= float(silence.split("within ")[1].split()[0]) < 100.0
    board.wait(0.5)
    changes = [each[0] for each in board.heard(0) if each[0] in ("drive", "zero")]
    assert changes[-1] == "zero"


@pytest.mark.parametrize(
    "fault",
    [
        (("[motor]", "[mtor]"), "board", "no input mtor (nearest: motor)"),
        (("offset: 8184", "offset: 4000"), "sensors", "bend_v reads +1.2"),
        (("scale: 0.00153398", "scale: -0.00153398"), "by hand", "swap A and B of its encoder"),
        pytest.param(
            (("raw_per_unit: 88.9", "raw_per_unit: -88.9"), "drive", "set sign: -1 for joint hub"),
            marks=pytest.mark.exhaustive,
        ),
    ],
)
def test_board___wired_or_described_wrongly___step_says_so(
    board: SimulatedBoard,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    fault: tuple[tuple[str, str], str, str],
) -> None:
    change, step, said = fault
    code, lines = examined(board, tmp_path, monkeypatch, change, "--pulse")
    before = STEPS[: STEPS.index(step)]
    assert (code, passed(lines)) == (1, before), lines
    (wrong,) = (line for line in lines if line.startswith("wrong"))
    assert wrong.startswith(f"wrong {step}: ")
    assert said in wrong
    assert ("Nothing was moved." in "\n".join(lines)) == (step != "drive")


@pytest.mark.exhaustive
def test_button___that_nobody_presses___is_reported(
    board: SimulatedBoard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_board, "_HAND_S", 1.0)
    code, lines = examined(board, tmp_path, monkeypatch, presses=False)
    assert (code, passed(lines)) == (1, STEPS[:-2]), lines
    assert "wrong stop button: no press has come within 1 s" in "\n".join(lines)


def test_rig_of_another_driver___is_refused_with_what_reads_it() -> None:
    result = CliRunner().invoke(main, ["doctor", "--hardware", "--rig", "thesis"])
    assert result.exit_code == 1
    assert "rig check` reads any rig" in result.stderr
    result = CliRunner().invoke(main, ["doctor", "--pulse"])
    assert "--pulse goes with --rig" in result.stderr
