"""Rig behind a board on a serial line, sampled by the board's clock."""

from __future__ import annotations

import fcntl
import os
import select
import termios
import time
import tty
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from flexarm_core.errors import SettingError, nearest, one_line
from flexarm_daq.drivers.serial import messages
from flexarm_daq.drivers.serial.messages import FrameReader
from flexarm_daq.rigs.rig_protocol import RigError, RigSample

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_daq.drivers.serial.messages import BoardSample, Greeting

_GREETING_S: Final = 5.0
"""An Arduino waits two seconds for a new program after its line was opened."""
_HELLO_S: Final = 0.2
_SEQUENCES: Final = 1 << 16
_CLOCK_US: Final = 1 << 32
_CHUNK: Final = 4096


@dataclass(frozen=True)
class SerialSettings:
    """Settings of the driver `serial`.

    Attributes
    ----------
    port : str
        Device of the line; the names in ``/dev/serial/by-id`` stay the same.
    inputs : tuple of str
        Input of the board for each input of the rig, by the names of its greeting.
    outputs : tuple of str
        Output of the board for each output of the rig.
    baud : int
        Bits a second.
    patience_s : float
        Longest wait for a sample. The board is at zero long before.
    rate_hz : float
        Sampling rate, Hz.

    Raises
    ------
    SettingError
        If the patience is not positive, or a name stands twice.
    """

    port: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    baud: int = 500_000
    patience_s: float = 0.1
    rate_hz: float = 300.0

    def __post_init__(self) -> None:
        if not self.patience_s > 0.0:
            raise SettingError(f"settings.patience_s = {self.patience_s:g} must be positive")
        for setting in ("inputs", "outputs"):
            names = getattr(self, setting)
            if len(set(names)) < len(names):
                raise SettingError(f"settings.{setting} has a name twice: {', '.join(names)}")


class SerialRig:
    """A `flexarm_daq.rigs.rig_protocol.Rig` on a board that speaks flexarm's serial protocol.

    Readings and commands are counts of the board; the rig's description has their scales. The board
    puts its output at zero by itself when no command comes, so that a host that has ended or stands
    still leaves nothing driven. A board that was reset, or whose stop was pressed, ends the run.

    Parameters
    ----------
    settings : SerialSettings
        Line and names.

    Attributes
    ----------
    greeting : Greeting or None
        What the board says of itself, from the opening on.
    lost : int
        Samples whose frames did not come whole.
    newest : BoardSample or None
        Newest sample as it came.
    """

    has_own_clock: ClassVar[bool] = True

    def __init__(self, settings: SerialSettings) -> None:
        self.settings = settings
        self.greeting: Greeting | None = None
        self.newest: BoardSample | None = None
        self.lost = 0
        self._line: SerialLine | None = None

    @property
    def damaged(self) -> int:
        """Pieces on the line that were no frame."""
        return self._frames.damaged if self._line is not None else 0

    @property
    def about(self) -> str:
        """What the board says of itself, and how the line has been so far."""
        if self.greeting is None:
            return ""
        greeting = self.greeting
        inputs = [f"{each.name} (limit {each.limit} counts)" for each in greeting.inputs]
        outputs = [f"{each.name} ({each.reading})" for each in greeting.outputs]
        return (
            f"board {greeting.board}, protocol {greeting.version}, at most "
            f"{1e6 / greeting.shortest_period_us:g} Hz, "
            f"zero after {greeting.watchdog_ms} ms of silence\n"
            f"its inputs: {', '.join(inputs)}\nits outputs: {', '.join(outputs)}\n"
            f"frames: {self.lost} lost, {self.damaged} damaged"
        )

    def open(self) -> None:
        """Wait for the board's greeting and start its sampling, with the drive at zero.

        Raises
        ------
        RigError
            If no board answers, it has another version, is too slow, or lacks a channel.
        """
        if self._line is not None:
            return
        self._line = SerialLine(self.settings.port, self.settings.baud)
        try:
            self._frames = FrameReader()
            self.lost = 0
            self.newest = None
            self._pending: list[BoardSample] = []
            self._time_us = 0
            self.greeting = self._greeted(self._line)
            self._drives = _places(
                "input", self.settings.inputs, [each.name for each in self.greeting.inputs]
            )
            self._sensors = _places(
                "output", self.settings.outputs, [each.name for each in self.greeting.outputs]
            )
            # What was on its way when the line was opened was cut.
            self._frames.damaged = 0
            self._line.send(messages.start(self._period_us(self.greeting)))
        except BaseException:
            self.close()
            raise

    def read(self) -> RigSample:
        """Wait for the next sample of the board; of several take the newest. See `Rig.read`."""
        line = self._opened()
        try:
            newest = self._next(line)
        except BaseException:
            self.safe_stop()
            raise
        readings = np.array([newest.raw[place] for place in self._sensors], dtype=float)
        commands = tuple(float(newest.applied[place]) for place in self._drives)
        return RigSample(1e-6 * self._time_us, readings, commands)

    def write(self, commands: Sequence[float]) -> None:
        """Send a command in counts, clipped by the board's limits; see `Rig.write`."""
        line = self._opened()
        values = np.asarray(commands, dtype=float)
        if values.shape != (len(self._drives),) or not np.isfinite(values).all():
            self.safe_stop()
            raise RigError(f"commands must be {len(self._drives)} finite numbers, got {commands}")
        assert self.greeting is not None  # noqa: S101 - an open rig was greeted
        counts = [0] * len(self.greeting.inputs)
        for place, value in zip(self._drives, values, strict=True):
            limit = self.greeting.inputs[place].limit
            counts[place] = round(min(max(float(value), -limit), limit))
        line.send(messages.command(self._sequence, counts))

    def safe_stop(self) -> None:
        """Set the drive to zero; never raises. The board does so too when the line is cut."""
        if self._line is not None and self.greeting is not None:
            with suppress(RigError):
                self._line.send(messages.command(self._sequence, [0] * len(self.greeting.inputs)))

    def close(self) -> None:
        """End the sampling with the drive at zero, and release the line; see `Rig.close`."""
        line, self._line = self._line, None
        if line is not None:
            # Without a line the board's watchdog has put it at zero.
            with suppress(RigError):
                line.send(messages.stop())
            line.close()
            self.greeting = None

    @property
    def _sequence(self) -> int:
        return self.newest.sequence if self.newest is not None else 0

    def _opened(self) -> SerialLine:
        if self._line is None:
            raise RigError("the rig on the serial line is not open: call open() first")
        return self._line

    def _next(self, line: SerialLine) -> BoardSample:
        until_s = time.monotonic() + self.settings.patience_s
        self._take(line)
        while not self._pending:
            if not line.wait(until_s):
                raise RigError(
                    f"{self.settings.port}: no sample within {self.settings.patience_s:g} s: "
                    "check cable and power of the board, and activate again"
                )
            self._take(line)
        newest = self._pending[-1]
        self._pending.clear()
        if newest.is_stopped:
            raise RigError("the stop of the board is pressed: release it and activate again")
        return newest

    def _greeted(self, line: SerialLine) -> Greeting:
        until_s = time.monotonic() + max(_GREETING_S, self.settings.patience_s)
        while time.monotonic() < until_s:
            # The board may still sample for a host that was killed, in the middle of a frame.
            line.send(b"\0" + messages.stop() + messages.hello())
            again_s = min(until_s, time.monotonic() + _HELLO_S)
            while line.wait(again_s):
                for content in self._frames.feed(line.receive()):
                    if found := messages.greeting(content):
                        if found.version != messages.VERSION:
                            raise RigError(
                                f"the board's protocol has version {found.version}, and this "
                                f"driver {messages.VERSION}: flash the firmware of this checkout"
                            )
                        return found
        raise RigError(
            f"{self.settings.port}: no board has answered: flash the firmware (docs/howto/board.md)"
        )

    def _period_us(self, greeting: Greeting) -> int:
        period_us = round(1e6 / self.settings.rate_hz)
        if period_us < greeting.shortest_period_us:
            raise RigError(
                f"rate_hz = {self.settings.rate_hz:g}: the board {greeting.board} samples at most "
                f"at {1e6 / greeting.shortest_period_us:g} Hz"
            )
        return period_us

    def _take(self, line: SerialLine) -> None:
        """Take the samples that have come."""
        assert self.greeting is not None  # noqa: S101 - an open rig was greeted
        channels = len(self.greeting.inputs), len(self.greeting.outputs)
        for content in self._frames.feed(line.receive()):
            if messages.greeting(content):
                # The answers to a hello that was repeated come before the first sample.
                if self.newest is not None:
                    raise RigError("the board was reset: check its power, and activate again")
                continue
            sample = messages.board_sample(content, *channels)
            if sample is not None:
                self._count(sample)

    def _count(self, sample: BoardSample) -> None:
        if self.newest is not None:
            ahead = (sample.sequence - self.newest.sequence) % _SEQUENCES
            if not 0 < ahead < _SEQUENCES // 2:
                return
            self.lost += ahead - 1
            self._time_us += (sample.time_us - self.newest.time_us) % _CLOCK_US
        self.newest = sample
        self._pending.append(sample)


def _places(kind: str, wanted: Sequence[str], there: Sequence[str]) -> list[int]:
    for name in wanted:
        if name not in there:
            raise RigError(
                f"the board has no {kind} {name}{nearest(name, there)}: it has {', '.join(there)}"
            )
    return [there.index(name) for name in wanted]


class SerialLine:
    """Open line, without waits but in `wait`.

    Parameters
    ----------
    port : str
        Device, such as ``/dev/ttyACM0``.
    baud : int
        Bits a second.

    Raises
    ------
    RigError
        If it cannot be opened or set, or another program holds it; of each method, if it fails.
    """

    def __init__(self, port: str, baud: int) -> None:
        self._port = port
        try:
            self._file = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError as error:
            raise RigError(
                f"{port}: {error.strerror}: plug the board in, look for its name with "
                "`ls /dev/serial/by-id`, and be a member of the group of the device"
            ) from None
        try:
            self._take(baud)
        except BaseException:
            os.close(self._file)
            raise

    def receive(self) -> bytes:
        """Return what has come; empty when nothing has."""
        try:
            received = os.read(self._file, _CHUNK)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise RigError(self._said(error)) from None
        if not received:
            raise RigError(f"{self._port}: the line has ended: check the cable of the board")
        return received

    def wait(self, until_s: float) -> bool:
        """Wait for bytes until an instant of the monotonic clock; return whether there are any."""
        left_s = max(0.0, until_s - time.monotonic())
        return bool(select.select([self._file], [], [], left_s)[0])

    def send(self, frame: bytes) -> None:
        """Send a frame at once, as a whole."""
        try:
            sent = os.write(self._file, frame)
        except BlockingIOError:
            sent = 0
        except OSError as error:
            raise RigError(self._said(error)) from None
        if sent != len(frame):
            raise RigError(f"{self._port}: the board takes no more bytes: check its cable")

    def close(self) -> None:
        """Close the line."""
        os.close(self._file)

    def _take(self, baud: int) -> None:
        speed = getattr(termios, f"B{baud}", None)
        if speed is None:
            raise RigError(f"settings.baud = {baud}: this machine has no such speed")
        try:
            # Another process must not, and a second one of root can not, send commands as well.
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            fcntl.ioctl(self._file, termios.TIOCEXCL)
            tty.setraw(self._file)
            settings = termios.tcgetattr(self._file)
            settings[4] = settings[5] = speed
            termios.tcsetattr(self._file, termios.TCSANOW, settings)
            termios.tcflush(self._file, termios.TCIOFLUSH)
        except BlockingIOError:
            raise RigError(
                f"{self._port} is held by another program: end it (a second DAQ node, a monitor)"
            ) from None
        except (OSError, termios.error) as error:
            raise RigError(f"{self._port} is not a serial line: {one_line(error)}") from None

    def _said(self, error: OSError) -> str:
        return f"{self._port}: {error.strerror}: check the cable and power of the board"
