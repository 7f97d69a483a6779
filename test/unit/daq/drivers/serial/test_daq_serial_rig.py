"""The driver beside a board of the test's own on a pseudo-terminal."""

from __future__ import annotations

import os
import pty
import struct
import threading
import tty
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import described
from flexarm_daq.drivers.registry import driven
from flexarm_daq.drivers.serial import rig as serial_rig
from flexarm_daq.drivers.serial.messages import FrameReader, framed
from flexarm_daq.drivers.serial.rig import SerialRig, SerialSettings
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

HELLO, START, COMMAND, STOP = 1, 2, 3, 4


def text(name: str) -> bytes:
    return bytes([len(name)]) + name.encode()


def greeting(version: int = 1) -> bytes:
    """Return the greeting of a board with two inputs and two outputs."""
    head = bytes([0x81, version]) + text("double") + struct.pack("<IHBB", 2000, 20, 2, 2)
    inputs = struct.pack("<hh", 100, 50) + text("left") + struct.pack("<hh", 800, 400)
    outputs = text("right") + struct.pack("<Bii", 0, -(2**31), 2**31 - 1) + text("encoder")
    return head + inputs + outputs + struct.pack("<Bii", 1, 0, 1023) + text("a0")


def sample(sequence: int, time_us: int, status: int = 0, right: int = 0) -> bytes:
    head = struct.pack("<BHIBBBH", 0x82, sequence, time_us % 2**32, status, 0, 0, 0)
    return framed(head + struct.pack("<hhii", 0, right, sequence - 500, 7))


class Board:
    """Board that greets, keeps what it hears and says what the test says."""

    def __init__(self, greets: bytes) -> None:
        self._end, other = pty.openpty()
        tty.setraw(other)
        self.port = os.ttyname(other)
        # Without it the line ends when the driver closes it.
        self._other = other
        self._greets = greets
        self.heard: list[bytes] = []
        self._come = threading.Condition()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def say(self, *frames: bytes) -> None:
        os.write(self._end, b"".join(frames))

    def hears(self, count: int, kind: int) -> bytes:
        """Wait for so many frames of a kind, and return the last."""
        with self._come:
            assert self._come.wait_for(lambda: len(self._of(kind)) >= count, 10.0)
            return self._of(kind)[-1]

    def close(self) -> None:
        os.close(self._other)
        # Its reading ends with the last of the other ends; the number of the file is used again.
        self._thread.join(10.0)
        os.close(self._end)

    def _of(self, kind: int) -> list[bytes]:
        return [each for each in self.heard if each[0] == kind]

    def _listen(self) -> None:
        reader = FrameReader()
        while True:
            try:
                received = os.read(self._end, 1000)
            except OSError:
                return
            for content in reader.feed(received):
                with self._come:
                    self.heard.append(content)
                    self._come.notify_all()
                if content[0] == HELLO and self._greets:
                    self.say(framed(self._greets))


@pytest.fixture
def board() -> Iterator[Board]:
    made = Board(greeting())
    yield made
    made.close()


def settings(port: str, **changes: object) -> SerialSettings:
    values: dict[str, object] = {"inputs": ("right",), "outputs": ("a0", "encoder")}
    return SerialSettings(port, **(values | {"patience_s": 0.5} | changes))  # type: ignore[arg-type]


def opened(board: Board) -> SerialRig:
    rig = SerialRig(settings(board.port))
    rig.open()
    assert struct.unpack("<BI", board.hears(1, START)) == (START, 3333)
    return rig


def test_rig___reads___channels_by_name_and_the_boards_own_time(board: Board) -> None:
    rig = opened(board)
    # The board's clock begins anew after 2^32 microseconds.
    first_us = 2**32 - 5000
    board.say(sample(1, first_us))
    time_s, readings, _ = rig.read()
    assert time_s == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(readings, [7.0, -499.0])
    board.say(sample(2, first_us + 3333))
    assert rig.read().time_s == pytest.approx(0.003333)
    board.say(sample(3, first_us + 6666))
    assert rig.read().time_s == pytest.approx(0.006666)
    rig.close()


def test_rig___reads___what_the_board_says_of_its_drives(board: Board) -> None:
    rig = opened(board)
    board.say(sample(1, 0, right=-37))
    assert rig.read().commands == (-37.0,)
    rig.close()


def test_rig___behind___takes_the_newest_and_counts_what_was_lost(board: Board) -> None:
    rig = opened(board)
    broken = bytearray(sample(5, 20_000))
    broken[8] ^= 0x10
    board.say(sample(65_534, 0), sample(65_535, 3_333))
    # Three numbers are missing, of which a frame came damaged, and the count goes over its end.
    board.say(sample(3, 16_667), bytes(broken), sample(6, 26_667))
    readings = [rig.read()]
    while rig.newest is None or rig.newest.sequence != 6:
        readings.append(rig.read())
    assert readings[-1].time_s == pytest.approx(0.026667)
    assert (rig.lost, rig.damaged) == (3 + 2, 1)
    assert rig.about == (
        "board double, protocol 1, at most 500 Hz, zero after 20 ms of silence\n"
        "its inputs: left (limit 100 counts), right (limit 800 counts)\n"
        "its outputs: encoder (counter), a0 (converter)\nframes: 5 lost, 1 damaged"
    )
    rig.close()


def test_rig___writes___counts_that_answer_the_newest_sample(board: Board) -> None:
    rig = opened(board)
    board.say(sample(77, 0))
    rig.read()
    rig.write([-300.4])
    assert struct.unpack("<BHhh", board.hears(1, COMMAND)) == (COMMAND, 77, 0, -300)
    rig.write([1e9])
    assert struct.unpack("<BHhh", board.hears(2, COMMAND)) == (COMMAND, 77, 0, 800)
    rig.safe_stop()
    assert struct.unpack("<BHhh", board.hears(3, COMMAND)) == (COMMAND, 77, 0, 0)
    rig.close()
    # One is sent before each hello.
    board.hears(2, STOP)
    rig.safe_stop()
    with pytest.raises(RigError, match="not open"):
        rig.write([0.0])


def test_rig___command_that_is_none___is_refused_with_the_drive_at_zero(board: Board) -> None:
    rig = opened(board)
    with pytest.raises(RigError, match="commands must be 1 finite numbers, got"):
        rig.write([np.nan])
    assert struct.unpack("<BHhh", board.hears(1, COMMAND))[2:] == (0, 0)
    rig.close()


def test_rig___no_sample_in_time___ends_with_the_drive_at_zero(board: Board) -> None:
    rig = opened(board)
    with pytest.raises(RigError, match=r"no sample within 0.5 s: check cable"):
        rig.read()
    board.hears(1, COMMAND)
    rig.close()


@pytest.mark.parametrize(
    ("frame", "said"),
    [(framed(greeting()), "was reset"), (sample(2, 3333, status=1), "stop of the board")],
)
def test_rig___board_that_was_reset_or_stopped___ends_the_run(
    board: Board, frame: bytes, said: str
) -> None:
    rig = opened(board)
    board.say(sample(1, 0))
    rig.read()
    board.say(frame)
    with pytest.raises(RigError, match=said):
        rig.read()
    rig.close()


def test_rig___board_of_another_version___is_refused() -> None:
    board = Board(greeting(version=2))
    with pytest.raises(RigError, match="has version 2, and this driver 1: flash"):
        SerialRig(settings(board.port)).open()
    board.close()


def test_rig___line_without_a_board___is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_rig, "_GREETING_S", 0.3)
    board = Board(b"")
    with pytest.raises(RigError, match="no board has answered: flash the firmware"):
        SerialRig(settings(board.port, patience_s=0.1)).open()
    board.close()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"inputs": ("rigth",)}, r"no input rigth \(nearest: right\): it has left, right"),
        ({"outputs": ("a1",)}, r"no output a1 .* it has encoder, a0"),
        ({"rate_hz": 1000.0}, r"rate_hz = 1000: the board double samples at most at 500 Hz"),
        ({"baud": 12345}, r"settings.baud = 12345: this machine has no such speed"),
    ],
)
def test_rig___that_the_board_does_not_have___is_refused(
    board: Board, changes: dict[str, object], said: str
) -> None:
    with pytest.raises(RigError, match=said):
        SerialRig(settings(board.port, **changes)).open()
    # The line is free again.
    opened(board).close()


def test_line___that_is_none___is_reported(tmp_path: Path) -> None:
    with pytest.raises(RigError, match=r"No such file .*: plug the board in"):
        SerialRig(settings(str(tmp_path / "ttyX"))).open()
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(RigError, match="file is not a serial line"):
        SerialRig(settings(str(tmp_path / "file"))).open()


def test_description___of_a_board___makes_its_driver(tmp_path: Path) -> None:
    text_ = (
        "name: mine\nrate_hz: 300\ninputs: {u: {unit: count, limits: 800}}\n"
        "outputs: {a: {unit: count}}\ndriver: serial\n"
        "settings: {port: /dev/ttyACM0, inputs: [motor], outputs: [encoder]}\n"
    )
    made = driven(described(text_), tmp_path)
    assert isinstance(made, SerialRig)
    assert made.settings == SerialSettings("/dev/ttyACM0", ("motor",), ("encoder",), rate_hz=300.0)
    twice = text_.replace("[encoder]", "[encoder, encoder]").replace("{a:", "{b: {unit: x}, a:")
    with pytest.raises(SettingError, match=r"settings.outputs has a name twice"):
        driven(described(twice), tmp_path)
    with pytest.raises(SettingError, match=r"settings.inputs has 0 entries"):
        driven(described(text_.replace("[motor]", "[]")), tmp_path)
