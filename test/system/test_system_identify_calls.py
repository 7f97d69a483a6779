"""Many calls at once, and jobs that hang, at a node in this process."""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
from rclpy.action import ActionClient
from rclpy.action.client import GoalStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from flexarm_ident import ident_node
from flexarm_msgs.action import IdentifyBags
from flexarm_msgs.srv import Identify
from support.system_graph import claim_domain, eventually

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.system


JOB = """
import signal, time
from pathlib import Path
from flexarm_core.computation import serve
from flexarm_core.errors import IdentificationError

def hang(asked, report):
    if Path("{mark}").exists():
        raise IdentificationError("worked on")
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    report("Hankel matrices", 0.1)
    time.sleep(1000.0)

serve(hang)
"""
"""Job that hangs, and hears no interrupt, until there is a file."""


class Caller:
    """Node that calls the identification beside it, in the same executor."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.mark = folder / "hangs_no_more"
        (folder / "hanging_job.py").write_text(JOB.format(mark=self.mark))
        monkeypatch.syspath_prepend(str(folder))
        monkeypatch.setattr(ident_node, "_JOB", "hanging_job")
        self.ident = ident_node.IdentNode()
        self.node = rclpy.create_node("caller", namespace="/flexarm")
        self.service = self.node.create_client(Identify, "identify")
        self.canceller = self.node.create_client(Trigger, "ident/cancel")
        self.action = ActionClient(self.node, IdentifyBags, "identify_bags")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.ident)
        self._executor.add_node(self.node)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()
        for client in (self.service, self.canceller):
            eventually(client.service_is_ready, "the service")
        eventually(self.action.server_is_ready, "the action")

    def identify(self, *uris: str) -> Any:  # noqa: ANN401 - a future
        return self.service.call_async(Identify.Request(bag_uris=list(uris) or ["run1"]))

    def begin(self) -> Any:  # noqa: ANN401 - a future
        """Call, and wait until the job hangs."""
        future = self.identify()
        eventually(self.is_at_work, "the job")
        return future

    def is_at_work(self) -> bool:
        """Return whether the job has come to where it hangs."""
        at_work = self.ident._at_work
        return at_work is not None and at_work.stage == "Hankel matrices"

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.ident.stop()
        self.action.destroy()
        self.ident.destroy_node()
        self.node.destroy_node()

    def _spin(self) -> None:
        while not self._ended.is_set():
            with suppress(rclpy.executors.TimeoutException):
                self._executor.spin_once(timeout_sec=0.1)


def answer_of(future: Any) -> Any:  # noqa: ANN401 - a message
    eventually(future.done, "an answer")
    return future.result()


@pytest.fixture
def caller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Caller]:
    domain, _ = claim_domain()
    rclpy.init(
        args=["--ros-args", "-p", f"output_folder:='{tmp_path}'"],
        domain_id=domain,
        signal_handler_options=SignalHandlerOptions.NO,
    )
    made = Caller(tmp_path, monkeypatch)
    yield made
    made.close()
    rclpy.try_shutdown()


def test_hundred_calls_at_once___are_all_answered(caller: Caller) -> None:
    at_work = caller.begin()
    futures = [caller.identify() for _ in range(100)]
    answers = [answer_of(future) for future in futures]
    assert not any(answer.success for answer in answers)
    for answer in answers:
        assert answer.message.startswith(
            "busy with another identification (run1, Hankel matrices, "
        )
        assert "no call is queued" in answer.message
    assert not at_work.done()


def test_job_that_hangs___ends_when_cancelled(caller: Caller) -> None:
    hanging = caller.begin()
    reported = answer_of(caller.canceller.call_async(Trigger.Request()))
    assert reported.success
    assert reported.message.startswith("cancelled: run1, Hankel matrices, ")
    answer = answer_of(hanging)
    assert not answer.success
    assert answer.message == "cancelled in Hankel matrices: nothing was written"

    caller.mark.touch()
    assert answer_of(caller.identify()).message == "worked on"


def test_goal_that_hangs___is_cancelled(caller: Caller) -> None:
    handle = answer_of(caller.action.send_goal_async(IdentifyBags.Goal(bag_uris=["run1"])))
    eventually(caller.is_at_work, "the job")
    ended = handle.get_result_async()
    answer_of(handle.cancel_goal_async())
    assert answer_of(ended).status == GoalStatus.STATUS_CANCELED
    assert "cancelled in Hankel" in answer_of(ended).result.message


def test_cancel___with_nothing_at_work___says_so(caller: Caller) -> None:
    reported = answer_of(caller.canceller.call_async(Trigger.Request()))
    assert (reported.success, reported.message) == (False, "no identification is at work")


@pytest.mark.parametrize(
    ("uri", "complaint"),
    [
        ("~no_such_user/run", "~no_such_user/run: no home folder of ~no_such_user is known"),
        ("file:///tmp/%00run", "no file has a name with a zero byte"),
        ("file://[/run", "file://[/run: no URI of a bag: "),
    ],
)
def test_path_that_no_bag_can_have___is_refused_in_a_line(
    caller: Caller, uri: str, complaint: str
) -> None:
    answer = answer_of(caller.identify(uri))
    assert not answer.success
    assert complaint in answer.message
    assert "internal error" not in answer.message
    assert "\n" not in answer.message
