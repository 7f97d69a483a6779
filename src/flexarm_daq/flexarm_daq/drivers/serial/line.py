"""Serial line of this machine, held by one program."""

from __future__ import annotations

import fcntl
import os
import select
import termios
import time
import tty
from typing import TYPE_CHECKING

from flexarm_core.errors import one_line
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from typing import Final

_CHUNK: Final = 4096


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
