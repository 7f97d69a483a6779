from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest

from flexarm_node.process import DIE_WITH_PARENT, GATE, PRIORITY
from support.exhaustive import first_of

NODE = """
from flexarm_node.process import run

class Node:
    def __init__(self):
        raise SystemExit("made")

raise SystemExit(run(Node))
"""


def run_node(parent: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", NODE],
        env={**os.environ, DIE_WITH_PARENT: str(parent)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("gone", [False, True])
def test_run___parent_that_died_before_the_start___makes_no_node(gone: bool) -> None:  # noqa: FBT001
    done = run_node(1 if gone else os.getpid())
    assert done.returncode == 1
    assert ("made" in done.stderr) == (not gone)


@pytest.mark.parametrize("opened", [b"+", b""])
def test_run___behind_a_gate___makes_a_node_when_it_is_opened(opened: bytes) -> None:
    wait, gate = os.pipe()
    os.write(gate, opened)
    os.close(gate)
    with os.fdopen(wait):
        done = subprocess.run(  # noqa: S603 - our own program
            [sys.executable, "-c", NODE],
            env={**os.environ, GATE: str(wait)},
            pass_fds=(wait,),
            capture_output=True,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert ("made" in done.stderr) == bool(opened)


HANGING = """
import ctypes
from flexarm_node import process

process._END_S = 0.2
with process.bounded_end():
    # Its functions keep the interpreter's lock, as the middleware's end does.
    ctypes.PyDLL(None).sleep(300)
"""


def test_bounded_end___that_hangs_with_the_lock_of_the_interpreter___ends_the_process() -> None:
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", HANGING], capture_output=True, text=True, check=False, timeout=200
    )
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "")


LINGERING = """
import atexit, threading, time
import rclpy.node
from flexarm_node import process

process._END_S = 1.0

class Node(rclpy.node.Node):
    def __init__(self):
        super().__init__("lingering")
        process.request_stop()

    def stop(self):
        # A process with threads at work does not wait for the interpreter's end.
        while threading.active_count() > 1:
            time.sleep(0.01)

def hang():
    while True:
        pass

atexit.register(hang)
raise SystemExit(process.run(Node))
"""


@pytest.mark.slow
def test_run___interpreter_that_hangs_at_its_end___is_ended() -> None:
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", LINGERING], capture_output=True, text=True, check=False, timeout=200
    )
    assert done.returncode == -signal.SIGALRM, done.stderr


SHOWING = """
import os
asked = []
os.sched_setscheduler = lambda pid, policy, param: asked.append((policy, param.sched_priority))

from flexarm_node import process
from flexarm_node.process import run

# Nodes of other tests may have all places.
process._realtime_processes = lambda: 0

class Node:
    def __init__(self):
        raise SystemExit(f"asked: {asked}")

run(Node, %s)
"""


@pytest.mark.parametrize(
    ("kind", "priority", "asked"),
    first_of(
        [
            ("realtime=True", "20", [(os.SCHED_FIFO, 20)]),
            ("keeps_up=True", "20", [(os.SCHED_FIFO, 19)]),
            ("realtime=False", "20", []),
            ("realtime=True", "0", []),
            ("keeps_up=True", "0", []),
            ("keeps_up=True", "1", []),
        ],
        3,
    ),
)
def test_run___kind_of_node___asks_for_its_priority(
    kind: str, priority: str, asked: list[tuple[int, int]]
) -> None:
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", SHOWING % kind],
        env={**os.environ, PRIORITY: priority},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr.splitlines()[-1] == f"asked: {asked}"


TAKING = """
import sys
from flexarm_node.process import prefer_realtime

prefer_realtime()
print("ready", flush=True)
sys.stdin.read()
"""


def may_take(priority: int) -> bool:
    """Return whether this user may have a real-time priority: tried in another process."""
    asked = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({priority}))"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, check=False)  # noqa: S603
    return done.returncode == 0


@pytest.mark.slow
def test_realtime_priority___of_more_nodes_than_two_a_core___leaves_the_others_without() -> None:
    priority, most = 33, 2 * (os.cpu_count() or 1)
    if not may_take(priority):
        pytest.skip("no real-time priority for this user")
    with ExitStack() as stack:
        nodes = [
            stack.enter_context(
                subprocess.Popen(  # noqa: S603 - our own program
                    [sys.executable, "-c", TAKING],
                    env={**os.environ, PRIORITY: str(priority)},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                )
            )
            for _ in range(most + 2)
        ]
        for node in nodes:
            assert node.stdout is not None
            assert node.stdout.readline() == "ready\n"
        policies = [os.sched_getscheduler(node.pid) for node in nodes]
        said = [node.communicate()[1] for node in nodes]
    assert policies.count(os.SCHED_FIFO) == most
    for policy, words in zip(policies, said, strict=True):
        assert ("nodes a core have it already" in words) == (policy != os.SCHED_FIFO)
