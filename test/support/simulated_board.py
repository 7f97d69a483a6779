"""The real firmware on a simulated board (simavr), with a flexible arm behind it."""

from __future__ import annotations

import shutil
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.drivers.serial.rig import SerialRig, SerialSettings
from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

RIG = """\
name: board
rate_hz: 300
inputs:
  motor_v: {quantity: other, unit: V, limits: 6, slew_per_s: 3000, raw_per_unit: 88.9}
outputs:
  hub_rad: {quantity: angle, unit: rad, scale: 0.00153398}
  bend_v: {quantity: strain, unit: V, per_si: 1000, scale: 0.000305481, offset: 8184, range: 2.5}
joints:
  hub: {input: motor_v, angle: hub_rad, travel: 1.2}
driver: serial
settings: {port: PORT, inputs: [motor], outputs: [encoder, a0], patience_s: 60}
"""
"""Description of the simulated board, whose port is to be put in."""
COUNTS_PER_RAD = 4096 / (2.0 * np.pi)
# The simulated board may be much slower than a real one, and the wall's time is not its own.
PATIENCE_S = 30.0
PERIOD_S = 1.0 / 300.0


def built(folder: Path) -> tuple[Path, Path]:
    """Return the firmware's image and the program that runs it; RuntimeError without the tools."""
    for tool in ("avr-gcc", "make", "cc"):
        if shutil.which(tool) is None:
            raise RuntimeError(f"{tool} is missing: apt-get install gcc-avr avr-libc make gcc")
    firmware = shutil.copytree(PROJECT / "firmware", folder / "firmware")
    targets = ("build/atmega328p.elf", "build/simavr_board")
    made = subprocess.run(  # noqa: S603
        ["make", "-s", "-C", str(firmware), *targets],  # noqa: S607
        check=False,
        capture_output=True,
        text=True,
    )
    if made.returncode:
        raise RuntimeError(f"apt-get install simavr libsimavr-dev libelf-dev: {made.stderr[:300]}")
    return firmware / targets[0], firmware / targets[1]


@contextmanager
def running(image: Path, program: Path, patience_ms: int = 0) -> Iterator[SimulatedBoard]:
    """Yield a board, which ends with the context."""
    board = SimulatedBoard(image, program, patience_ms)
    try:
        yield board
    finally:
        board.close()


class SimulatedBoard:
    """A running board.

    Parameters
    ----------
    image : Path
        The firmware.
    program : Path
        The simulation.
    patience_ms : int
        Longest time for which it stands still for a host that is late.

    Attributes
    ----------
    port : str
        Its end of the cable.
    """

    def __init__(self, image: Path, program: Path, patience_ms: int) -> None:
        self._process = subprocess.Popen(  # noqa: S603
            [str(program), str(image), str(patience_ms)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self._lines: list[list[str]] = []
        self._come = threading.Condition()
        threading.Thread(target=self._listen, daemon=True).start()
        self.port = self.reported("pty")[0]

    def say(self, line: str) -> None:
        """Give the simulation a line."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")

    def state(self) -> tuple[float, float, float]:
        """Return the board's time in s, and the angles of hub and tip in rad."""
        begun = len(self._lines)
        self.say("state")
        time_us, hub, tip = map(float, self.reported("state", begun))
        return 1e-6 * time_us, hub, tip

    def reported(self, word: str, begun: int = 0) -> list[str]:
        """Wait for a line that begins with a word, from the line `begun` on."""
        found: list[list[str]] = []

        def has_come() -> bool:
            found[:] = [line[1:] for line in self._lines[begun:] if line[0] == word]
            return bool(found) or self._process.poll() is not None

        with self._come:
            assert self._come.wait_for(has_come, PATIENCE_S), f"no {word}"
            assert found, "the simulated board has ended"
        return found[0]

    @property
    def lines(self) -> int:
        """Number of lines so far, for `told`."""
        return len(self._lines)

    def heard(self, begun: int) -> list[list[str]]:
        """Return the lines from the line `begun` on, in words."""
        return self._lines[begun:]

    def wait(self, passed_s: float) -> None:
        """Wait for a time of the board to pass."""
        until_s = self.state()[0] + passed_s
        while self.state()[0] < until_s:
            time.sleep(0.005)

    def close(self) -> None:
        """End the simulation."""
        self._process.kill()
        self._process.wait()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._come:
                self._lines.append(line.split() or [""])
                self._come.notify_all()
        with self._come:
            self._come.notify_all()


def opened(port: str) -> SerialRig:
    """Return an open rig on a board."""
    rig = SerialRig(
        SerialSettings(
            port, ("motor",), ("encoder", "a0"), patience_s=PATIENCE_S, rate_hz=1.0 / PERIOD_S
        )
    )
    rig.open()
    return rig


def controlled(rig: SerialRig, goal_rad: float) -> Iterator[float]:
    """Control the hub by its angle and rate, for ever; yield the angle after each command."""
    before_rad = before_s = None
    while True:
        time_s, readings, _ = rig.read()
        angle_rad = readings[0] / COUNTS_PER_RAD
        rate = 0.0
        if before_rad is not None and before_s is not None:
            rate = (angle_rad - before_rad) / (time_s - before_s)
        before_rad, before_s = angle_rad, time_s
        rig.write([800.0 * (1.2 * (goal_rad - angle_rad) - 0.12 * rate)])
        yield angle_rad


def main() -> None:
    """Swing an arm for ever: a host that a test kills or stops."""
    rig = opened(sys.argv[1])
    for number, _ in enumerate(controlled(rig, 5.0)):
        if number == 0:
            print("driving", flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
