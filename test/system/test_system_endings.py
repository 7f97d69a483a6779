"""What is left on the output when a node, its terminal or whoever started it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from support.exhaustive import first_of
from support.logging_rig import LoggingRig
from support.system_graph import ROOT, Graph, eventually, executable, ros_arguments

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.system

RESTLESS = {"law": "pd", "reference": "square", "square.period_s": 0.4, "pd.compensation_v": 0.7}
COMMON_ENDINGS = {
    "the terminal is closed": (signal.SIGHUP,),
    "Ctrl-C": (signal.SIGINT,),
    "Ctrl-\\": (signal.SIGQUIT,),
    "kill": (signal.SIGTERM,),
    "Ctrl-C twice": (signal.SIGINT, signal.SIGINT),
}
ENDINGS = COMMON_ENDINGS | {
    "the terminal is closed after Ctrl-C": (signal.SIGINT, signal.SIGHUP),
    "kill after the terminal was closed": (signal.SIGHUP, signal.SIGTERM),
}

# Starts the commands of its standard input as launch does, and waits for them.
STARTER = """
import asyncio, json, sys

async def main():
    started = [await asyncio.create_subprocess_exec(*command) for command in json.load(sys.stdin)]
    print(*(each.pid for each in started), flush=True)
    await asyncio.gather(*(each.wait() for each in started))

asyncio.run(main())
"""

# Starts a command in a thread that ends at once.
THREADED = """
import subprocess, sys, threading, time

thread = threading.Thread(target=lambda: print(subprocess.Popen(sys.argv[1:]).pid, flush=True))
thread.start()
thread.join()
time.sleep(600)
"""


@pytest.fixture(scope="module")
def commanded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return a graph whose controller commands one daq node after the other."""
    with Graph(tmp_path_factory.mktemp("commanded")) as graph:
        graph.start("controller", RESTLESS | {"autostart": True})
        yield graph


@pytest.fixture
def rig(tmp_path: Path) -> LoggingRig:
    return LoggingRig(tmp_path)


def node(name: str, parameters: dict[str, object]) -> list[str]:
    return [str(executable(name)), *ros_arguments({"autostart": True, **parameters})]


def is_alive(pid: int) -> bool:
    """Return whether a process runs: one that has ended may wait for somebody to ask how."""
    try:
        return " Z " not in Path(f"/proc/{pid}/stat").read_text()
    except OSError:
        return False


@pytest.mark.parametrize(
    "ending",
    [
        each if each in COMMON_ENDINGS else pytest.param(each, marks=pytest.mark.exhaustive)
        for each in ENDINGS
    ],
)
def test_daq___any_ending___leaves_zero_on_the_output(
    commanded: Graph, rig: LoggingRig, ending: str
) -> None:
    daq = commanded.start("daq", rig.parameters | {"autostart": True})
    eventually(rig.is_driven, "a driven arm")

    assert commanded.stop(daq, *ENDINGS[ending]) == 0

    assert rig.outputs_v[-1] == 0.0
    assert re.search(r"\d samples?, the drive is at zero", daq.printed)


@pytest.mark.exhaustive
def test_loop_in_one_process___terminal_closed___leaves_zero_on_the_output(
    graph: Graph, rig: LoggingRig
) -> None:
    words = [f"daq.{each}" for each in arguments(rig.parameters | {"autostart": True})]
    words += [f"controller.{each}" for each in arguments(RESTLESS | {"autostart": True})]
    loop = graph.run([str(executable("loop")), *words])
    eventually(rig.is_driven, "a driven arm")

    loop.send(signal.SIGHUP)

    assert loop.exit_code() == 0, loop.printed
    assert rig.outputs_v[-1] == 0.0


def arguments(parameters: dict[str, object]) -> Iterator[str]:
    words = ros_arguments(parameters)
    return (word for word in words if ":=" in word)


def test_daq___that_nobody_reads___goes_on_and_leaves_zero(
    commanded: Graph, rig: LoggingRig
) -> None:
    process = subprocess.Popen(  # noqa: S603 - our own program
        node("daq", rig.parameters),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=commanded.environment,
        start_new_session=True,
    )
    assert process.stdout is not None
    process.stdout.close()
    eventually(rig.is_driven, "a driven arm")
    # It has to say something: a stop of the drive is a warning in its log.
    process.send_signal(signal.SIGPIPE)
    seen = len(rig.outputs_v)
    eventually(lambda: len(rig.outputs_v) > seen + 100, "an arm that is driven on")

    process.send_signal(signal.SIGTERM)

    assert process.wait(60) == 0
    assert rig.outputs_v[-1] == 0.0


@pytest.mark.parametrize("end", first_of([signal.SIGTERM, signal.SIGKILL, signal.SIGHUP]))
def test_launcher___that_ends___takes_drive_to_zero_and_nodes_with_it(
    graph: Graph, rig: LoggingRig, end: signal.Signals
) -> None:
    """As `ros2 launch`: SIGTERM ends it without a word to its nodes."""
    commands = [node("daq", rig.parameters), node("controller", RESTLESS)]
    launcher, pids = started_by(graph, commands)
    eventually(rig.is_driven, "a driven arm")

    launcher.send_signal(end)
    launcher.wait(60)

    eventually(lambda: not any(map(is_alive, pids)), "the end of the nodes")
    assert rig.outputs_v[-1] == 0.0


def started_by(graph: Graph, commands: list[list[str]]) -> tuple[subprocess.Popen[str], list[int]]:
    launcher = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-c", STARTER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=graph.environment,
        start_new_session=True,
    )
    assert launcher.stdin is not None
    assert launcher.stdout is not None
    launcher.stdin.write(json.dumps(commands))
    launcher.stdin.close()
    return launcher, [int(word) for word in launcher.stdout.readline().split()]


def test_thread___that_started_a_node_and_ends___does_not_end_it(
    commanded: Graph, rig: LoggingRig
) -> None:
    parent = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-c", THREADED, *node("daq", rig.parameters)],
        stdout=subprocess.PIPE,
        text=True,
        env=commanded.environment,
        start_new_session=True,
    )
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    eventually(rig.is_driven, "a driven arm")
    assert is_alive(pid)

    parent.kill()
    parent.wait()

    eventually(lambda: not is_alive(pid), "the end of the node")
    assert rig.outputs_v[-1] == 0.0


@pytest.mark.parametrize("detach", first_of(["nohup", "setsid"]))
def test_node___that_was_detached___goes_on_without_its_shell(
    commanded: Graph, rig: LoggingRig, detach: str
) -> None:
    command = [detach, *node("daq", rig.parameters)]
    shell = subprocess.Popen(  # noqa: S603 - our own program
        ["bash", "-c", '"$@" & echo $!; wait', "shell", *command],  # noqa: S607 - any bash
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=commanded.environment,
        start_new_session=True,
    )
    assert shell.stdout is not None
    pid = int(shell.stdout.readline())
    eventually(rig.is_driven, "a driven arm")

    os.killpg(shell.pid, signal.SIGHUP)
    shell.wait()

    seen = len(rig.outputs_v)
    eventually(lambda: len(rig.outputs_v) > seen + 300, "an arm that is driven on")
    os.kill(pid, signal.SIGTERM)
    eventually(lambda: not is_alive(pid), "the end of the node")
    assert rig.outputs_v[-1] == 0.0


@pytest.mark.parametrize("end", first_of([signal.SIGKILL, signal.SIGHUP, signal.SIGTERM]))
def test_up___that_ends___leaves_zero_on_the_output(
    graph: Graph, rig: LoggingRig, tmp_path: Path, end: signal.Signals
) -> None:
    settings = tmp_path / "node.yaml"
    settings.write_text(
        f"/**/daq:\n  ros__parameters: {{rig: {str(rig.description)!r}, self_test: 'off'}}\n"
    )
    bag = tmp_path / "bag"
    options = ["--no-page", "--reference", "square", "--law", "pd", "--bag", str(bag)]
    up = graph.run([str(ROOT / "flexarm"), "up", *options, "--params-file", str(settings)])
    eventually(rig.is_driven, "a driven arm")

    up.send(end)

    assert up.exit_code() != 0 or end != signal.SIGKILL
    eventually(lambda: not graph.survivors("daq_node"), "the end of the node")
    eventually(lambda: not graph.survivors("recorder_node"), "the end of the recorder")
    assert rig.outputs_v[-1] == 0.0
    assert "duration" in (bag / "metadata.yaml").read_text()


def test_terminal___that_is_closed___ends_what_runs_in_it(
    commanded: Graph, rig: LoggingRig
) -> None:
    """The issue's own case: `flexarm run` in a terminal whose window is closed."""
    master, slave = os.openpty()
    words = ["run", "flexarm_daq", "daq_node", *ros_arguments(rig.parameters | {"autostart": True})]
    process = subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-c", IN_TERMINAL, str(ROOT / "flexarm"), *words],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env=commanded.environment,
        start_new_session=True,
    )
    os.close(slave)
    eventually(rig.is_driven, "a driven arm")

    os.close(master)

    assert process.wait(60) == 0
    assert rig.outputs_v[-1] == 0.0


# Makes the terminal that of its session, as a shell's is, and becomes the command.
IN_TERMINAL = """
import fcntl, os, sys, termios

fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""
