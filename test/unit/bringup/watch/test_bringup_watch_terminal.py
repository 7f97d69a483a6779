"""The verb `watch` in a pseudo terminal and in a pipe, beside a server."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import struct
import subprocess
import sys
import termios
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_core.rig_description import load_rig
from flexarm_live.graph.about import about_arm
from flexarm_live.serving.laboratory import Answer
from support.live_server import PATIENCE_S, MemoryLaboratory, live_server, until

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from flexarm_live.serving.requests import Request
    from support.live_server import LiveServer

WATCH = [
    *(sys.executable, "-c", "from flexarm_bringup.cli import main; main()"),
    *("watch", "--namespace", "arm"),
]
_CODES = re.compile(r"\x1b(\[[0-9;?]*[A-Za-z]|\([A-Z0-9]|[=>])")


class WatchedLaboratory(MemoryLaboratory):
    """Laboratory whose arm stands at 1 V, and which takes every set-point."""

    def __init__(self) -> None:
        super().__init__()
        self.slow = set()

    async def hello(self) -> Mapping[str, Any]:
        """Return the channels."""
        return about_arm(load_rig("thesis"), simulated=True)

    def state(self) -> Mapping[str, Any]:
        """Return a state with a set-point."""
        return {"badge": "READY", "reason": "no command in force", "references": [1.0]}

    async def carry_out(self, request: Request) -> Answer:
        """Note a request; return what was wanted, or one sample."""
        if request.verb != "samples":
            self.asked.append(request)
        values = {name: [1.0] for name in ("position_v", "reference_v", "command_v")}
        return Answer(
            "held at zero", {"taken": 1, "t_s": [0.0], "values": values, **request.fields}
        )


@pytest.fixture
def live(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LiveServer]:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("flexarm_core.own_files.gettempdir", lambda: str(tmp_path))
    with live_server(WatchedLaboratory()) as server:
        yield server


class Screen:
    """Pseudo terminal of 80 columns and 24 rows with a program in it."""

    def __init__(self) -> None:
        self.printed = ""
        master, slave = pty.openpty()
        self._master = master
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("4H", 24, 80, 0, 0))
        environment = os.environ | {"TERM": "xterm-256color", "LC_ALL": "C.UTF-8"}
        self.process = subprocess.Popen(  # noqa: S603 - ours
            WATCH, stdin=slave, stdout=slave, stderr=slave, env=environment
        )
        os.close(slave)

    def read_until(self, words: str) -> None:
        """Read what is drawn until words stand in it."""
        deadline_s = time.monotonic() + PATIENCE_S
        while words not in _CODES.sub("", self.printed):
            assert time.monotonic() < deadline_s, self.printed
            if select.select([self._master], [], [], 1.0)[0]:
                with suppress(OSError):  # what the program printed tells why it has ended
                    self.printed += os.read(self._master, 65536).decode(errors="replace")

    def type(self, keys: str) -> None:
        """Type keys."""
        os.write(self._master, keys.encode())

    def close(self) -> int:
        """Return the exit code."""
        code = self.process.wait(PATIENCE_S)
        os.close(self._master)
        return code


def test_watch___in_a_terminal___shows_the_arm_and_hears_the_keys(live: LiveServer) -> None:
    asked = live.laboratory.asked
    screen = Screen()
    screen.read_until("q quit")
    for words in ("READY", "no command in force", "+11.67 deg", "+0.50 A"):
        screen.read_until(words)
    screen.type(" ")
    until(lambda: any(each.verb == "stop" for each in asked))
    screen.read_until("held at zero")
    # Arrow to the left, as a terminal in its application mode sends it: by a degree, as the page.
    screen.type("\x1bOD")
    until(lambda: any(each.verb == "reference" for each in asked))
    moved = next(each for each in asked if each.verb == "reference")
    assert moved.fields["value"] == pytest.approx(1.0 + 3.0 / 35.0)
    screen.read_until("set-point +12.67 deg")
    screen.type("q")
    assert screen.close() == 0


def test_watch___in_a_pipe___prints_lines(live: LiveServer) -> None:
    with subprocess.Popen(WATCH, stdout=subprocess.PIPE, text=True) as process:  # noqa: S603 - ours
        assert process.stdout is not None
        first = process.stdout.readline()
        assert first.startswith("READY no command in force; position +11.67 deg; ")
        process.terminate()
    assert not [each for each in live.laboratory.asked if each.verb != "status"]


def test_watch___without_an_up___says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    done = subprocess.run(WATCH, capture_output=True, text=True, check=False)  # noqa: S603 - ours
    assert done.returncode == 1
    assert done.stderr == (
        "flexarm: no page of a `flexarm up` of /arm answers here: start it with ./flexarm up, "
        "without --no-page (one that has lost its page is ended by Ctrl-C first), or name its "
        "--namespace or ROS_DOMAIN_ID\n"
    )
