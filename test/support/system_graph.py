"""Real nodes in real processes for the system tests, each graph in a ROS domain of its own."""

from __future__ import annotations

import fcntl
import json
import os
import re
import resource
import signal
import subprocess
import time
from contextlib import suppress
from itertools import count, islice
from pathlib import Path
from tempfile import gettempdir
from typing import TYPE_CHECKING, Any

import pytest

try:
    import rclpy
    from lifecycle_msgs.msg import Transition
    from rcl_interfaces.srv import SetParametersAtomically
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter
    from rclpy.signals import SignalHandlerOptions

    import flexarm_msgs.msg  # noqa: F401 - the workspace is built and sourced
    from flexarm_bringup.graph.operator import Operator
    from flexarm_bringup.graph.processes import NAMESPACE, LaunchError
    from flexarm_node.process import DIE_WITH_PARENT

    INSTALL = Path(os.environ["FLEXARM_INSTALL"])
    ROOT = Path(os.environ["FLEXARM_ROOT"])
except (ImportError, KeyError) as problem:
    pytest.fail(
        f"the system tests need the environment ({problem}): run ./flexarm test", pytrace=False
    )

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from types import TracebackType


PACKAGES = {
    "daq": "flexarm_daq",
    "experiment": "flexarm_daq",
    "recorder": "flexarm_daq",
    "player": "flexarm_daq",
    "ident": "flexarm_ident",
    "controller": "flexarm_control",
    "tuner": "flexarm_control",
    "live": "flexarm_live",
    "foxglove": "flexarm_live",
}
"""Nodes by name, and the package that each belongs to."""
_COMPOSED = "flexarm_bringup"

PATIENCE_S = 400.0
"""Deadline of everything that usually takes a moment; the machine may be busy."""

TRANSITIONS = {
    "configure": Transition.TRANSITION_CONFIGURE,
    "activate": Transition.TRANSITION_ACTIVATE,
    "deactivate": Transition.TRANSITION_DEACTIVATE,
    "cleanup": Transition.TRANSITION_CLEANUP,
}
_POLL_S = 0.05
_END_S = 10.0
_MARK = "FLEXARM_TEST_GRAPH"
FIRST_WORD = re.compile(
    r"^(?:flexarm(?: \w+)?: (?:at work|the machine is busy.*)|  waiting for .* so far)\n",
    re.MULTILINE,
)
"""What a verb says only where the machine is busy."""
_DOMAINS = count(os.getpid())


def executable(name: str) -> Path:
    """Return where the executable of a node must be, or of `loop`, daq and controller in one."""
    package = PACKAGES.get(name, _COMPOSED)
    return INSTALL / package / "lib" / package / f"{name}_node"


def ros_arguments(parameters: Mapping[str, Any], *more: str) -> list[str]:
    """Return the command line of parameters and of further ROS arguments."""
    # A JSON value is a YAML value.
    pairs = [f"{name}:={json.dumps(value)}" for name, value in parameters.items()]
    return ["--ros-args", *(word for pair in pairs for word in ("-p", pair)), *more]


def eventually(condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> None:
    """Poll until a condition holds; fail when it does not in time."""
    deadline_s = time.monotonic() + patience_s
    while not condition():
        if time.monotonic() > deadline_s:
            pytest.fail(f"{what} did not come within {patience_s:.0f} s")
        time.sleep(_POLL_S)


def fill_disk(pid: int, file: Path) -> None:
    """Let a file grow by a few more kB and no further, for one process.

    No root is needed for a disk that is full for one process.
    """
    limit = file.stat().st_size + 10_000
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (limit, limit))


def claim_domain() -> tuple[int, int]:
    """Return a ROS domain that no other test run uses, and the open file that says so."""
    for number in islice(_DOMAINS, 100):
        # Above 100 the ports are those that the system gives to anybody.
        domain = 1 + number % 100
        lock = Path(gettempdir(), f"flexarm_test_domain_{domain}")
        with suppress(OSError):
            claim = os.open(lock, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                fcntl.flock(claim, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(claim)
            else:
                return domain, claim
    pytest.fail("every ROS domain is in use by another test run")


class Process:
    """Started program and its output."""

    def __init__(self, command: list[str], log: Path, environment: Mapping[str, str]) -> None:
        self.log = log
        with log.open("wb") as output:
            self.popen = subprocess.Popen(  # noqa: S603 - our own programs
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=dict(environment),
            )

    @property
    def printed(self) -> str:
        """Everything printed so far, but for the first word of a verb on a busy machine."""
        return FIRST_WORD.sub("", self.log.read_text(errors="replace"))

    def wait_for(self, text: str) -> None:
        """Wait until a text is printed; fail when it is not, or when the program ends first."""
        eventually(lambda: text in self.printed or self.popen.poll() is not None, text)
        if text not in self.printed:
            pytest.fail(f"ended with {self.popen.returncode}, it printed: {self.printed}")

    def send(self, *signals: signal.Signals) -> None:
        """Send signals, one after the other at once."""
        for each in signals:
            self.popen.send_signal(each)

    def exit_code(self, patience_s: float = PATIENCE_S) -> int:
        """Wait for the end."""
        try:
            return self.popen.wait(patience_s)
        except subprocess.TimeoutExpired:
            pytest.fail(f"still running after {patience_s:.0f} s; it printed: {self.printed}")

    def end(self) -> None:
        """Wait for the end, and force it when it does not come."""
        try:
            self.popen.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            self.popen.wait()


class Graph:
    """ROS domain: nodes as processes, and an operator in this process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.domain, self._claim = claim_domain()
        self.environment = os.environ | {
            "ROS_DOMAIN_ID": str(self.domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            # A test run shares its machine with others.
            "FLEXARM_PRIORITY": "0",
            _MARK: str(folder),
        }
        self._processes: list[Process] = []
        self._expected_to_run: list[Process] = []

    def __enter__(self) -> Graph:  # noqa: PYI034 - Self needs Python 3.11
        self.context = rclpy.Context()
        rclpy.init(
            context=self.context,
            domain_id=self.domain,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        self.node = rclpy.create_node("tester", namespace=NAMESPACE, context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self.operator = Operator(self.node, self._executor, self.check)
        return self

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc_value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for process in self._processes:
            process.popen.terminate()
        for process in self._processes:
            process.end()
        for survivor in self.survivors():
            with suppress(ProcessLookupError):
                os.kill(survivor, signal.SIGKILL)
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
        os.close(self._claim)

    def start(self, name: str, parameters: Mapping[str, Any] | None = None, *more: str) -> Process:
        """Start a node that is to run until it is told to stop."""
        process = self.run_node(name, parameters or {}, *more)
        self._expected_to_run.append(process)
        return process

    def run_node(self, name: str, parameters: Mapping[str, Any], *more: str) -> Process:
        """Start a node that ends by itself."""
        # A test run that is killed shall leave no node in a domain that the next one takes.
        environment = self.environment | {DIE_WITH_PARENT: str(os.getpid())}
        return self._run([str(executable(name)), *ros_arguments(parameters, *more)], environment)

    def run(self, command: list[str]) -> Process:
        """Start any program in the domain."""
        return self._run(command, self.environment)

    def _run(self, command: list[str], environment: Mapping[str, str]) -> Process:
        log = self.folder / f"{len(self._processes)}_{Path(command[0]).name}.log"
        process = Process(command, log, environment)
        self._processes.append(process)
        return process

    def stop(self, process: Process, *signals: signal.Signals) -> int:
        """Send signals, SIGINT if none is named, and return the exit code."""
        self._expected_to_run.remove(process)
        process.send(*(signals or (signal.SIGINT,)))
        return process.exit_code()

    def check(self) -> None:
        """Fail when a node that is to run has ended."""
        for process in self._expected_to_run:
            if process.popen.poll() is not None:
                pytest.fail(f"{process.log.name}: {process.popen.returncode}: {process.printed}")

    def survivors(self, program: str = "") -> list[int]:
        """Return the processes of this graph that are alive, all or those of one program."""
        mark = f"{_MARK}={self.folder}".encode()
        found = []
        for path in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                is_ours = mark in (path / "environ").read_bytes().split(b"\0")
                words = (path / "cmdline").read_text().split("\0")[:2]
                if is_ours and (not program or program in {Path(word).name for word in words}):
                    found.append(int(path.name))
        return found

    def wait(
        self, condition: Callable[[], bool], what: str, patience_s: float = PATIENCE_S
    ) -> None:
        """Spin until a condition holds; LaunchError when it does not in time.

        It tells what the nodes have printed.
        """
        try:
            self.operator.wait(condition, what, patience_s)
        except LaunchError as error:
            printed = "\n".join(f"{each.log.name}: {each.printed}" for each in self._processes)
            raise LaunchError(f"{error}; the nodes printed:\n{printed}") from None

    def call(
        self, service: type, name: str, request: object, patience_s: float = PATIENCE_S
    ) -> Any:  # noqa: ANN401
        """Call a service below the namespace and return its response."""
        return self.operator.call(service, name, request, patience_s)

    def transition(self, name: str, label: str) -> bool:
        """Ask a managed node for a transition; return whether it succeeded."""
        return self.operator.transition(name, TRANSITIONS[label])

    def state_of(self, name: str) -> str:
        """Return the lifecycle state of a managed node."""
        return str(self.operator.state(name).label)

    def await_state(self, name: str, label: str, patience_s: float = PATIENCE_S) -> None:
        """Wait until a managed node is in a lifecycle state; it is asked now and then."""
        eventually(lambda: self.state_of(name) == label, f"{name} {label}", patience_s)

    def refusal(self, name: str, values: Mapping[str, Any]) -> str:
        """Set parameters together; return the reason of the refusal, empty when they are set."""
        request = SetParametersAtomically.Request(
            parameters=[
                Parameter(key, value=value).to_parameter_msg() for key, value in values.items()
            ]
        )
        result = self.call(
            SetParametersAtomically, f"{name}/set_parameters_atomically", request
        ).result
        assert result.successful == (not result.reason)
        return str(result.reason)

    def configure_loop(self) -> None:
        """Configure daq and controller."""
        for name in ("daq", "controller"):
            assert self.transition(name, "configure")

    def activate_loop(self) -> None:
        """Configure daq and controller, and activate the controller: ready to sample.

        It waits for the recorder, if there is one: a run in virtual time may be over before that
        has heard of everybody.
        """
        if any(executable("recorder").name in process.log.name for process in self._processes):
            self.operator.await_recorder()
        self.configure_loop()
        self.operator.activate("controller")
