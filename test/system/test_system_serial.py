"""The real firmware on a simulated ATmega328P with an arm behind it, and what breaks there."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import deque
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_daq.rigs.rig_protocol import RigError
from support.chain import driven_chain
from support.simulated_board import RIG, SimulatedBoard, built, controlled, opened, running

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from flexarm_daq.drivers.serial.rig import SerialRig
    from support.system_graph import Graph

pytestmark = [pytest.mark.system, pytest.mark.slow]

# The watchdog of the board has 20 ms.
MOST_US = 25_000


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    try:
        return built(tmp_path_factory.mktemp("board"))
    except RuntimeError as error:
        pytest.skip(str(error))


@pytest.fixture
def board(program: tuple[Path, Path]) -> Iterator[SimulatedBoard]:
    with running(*program) as simulated:
        yield simulated


def zero_within(board: SimulatedBoard, begun: int) -> tuple[int, int]:
    """Return when the output went to zero and how long after the last byte, microseconds."""
    at_us, silence_us = map(int, board.reported("zero", begun))
    return at_us, silence_us


def is_driven(board: SimulatedBoard) -> bool:
    """Return whether the output is not zero, as far as is told."""
    changes = [each[0] for each in board.heard(0) if each[0] in ("drive", "zero")]
    return bool(changes) and changes[-1] == "drive"


def swinging(board: SimulatedBoard, rig: SerialRig) -> Iterator[float]:
    """Drive the arm round until the board obeys; on a busy machine commands may come too late."""
    loop = controlled(rig, 5.0)
    for number, _ in enumerate(loop):
        if number >= 30 and is_driven(board):
            break
    return loop


@contextmanager
def host(board: SimulatedBoard) -> Iterator[subprocess.Popen[str]]:
    """Run a program of its own that drives the arm."""
    process = subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", "support.simulated_board", board.port],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "driving\n"
        while not is_driven(board):
            board.wait(0.01)
        yield process
    finally:
        process.kill()
        process.wait()


def test_loop___at_300_hz___turns_the_arm_to_its_goal(board: SimulatedBoard) -> None:
    rig = opened(board.port)
    angles = list(islice(controlled(rig, 0.5), 1200))
    assert abs(np.mean(angles[-60:]) - 0.5) < 0.02
    assert np.ptp(angles[-60:]) < 0.02
    _, hub_rad, tip_rad = board.state()
    assert (hub_rad, tip_rad) == pytest.approx((0.5, 0.5), abs=0.05)
    assert rig.damaged == 0
    assert rig.newest is not None
    assert rig.newest.damaged == 0
    swinging(board, rig)
    begun = board.lines
    rig.close()
    assert zero_within(board, begun)[1] < MOST_US


def test_cable___pulled___output_is_zero_and_the_run_ends(board: SimulatedBoard) -> None:
    rig = opened(board.port)
    loop = swinging(board, rig)
    begun = board.lines
    board.say("unplug")
    with pytest.raises(RigError, match="check"):
        list(loop)
    assert zero_within(board, begun)[1] < MOST_US
    rig.close()


def test_host___killed___output_is_zero(board: SimulatedBoard) -> None:
    with host(board) as process:
        begun = board.lines
        process.kill()
        assert zero_within(board, begun)[1] < MOST_US


def test_host___stopped_for_250_ms___output_is_zero_until_it_goes_on(
    board: SimulatedBoard,
) -> None:
    with host(board) as process:
        begun = board.lines
        os.kill(process.pid, signal.SIGSTOP)
        assert zero_within(board, begun)[1] < MOST_US
        board.wait(0.25)
        stopped = board.lines
        os.kill(process.pid, signal.SIGCONT)
        board.reported("drive", stopped)


def test_line___with_garbage_in_place_of_commands___output_is_zero(
    board: SimulatedBoard,
) -> None:
    rig = opened(board.port)
    swinging(board, rig)
    begun = board.lines
    board.say("mark garbage")
    rng = np.random.default_rng(1)
    line = rig._opened()
    while not any(each[0] == "zero" for each in board.heard(begun)):
        rig.read()
        line.send(rng.integers(0, 256, 40, dtype=np.uint8).tobytes())
    marked_us = int(board.reported("garbage", begun)[0])
    assert zero_within(board, begun)[0] - marked_us < MOST_US
    for _ in range(30):
        rig.read()
        line.send(rng.integers(0, 256, 40, dtype=np.uint8).tobytes())
    assert [each for each in board.heard(begun) if each[0] == "drive"] == []
    assert rig.newest is not None
    assert rig.newest.damaged > 0
    # What comes after garbage is understood again, from the next zero on.
    swinging(board, rig)
    rig.close()


def test_commands___that_answer_old_samples___drive_nothing(board: SimulatedBoard) -> None:
    rig = opened(board.port)
    rig.read()
    old = rig._sequence
    for _ in range(20):
        rig.read()
    begun = board.lines
    rig.newest = rig.newest._replace(sequence=old)  # type: ignore[union-attr]
    rig.write([400.0])
    board.wait(0.05)
    assert [each for each in board.heard(begun) if each[0] == "drive"] == []
    rig.close()


@pytest.mark.parametrize("fault", ["reset", "hang"])
def test_board___reset_in_a_run_or_by_its_watchdog___output_is_zero_and_the_run_ends(
    board: SimulatedBoard, fault: str
) -> None:
    rig = opened(board.port)
    loop = swinging(board, rig)
    begun = board.lines
    board.say("mark begins")
    board.say(fault)
    with pytest.raises(RigError, match="was reset"):
        list(loop)
    assert zero_within(board, begun)[0] - int(board.reported("begins", begun)[0]) < MOST_US
    rig.close()
    # The operator activates again.
    again = opened(board.port)
    swinging(board, again)
    again.close()


def test_stop_button___pressed___is_latched_until_the_next_start(board: SimulatedBoard) -> None:
    rig = opened(board.port)
    loop = swinging(board, rig)
    begun = board.lines
    board.say("mark pressed")
    board.say("press")
    with pytest.raises(RigError, match="stop of the board is pressed"):
        list(loop)
    assert zero_within(board, begun)[0] - int(board.reported("pressed", begun)[0]) < MOST_US
    board.say("release")
    for _ in range(10):
        rig.write([400.0])
        with pytest.raises(RigError, match="stop of the board is pressed"):
            rig.read()
    assert [each for each in board.heard(begun) if each[0] == "drive"] == []
    rig.close()
    again = opened(board.port)
    swinging(board, again)
    again.close()


def test_line___held_by_a_program___is_refused_to_another(board: SimulatedBoard) -> None:
    rig = opened(board.port)
    swinging(board, rig)
    with pytest.raises(RigError, match="held by another program"):
        opened(board.port)
    # It has not been reset, and obeys the first one still.
    swinging(board, rig)
    rig.close()


def test_command___beyond_the_limits___is_clipped_and_slewed_by_the_board(
    board: SimulatedBoard,
) -> None:
    rig = opened(board.port)
    assert rig.greeting is not None
    limit = rig.greeting.inputs[0].limit
    applied = []
    for _ in range(20):
        rig.read()
        rig.write([1e6])
        assert rig.newest is not None
        applied.append(rig.newest.applied[0])
    assert max(applied) == limit
    steps = np.diff(applied)
    most = rig.greeting.inputs[0].slew_per_ms * (1e3 / rig.settings.rate_hz)
    assert steps.max() <= most + limit * 0.5
    rig.close()


def test_board_with_patience___waits_for_a_host_that_is_late(program: tuple[Path, Path]) -> None:
    with running(*program, patience_ms=60_000) as board:
        rig = opened(board.port)
        deque(islice(controlled(rig, 5.0), 60), maxlen=0)
        begun, (before_s, *_) = board.lines, board.state()
        time.sleep(0.5)
        deque(islice(controlled(rig, 5.0), 3), maxlen=0)
        assert board.state()[0] - before_s < 0.1
        silences_us = [int(each[2]) for each in board.heard(begun) if each[0] == "zero"]
        assert max(silences_us, default=0) < MOST_US - 10_000
        rig.close()


@pytest.mark.exhaustive
def test_board___is_recorded_identified_and_moved_from_the_page(
    program: tuple[Path, Path], graph: Graph, tmp_path: Path
) -> None:
    file = tmp_path / "board.yaml"
    # No longer: a sample that the verbs leave without an answer takes as long.
    with running(*program, patience_ms=200) as board:
        file.write_text(RIG.replace("PORT", board.port))
        model = driven_chain(graph, str(file), tmp_path, "C_dat3")
    # Of 0.002 and 0.01 kg m2 at the ends of 4 N m/rad.
    angular = 2.0 * np.pi * 7.80
    found = np.abs(np.log(model.poles())) / model.dt
    assert np.abs(found - angular).min() < 0.05 * angular
