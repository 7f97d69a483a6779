"""Nodes as processes: found, started, stopped in order, none left behind."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_bringup.console.interruption import held_back
from flexarm_core.errors import FlexarmError
from flexarm_node.parameter_files import LOOP

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from types import TracebackType

NAMESPACE = "/flexarm"
"""Namespace of an arm that is given none."""
MANAGED = (*LOOP, "experiment")
"""The nodes with a lifecycle."""
_ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_PATIENCE_S = 8.0
_KEPT_VOLTAGE = ": a board keeps its last voltage, so at a real rig press the emergency stop"
_CUT_RECORD = ": a record that it was writing is cut off, `flexarm bag repair` gets what is there"
_AFTER = {"daq_node": _KEPT_VOLTAGE, "loop_node": _KEPT_VOLTAGE, "recorder_node": _CUT_RECORD}
"""Advice for the user when the process of a node was killed."""
_LOGGER = re.compile(r"\] \[[\w.]+\.(\w+)\]: ")
_PLACE = re.compile(r' +File "(.+)", line (\d+)')


class LaunchError(FlexarmError):
    """A program cannot be found or did not do what was expected."""


class HeldDriveError(LaunchError):
    """The drive was held at zero in a run, or its loop failed: the record is not that of a run.

    Parameters
    ----------
    trouble : str
        What has happened, and when; what to do follows it in the message.
    """

    def __init__(self, trouble: str) -> None:
        super().__init__(f"{trouble}; fix the cause and run again (docs/safety.md)")


@dataclass(frozen=True)
class NodeProgram:
    """Node to start, named as for `ros2 run`; its parameters come after those of its files.

    It has the name of its executable, or one of its own beside another one of that executable. An
    executable of several nodes is given each parameter as that of one of them, `daq.rate_hz`.
    """

    package: str
    executable: str
    parameters: Mapping[str, Any]
    files: tuple[Path, ...] = ()
    namespace: str = NAMESPACE
    name: str = ""
    has_several: bool = False

    def command(self) -> list[str]:
        """Return the command line that starts it."""
        assignments = [f"{name}:={as_yaml(value)}" for name, value in self.parameters.items()]
        line = [str(find_executable(self.package, self.executable))]
        if self.has_several:
            line += assignments
            assignments = []
        line += ["--ros-args", "-r", f"__ns:={self.namespace}"]
        if self.name:
            line += ["-r", f"__node:={self.name}"]
        name = self.executable.removesuffix("_node")
        line += ["--enclave", f"{self.namespace.rstrip('/')}/{name}"]
        for file in self.files:
            line += ["--params-file", str(file)]
        for assignment in assignments:
            line += ["-p", assignment]
        return line


def find_executable(package: str, executable: str) -> Path:
    """Return the path of a node's executable; raise a `LaunchError` that lists those there are."""
    # Not there without ROS 2, where verbs that need no node import this module too.
    from ament_index_python.packages import (  # noqa: PLC0415
        PackageNotFoundError,
        get_package_prefix,
    )

    try:
        folder = Path(get_package_prefix(package), "lib", package)
    except PackageNotFoundError:
        raise LaunchError(f"no package {package} in this environment") from None
    path = folder / executable
    if not path.is_file():
        known = sorted(each.name for each in folder.iterdir()) if folder.is_dir() else []
        raise LaunchError(f"{package} has no {executable}; it has {', '.join(known) or 'none'}")
    return path


class NodeProcesses:
    """The processes of a graph; leaving the context stops them in reverse order.

    They load their libraries from the start on, and join the graph when they are let in: only then
    it is known that their place there is free.

    Each one is in a session of its own, so that Ctrl-C reaches this process only and the order of
    the shutdown is ours. Should this process die, the kernel tells them to stop.

    Parameters
    ----------
    programs : sequence of NodeProgram
        Nodes to start, in this order.
    log : Path
        File that gets what they print.
    """

    def __init__(self, programs: Sequence[NodeProgram], log: Path) -> None:
        self._commands = [program.command() for program in programs]
        self.log = log
        self._log_start = 0
        self._gate = -1
        self._replaceable: set[str] = set()
        self._processes: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> NodeProcesses:  # noqa: PYI034 - Self needs Python 3.11
        self.log.parent.mkdir(parents=True, exist_ok=True)
        try:
            # A process of which nobody knows yet could not be stopped.
            with held_back(*_ENDINGS):
                self._start()
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc_value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()

    def let_in(self) -> None:
        """Let the nodes join the graph."""
        # Where none lives any more, the next check says why.
        with suppress(BrokenPipeError):
            os.write(self._gate, b"+" * len(self._processes))

    def stop(self) -> None:
        """Stop the processes that still run, the last one first."""
        # A second Ctrl-C, or a terminal that goes after it, must not break the shutdown.
        previous = {each: signal.signal(each, signal.SIG_IGN) for each in _ENDINGS}
        try:
            for process in reversed(self._processes):
                _stop(process)
        finally:
            for each, handler in previous.items():
                signal.signal(each, handler)
            self._close_gate()

    def end(self, *executables: str) -> None:
        """Stop processes that are no longer needed, by the names of their executables."""
        for process in [each for each in reversed(self._processes) if _name(each) in executables]:
            _stop(process)
            self._processes.remove(process)

    def _start(self) -> None:
        from flexarm_node.process import DIE_WITH_PARENT, GATE  # noqa: PLC0415 - it loads rclpy

        wait, self._gate = os.pipe()
        own = {DIE_WITH_PARENT: str(os.getpid()), GATE: str(wait)}
        with self.log.open("ab") as output, os.fdopen(wait):
            self._log_start = output.tell()
            for command in self._commands:
                self._processes.append(
                    subprocess.Popen(  # noqa: S603 - our own nodes
                        command,
                        stdin=subprocess.DEVNULL,
                        stdout=output,
                        stderr=subprocess.STDOUT,
                        start_new_session=True,
                        pass_fds=(wait,),
                        env=os.environ | own,
                    )
                )

    def _close_gate(self) -> None:
        if self._gate >= 0:
            os.close(self._gate)
            self._gate = -1

    def check(self) -> None:
        """Raise a `LaunchError` with the last line printed for a lost irreplaceable process."""
        for name, ending in self.endings().items():
            if name not in self._replaceable:
                raise LaunchError(ending)

    def let_be_replaced(self, executable: str) -> None:
        """Go on without a node that ends from now on: another one may take its place."""
        self._replaceable.add(executable)

    def losses(self) -> dict[str, str]:
        """Return the endings of those that may be replaced, as `endings` does."""
        return {name: end for name, end in self.endings().items() if name in self._replaceable}

    def endings(self) -> dict[str, str]:
        """Return in words how those have ended that have, by the name of the executable."""
        return {
            _name(each): self._ending(_name(each), code)
            for each in self._processes
            if (code := each.poll()) is not None
        }

    def _ending(self, name: str, code: int) -> str:
        if code < 0:
            return f"{name} was ended by {_signal_name(-code)}{_AFTER.get(name, '')}"
        return f"{name} ended with exit code {code}{self._reason(name.removesuffix('_node'))}"

    def complaint(self, node: str) -> str:
        """Return the last error that a node has logged, or nothing."""
        return self._logged("[ERROR]", node)

    def announcement(self, node: str) -> str:
        """Return the last information that a node has logged, or nothing."""
        return self._logged("[INFO]", node)

    def _logged(self, level: str, node: str) -> str:
        marks = level, f".{node}]: "
        logged = (line for line in reversed(self._printed()) if all(mark in line for mark in marks))
        return next(logged, "").rpartition(marks[1])[2]

    def exit_codes(self) -> dict[str, int | None]:
        """Return how each has ended, None while it runs, by the name of its executable."""
        return {_name(each): each.poll() for each in self._processes}

    def pids(self) -> dict[str, int]:
        """Return the number of each, by the name of its executable."""
        return {_name(each): each.pid for each in self._processes}

    def _printed(self) -> list[str]:
        """Return what these processes have printed: the log may have older lines before."""
        return (
            self.log.read_bytes()[self._log_start :].decode(errors="replace").strip().splitlines()
        )

    def _reason(self, node: str) -> str:
        """Return the end of the log, to be added to a sentence; empty when it is another's."""
        lines = self._printed()
        if not lines:
            return f": it printed nothing ({self.log})"
        # The last line of a traceback names no node.
        logger = _LOGGER.search(lines[-1])
        if logger is not None:
            own = lines[-1] if logger[1] == node else _last_of(lines, f"{node}: ")
            return own and f": {own}"
        return f": {lines[-1]}{_place(lines)}"


def _name(process: subprocess.Popen[bytes]) -> str:
    return Path(str(process.args[0])).name  # type: ignore[index]


def _last_of(lines: Sequence[str], start: str) -> str:
    """Return the last line with a start: what a node says that could not begin; or nothing."""
    return next((line for line in reversed(lines) if line.startswith(start)), "")


def _place(lines: Sequence[str]) -> str:
    """Return file and line of the traceback with which lines end, to be added to its last line."""
    for line in reversed(lines):
        if place := _PLACE.match(line):
            return f" ({place[1]}, line {place[2]})"
        if not line.startswith(" ") and line is not lines[-1]:
            break
    return ""


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _stop(process: subprocess.Popen[bytes]) -> None:
    # SIGINT would interrupt a node that still imports its modules with a traceback in the log.
    for stop_signal in (signal.SIGTERM, signal.SIGINT, signal.SIGKILL):
        if process.poll() is None:
            process.send_signal(stop_signal)
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            continue
        return


def as_yaml(value: object) -> str:
    """Return a value as ROS 2 takes it after ``-p NAME:=``."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (str, Path)):
        return "'" + str(value).replace("'", "''") + "'"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(as_yaml(each) for each in value) + "]"
    return repr(value)
