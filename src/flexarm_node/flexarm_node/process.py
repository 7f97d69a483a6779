"""Process of a node: start, spinning, and a clean stop for any number of signals."""

from __future__ import annotations

import ctypes
import faulthandler
import fcntl
import gc
import os
import resource
import select
import signal
import sys
import threading
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from flexarm_core.clock import slowness
from flexarm_core.errors import FlexarmError, SettingError
from flexarm_core.own_files import private_folder
from flexarm_node.parameter_files import own_words, refuse_words, wrong_words
from flexarm_node.transport import set_up_middleware

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rclpy.guard_condition import GuardCondition

ENDINGS = (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT, signal.SIGTERM)
"""Signals that end a node in order. Python ignores SIGPIPE, so that a node goes on when nobody
reads what it prints."""
_LOOK_S = 0.2
_SHUTDOWN_S = 1.0
# On an idle machine: on a busy one an end takes longer without a hang.
_END_S = 10.0
_MCL_CURRENT_AND_FUTURE = 3
_NICE = 10
PRIORITY = "FLEXARM_PRIORITY"
"""Environment variable: SCHED_FIFO priority of the nodes with a loop; 0 asks for none.

The recorder takes the one below."""
_DEFAULT_PRIORITY = "20"
_NODES_A_CORE = 2
# Places in /proc/PID/stat, behind the name.
_PRIORITY_AT, _POLICY_AT = 37, 38
# It may end while this process loads what it needs.
_PARENT = os.getppid()
DIE_WITH_PARENT = "FLEXARM_DIE_WITH_PARENT"
"""Environment variable: the process that started a node in a session of its own."""
GATE = "FLEXARM_GATE"
"""Environment variable: file descriptor of a pipe. A node that is ready to join the graph waits for
a byte of it; its end without one says that there is no graph to join."""


class StoppableNode(Protocol):
    """An rclpy node with an orderly stop.

    A node that can fail by itself has a text `failure`, empty while all is well.
    """

    def stop(self) -> None:
        """Leave everything safe; called once, before the node is destroyed."""

    def create_guard_condition(self, callback: Callable[[], None]) -> GuardCondition:
        """As rclpy's nodes do."""

    def destroy_node(self) -> None:
        """As rclpy's nodes do."""


def request_stop() -> None:
    """End this process as a signal would. Any thread may call."""
    os.kill(os.getpid(), signal.SIGTERM)


@contextmanager
def bounded_end() -> Iterator[None]:
    """End the process with exit code 1 when the block, in which it leaves the graph, hangs.

    Fast DDS can hang for ever when another participant leaves at the same moment (its issue 6502).
    The interpreter's lock may be held then, so that neither a thread nor a handler of a signal in
    Python could help.
    """
    with Path(os.devnull).open("w") as nowhere:
        faulthandler.dump_traceback_later(_END_S * slowness(), exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


def run(
    make_node: Callable[[], StoppableNode],
    *,
    realtime: bool = False,
    keeps_up: bool = False,
    takes_words: bool = False,
) -> int:
    """Run one node until one of `ENDINGS`; return the process's exit code, 1 after its failure.

    A signal ends the spinning at once although the main thread is waiting inside the middleware,
    and a second one (a launcher and a terminal both send it) cannot break the shutdown. The end of
    the process that started the node is such a signal too, unless the node was detached from it.

    Parameters
    ----------
    make_node : callable
        Builds the node. A `SettingError` from it is printed as one line, exit code 2.
    realtime : bool
        Ask for real-time priority and locked memory, so that the node's loop is on time on a busy
        machine; where that is not permitted, one line says so. The middleware is set up so that
        the loop waits neither for a node that joins nor long for a lost message.
    keeps_up : bool
        Ask for the priority just below that of a loop: on a machine that the loops of several arms
        keep busy, the node still gets to read all that they send.
    takes_words : bool
        The node reads the words of its command line that are not for ROS 2; otherwise they are
        refused.
    """
    if realtime:
        prefer_realtime()
        _lock_memory()
    elif keeps_up:
        # Where it is not permitted, the nodes with a loop say so.
        with suppress(OSError, FlexarmError):
            _take_priority(_priority() - 1)
    parent = _followed()
    if _is_lost(parent) or not _let_in():
        return 1
    ending = Ending(parent)
    try:
        set_up_middleware(loop=realtime)
        _begin(takes_words=takes_words)
        node = make_node()
    except SettingError as error:
        _say(f"{error}\n")
        with bounded_end():
            try_shutdown()
        return 2
    executor = SingleThreadedExecutor()
    stopped = threading.Event()
    # Its callback ends `spin_once`; the executor's own wake-up would not.
    stop = node.create_guard_condition(stopped.set)

    # What lives now lives to the end: the collector need not look through it in the loop's time.
    gc.collect()
    gc.freeze()
    ending.call_at_end(stop.trigger)
    executor.add_node(node)
    try:
        while not stopped.is_set():
            executor.spin_once()
    finally:
        node.stop()
        with bounded_end():
            executor.shutdown(timeout_sec=_SHUTDOWN_S)
            node.destroy_node()
            try_shutdown()
        ending.ignore_more()
        # The middleware's last destructors run at the interpreter's end, and can hang as well.
        signal.setitimer(signal.ITIMER_REAL, _END_S * slowness())
    code = 1 if getattr(node, "failure", "") else 0
    if threading.active_count() > 1:
        _leave(code)
    return code


class Ending:
    """What ends this process: a signal, or the end of the process that it follows."""

    def __init__(self, parent: int | None) -> None:
        self._parent = parent
        self._signals, wakeup = os.pipe()
        os.set_blocking(wakeup, False)
        signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
        for ending in ENDINGS:
            # `nohup` has it ignored.
            if ending != signal.SIGHUP or signal.getsignal(ending) != signal.SIG_IGN:
                signal.signal(ending, _leave_to_wakeup)

    def call_at_end(self, stop: Callable[[], None]) -> None:
        """Have a thread call `stop` at the first one."""
        threading.Thread(target=self._wait, args=(stop,), daemon=True, name="signals").start()

    def ignore_more(self) -> None:
        """Ignore further signals.

        The interpreter's end puts the default back in the place of a handler, but lets this be.
        """
        for ending in ENDINGS:
            signal.signal(ending, signal.SIG_IGN)

    def _wait(self, stop: Callable[[], None]) -> None:
        while not select.select([self._signals], [], [], _LOOK_S)[0]:
            if _is_lost(self._parent):
                _say("the process that started this node has ended, and so does the node\n")
                break
        stop()


def _begin(*, takes_words: bool) -> None:
    if not takes_words:
        refuse_words(own_words(sys.argv[1:]))
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        said = wrong_words(sys.argv) or " ".join(str(error).split())
        raise SettingError(f"wrong ROS arguments: {said}") from None


def _leave(code: int) -> None:
    """End the process without the interpreter's own end.

    That one unwinds threads still at work in compiled code, which may then use the interpreter
    without its lock and crash.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(code)


def _say(line: str) -> None:
    """Print on standard error, where anybody reads it: its terminal may be gone."""
    with suppress(OSError):
        sys.stderr.write(line)
        sys.stderr.flush()


def _followed() -> int | None:
    """Return the process with which this one ends; None where it stands alone.

    A node stands alone in a session of its own (systemd, `setsid`), behind `nohup`, and where the
    first process of the machine or container has started it.
    """
    named = os.environ.pop(DIE_WITH_PARENT, None)
    if named is not None:
        return int(named)
    leads = os.getsid(0) == os.getpid()
    alone = leads or signal.getsignal(signal.SIGHUP) == signal.SIG_IGN or _PARENT <= 1
    return None if alone else _PARENT


def _is_lost(parent: int | None) -> bool:
    """Return whether the process to follow has ended: another one has taken over its children."""
    return parent is not None and os.getppid() != parent


def _let_in() -> bool:
    """Wait until the process that started this one opens its gate; return False if it does not."""
    gate = os.environ.pop(GATE, None)
    if gate is None:
        return True
    opened = os.read(int(gate), 1)
    os.close(int(gate))
    return bool(opened)


def prefer_realtime() -> None:
    """Take real-time priority where permitted; call it before the middleware makes its threads.

    Others may have it already, two a core: it is left to them, or several arms would leave nothing
    of the machine to whom wants to stop them.
    """
    try:
        has_share = _take_priority(_priority())
    except (OSError, FlexarmError):
        _say(
            f"no real-time priority, so a busy machine makes samples late: permit it with "
            f"`ulimit -r {_priority()}`, or set {PRIORITY}=0\n"
        )
    else:
        if not has_share:
            _say(
                f"no real-time priority, so a busy machine makes samples late: {_NODES_A_CORE} "
                "nodes a core have it already; end other arms, or run them on another machine\n"
            )


def yield_to_others() -> None:
    """Leave the processor to other threads, of this process as well."""
    # On Linux each thread has a niceness of its own.
    os.nice(_NICE)


def give_way() -> None:
    """Leave the processor to other processes: by the scheduler's groups, too, where it has them."""
    yield_to_others()
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(f"{_NICE}")


def _priority() -> int:
    return int(os.environ.get(PRIORITY, _DEFAULT_PRIORITY))


def _take_priority(priority: int) -> bool:
    """Take a priority; return False, without it, where as many processes as may have one."""
    if priority <= 0:
        return True
    most = _NODES_A_CORE * (os.cpu_count() or 1)
    with (private_folder() / "priority").open("w") as turn:
        # Several that look at once would all find a place.
        fcntl.flock(turn, fcntl.LOCK_EX)
        if _realtime_processes() >= most:
            return False
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    return True


def _realtime_processes() -> int:
    """Return how many processes have the priority of a node with a loop, or of a recorder."""
    kinds = {(_priority(), os.SCHED_FIFO), (_priority() - 1, os.SCHED_FIFO)}
    found = 0
    for process in Path("/proc").glob("[0-9]*/stat"):
        # It may have ended meanwhile.
        with suppress(OSError, IndexError):
            fields = process.read_text("utf-8", "replace").rpartition(")")[2].split()
            found += (int(fields[_PRIORITY_AT]), int(fields[_POLICY_AT])) in kinds
    return found


def _lock_memory() -> None:
    """Keep the memory from being swapped out, unless a limit would make that fail later on."""
    if resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY:
        ctypes.CDLL(None).mlockall(_MCL_CURRENT_AND_FUTURE)


def _leave_to_wakeup(*_: object) -> None:
    """Keep Python from raising; the wake-up pipe has the signal already."""
