"""Running laboratory that is measured: `up` in real time, and a client that keeps its samples."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from flexarm_bringup.graph.processes import NAMESPACE
from flexarm_bringup.graph.socket_client import socket_client
from flexarm_core.rig_description import load_rig
from flexarm_live.graph.about import columns_of
from flexarm_live.serving.encoding import HEAD

ROOT = Path(__file__).parents[2]
# Processes and browser are those of the tests.
sys.path.insert(0, str(ROOT / "test"))

from support.system_graph import Process, eventually  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import FloatArray

FLEXARM = str(ROOT / "flexarm")
_PATIENCE_S = 60.0
_COLUMNS = columns_of(load_rig("thesis"))
_COMMAND, _POSITION = (_COLUMNS.index(name) for name in ("command_v", "position_v"))
_TRANSITION_S = 60.0


class Laboratory:
    """A running `up`.

    Attributes
    ----------
    address : str
        Address of its page.
    rate_hz, window_s : float
        Rate of the loop, and the time that its figures look back.
    live_pid : int
        Process of the live node.
    """

    def __init__(self, process: Process, rate_hz: float, window_s: float) -> None:
        self.rate_hz, self.window_s = rate_hz, window_s
        self.address = next(
            line for line in process.printed.splitlines() if line.startswith("http")
        )
        pid = process.popen.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text("utf-8").split()
        self.live_pid = next(
            int(child) for child in children if "live_node" in _command_line(child)
        )

    @property
    def socket_url(self) -> str:
        """Address of the WebSocket of a page with the token."""
        return self.address.replace("http", "ws", 1).replace("/#", "/live?")

    def ask(self, verb: str, **fields: object) -> Any:  # noqa: ANN401 - data of the reply
        """Ask as a terminal does, and return the data of the reply."""
        with socket_client(NAMESPACE) as arm:
            return arm.ask(verb, _TRANSITION_S, **fields).data

    def report(self) -> dict[str, str]:
        """Return the newest figures of the DAQ node."""
        found: dict[str, str] = self.ask("status")["reports"]["daq"]["values"]
        return found

    def swing(self) -> None:
        """Let the arm swing."""
        self.ask("waveform", kind="sine", amplitude_v=2.0, period_s=2.0)

    def release(self) -> None:
        """Let the arm swing again after a stop: it is known here before the badge tells it."""
        self.ask("release")
        self.swing()


@contextmanager
def laboratory(rate_hz: float, window_s: float, folder: Path) -> Iterator[Laboratory]:
    """Run `up` in real time with its page; the loop's figures look back so far."""
    settings = folder / "settings.yaml"
    daq = {"daq": {"ros__parameters": {"statistics_s": window_s}}}
    settings.write_text(json.dumps({"/**": daq}), "utf-8")
    command = [FLEXARM, "up", "--real-time", "--rate", f"{rate_hz:g}", "--params-file"]
    process = Process([*command, str(settings)], folder / "up.log", os.environ)
    try:
        process.wait_for("#token=")
        running = Laboratory(process, rate_hz, window_s)
        eventually(lambda: "daq" in running.ask("status")["reports"], "a report of the DAQ node")
        running.swing()
        yield running
    finally:
        process.send(signal.SIGINT)
        process.end()


class Follower:
    """Client that keeps every sample."""

    def __init__(self) -> None:
        self._frames: list[tuple[FloatArray, FloatArray]] = []

    def samples(self, since_s: float = 0.0) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return stamps, positions in V and commands in V of the samples after an instant."""
        kept = [frame for frame in self._frames if frame[0][-1] > since_s]
        stamps_s = np.concatenate([np.empty(0), *(each for each, _ in kept)])
        rows = np.vstack([np.empty((0, len(_COLUMNS))), *(each for _, each in kept)])
        after = stamps_s > since_s
        return stamps_s[after], rows[after, _POSITION], rows[after, _COMMAND]

    def await_drive(self) -> None:
        """Wait until the arm is driven from now on."""
        since_s = now_s()
        eventually(lambda: bool(np.any(self.samples(since_s)[2])), "a command", _PATIENCE_S)

    def zero_s(self, since_s: float) -> float:
        """Wait for the first sample after an instant without a command; return its stamp."""
        found = np.empty(0)

        def has_come() -> bool:
            nonlocal found
            stamps_s, _, commands_v = self.samples(since_s)
            found = stamps_s[commands_v == 0.0]
            return len(found) > 0

        eventually(has_come, "zero at the drive", _PATIENCE_S)
        return float(found[0])

    def take(self, message: str | bytes) -> None:
        """Take a message of the server."""
        if isinstance(message, str):
            return
        _, rows, columns, _, start_s = HEAD.unpack_from(message)
        frame = np.frombuffer(message, "<f4", offset=HEAD.size).reshape(rows, columns)
        self._frames.append((start_s + frame[:, 0].astype(float), frame[:, 1:].astype(float)))


@contextmanager
def following(lab: Laboratory) -> Iterator[Follower]:
    """Follow the samples of a laboratory, in a thread."""
    follower = Follower()
    with closing(connect(lab.socket_url, compression=None, ping_interval=None)) as page:

        def read() -> None:
            try:
                for message in page:
                    follower.take(message)
            except ConnectionClosed:
                pass

        thread = threading.Thread(target=read, daemon=True)
        thread.start()
        follower.await_drive()
        yield follower
    thread.join(_PATIENCE_S)


def now_s() -> float:
    """Return the time of the wall clock, which the samples' stamps have."""
    return time.time()


def _command_line(pid: str) -> str:
    return Path(f"/proc/{pid}/cmdline").read_bytes().decode()
