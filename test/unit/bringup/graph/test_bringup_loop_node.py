from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_bringup.graph import loop_node
from flexarm_bringup.graph.loop_node import LoopNode, SpunBeside, node_arguments
from flexarm_core.errors import SettingError
from flexarm_daq.nodes.daq_node import DaqNode

if TYPE_CHECKING:
    from collections.abc import Callable


class Executor:
    """Executor whose work is a function; an event that is triggered ends its waits."""

    work: Callable[[], None] = lambda: None

    def __init__(self) -> None:
        self.ended = False

    def add_node(self, node: object) -> None:
        pass

    def spin_once(self) -> None:
        Executor.work()

    def shutdown(self) -> None:
        self.ended = True


class Guard:
    def __init__(self, callback: Callable[[], None]) -> None:
        self.trigger = callback


class Node:
    """Node that notes in which order its parts are ended."""

    def __init__(self, reported: list[str]) -> None:
        self._reported = reported

    def create_guard_condition(self, callback: Callable[[], None]) -> Guard:
        return Guard(callback)

    def stop(self) -> None:
        self._reported.append("controller")

    def destroy_node(self) -> None:
        self._reported.append("controller destroyed")


@pytest.fixture
def reported(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return what is told, in order, by the doubles that stand for the nodes and the executor."""
    reported: list[str] = []
    monkeypatch.setattr(loop_node, "SingleThreadedExecutor", Executor)
    monkeypatch.setattr(Executor, "work", lambda: None)
    monkeypatch.setattr(DaqNode, "__init__", lambda *_: reported.append("daq"))
    monkeypatch.setattr(DaqNode, "stop", lambda _: reported.append("zero"))
    monkeypatch.setattr(DaqNode, "destroy_node", lambda _: reported.append("daq destroyed"))
    return reported


def make(monkeypatch: pytest.MonkeyPatch, reported: list[str]) -> LoopNode:
    monkeypatch.setattr(loop_node, "ControllerNode", lambda *_: Node(reported))
    return LoopNode(node_arguments([]))


def test_arguments___go_to_the_node_that_they_name() -> None:
    line = ["daq.rate_hz:=1e3", "controller.law:=pd", "daq.seed:=3", "--ros-args", "-p", "x:=1"]
    assert node_arguments(line) == {
        "daq": ["--ros-args", "-p", "rate_hz:=1e3", "-p", "seed:=3"],
        "controller": ["--ros-args", "-p", "law:=pd"],
    }
    assert node_arguments([]) == {"daq": [], "controller": []}


@pytest.mark.parametrize("word", ["rate_hz:=1e3", "recorder.bag:=out", "daq.rate_hz", "-p"])
def test_argument___for_neither_node___is_refused(word: str) -> None:
    with pytest.raises(SettingError, match="is not a parameter, such as"):
        node_arguments([word])


def test_argument___after_the_ros_arguments_of_both___is_read_too() -> None:
    line = ["--ros-args", "-r", "__ns:=/arm2", "--", "daq.max_command_v:=2.0"]
    assert node_arguments(line)["daq"] == ["--ros-args", "-p", "max_command_v:=2.0"]


def test_end___takes_the_drive_to_zero_first(
    monkeypatch: pytest.MonkeyPatch, reported: list[str]
) -> None:
    node = make(monkeypatch, reported)
    node.stop()
    node.destroy_node()
    assert reported == ["daq", "zero", "controller", "controller destroyed", "daq destroyed"]
    assert node.failure == ""


def test_end___with_a_callback_that_hangs___leaves_the_controller_behind(
    monkeypatch: pytest.MonkeyPatch, reported: list[str]
) -> None:
    hangs = threading.Event()
    monkeypatch.setattr(loop_node, "_END_S", 0.05)
    monkeypatch.setattr(Executor, "work", lambda: hangs.wait() and None)
    node = make(monkeypatch, reported)
    node.stop()
    node.destroy_node()
    hangs.set()
    assert reported == ["daq", "zero", "controller", "daq destroyed"]


def test_controller___that_cannot_be_made___ends_the_sampling(
    monkeypatch: pytest.MonkeyPatch, reported: list[str]
) -> None:
    def refuse(*_: object) -> Any:  # noqa: ANN401
        raise SettingError("law = 'pdx'")

    monkeypatch.setattr(loop_node, "ControllerNode", refuse)
    with pytest.raises(SettingError, match="pdx"):
        LoopNode(node_arguments([]))
    assert reported == ["daq", "zero"]


def test_error_of_a_callback___ends_the_process_as_a_failure(
    monkeypatch: pytest.MonkeyPatch, reported: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    asked = threading.Event()

    def fail() -> None:
        raise OSError("torn")

    monkeypatch.setattr(loop_node, "request_stop", asked.set)
    monkeypatch.setattr(Executor, "work", fail)
    node = make(monkeypatch, reported)
    assert asked.wait(60.0)
    assert node.failure == "torn"
    assert "OSError: torn" in capsys.readouterr().err


def test_spinning___ended___shuts_its_executor_down(reported: list[str]) -> None:
    node: Any = Node(reported)
    beside = SpunBeside(node)
    assert beside.end()
    assert beside._executor.ended
