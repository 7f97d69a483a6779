from __future__ import annotations

import threading
from collections import deque
from typing import Any

import pytest

from flexarm_core.signals import Command, Sample
from flexarm_node.topics.handover import CommandWaiter, DirectHandover

PATIENCE_S = 60.0


def command(sequence: int, effort: float = 0.0) -> Any:  # noqa: ANN401 - a sample too
    """Return a command; where only its number counts, in the place of a sample too."""
    return Command(sequence, sequence, (effort,), (0.0,))


class Topic:
    """Subscription with the messages of each look at it, and the waits that were asked for."""

    topic = "/flexarm/command"

    def __init__(self, *looks: list[Command]) -> None:
        self._looks = deque(looks)
        self.waits_s: list[float] = []
        self.closed = False

    def publishers(self) -> int:
        return 2

    def wait_all(self, timeout_s: float) -> list[Command]:
        self.waits_s.append(timeout_s)
        return self._looks.popleft() if self._looks else []

    def close(self) -> None:
        self.closed = True


def ignore(_: object) -> None:
    """Answer nothing."""


def nothing() -> None:
    """Do no work."""


def waiter(handover: DirectHandover, topic: Topic) -> CommandWaiter:
    others: Any = topic
    return CommandWaiter(handover, others)


def test_command___handed_over___comes_once_although_its_topic_has_it_too() -> None:
    handover, own = DirectHandover(), command(1, 0.5)
    topic = Topic([own])
    commands = waiter(handover, topic)
    with handover.answering(ignore, nothing):
        handover.give(own)
        assert commands.wait_newest(PATIENCE_S) == own
        assert commands.wait_newest(0.0) is None
    # The topic has its turn behind a command, and when none has come.
    assert topic.waits_s == [0.0, 0.0]


def test_topic___where_commands_are_handed_over_one_after_the_other___is_read_between_them() -> (
    None
):
    handover, own = DirectHandover(), [command(number) for number in range(1, 6)]
    topic = Topic(*([each] for each in own))
    commands = waiter(handover, topic)
    with handover.answering(ignore, nothing):
        for each in own:
            handover.give(each)
            assert commands.wait_newest(PATIENCE_S) == each
    assert topic.waits_s == [0.0] * 4


def test_command_of_others___beside_ours___is_heard_behind_ours() -> None:
    handover, own, other = DirectHandover(), command(1, 0.5), command(1, -0.5)
    commands = waiter(handover, Topic([other, own]))
    with handover.answering(ignore, nothing):
        handover.give(own)
        assert commands.wait_newest(PATIENCE_S) == own
        assert commands.wait_newest(0.01) == other


def test_command_of_others___while_our_commander_is_silent___is_heard() -> None:
    handover, other = DirectHandover(), command(1, -0.5)
    commands = waiter(handover, Topic([other]))
    with handover.answering(ignore, nothing):
        assert commands.wait_newest(0.0) == other


def test_commander_of_this_process___inactive___topic_is_waited_on() -> None:
    handover, other = DirectHandover(), command(7)
    topic = Topic([other])
    commands = waiter(handover, topic)
    assert commands.wait_newest(0.25) == other
    assert topic.waits_s == [0.25]
    assert (commands.topic, commands.publishers()) == (topic.topic, 2)


def test_last_command___of_a_commander_that_was_deactivated___is_still_taken() -> None:
    handover, last = DirectHandover(), command(9)
    commands = waiter(handover, Topic([last]))
    with handover.answering(ignore, nothing):
        handover.give(last)
    assert commands.wait_newest(0.0) == last
    assert commands.wait_newest(0.0) is None


def test_commands___closed___drop_what_waits_and_the_subscription() -> None:
    handover, topic = DirectHandover(), Topic()
    handover.give(command(1))
    waiter(handover, topic).close()
    assert topic.closed
    assert handover.take() is None


def test_answering___ended_by_an_error___is_over() -> None:
    handover = DirectHandover()

    def fail() -> None:
        with handover.answering(ignore, nothing):
            assert handover.answers
            raise RuntimeError("torn")

    with pytest.raises(RuntimeError, match="torn"):
        fail()
    assert not handover.answers


def test_sample___that_is_asked_for___is_answered_in_the_thread_that_asks() -> None:
    handover, threads = DirectHandover(), []

    def answer(state: Sample) -> None:
        threads.append(threading.get_ident())
        handover.give(command(state.sequence, 0.5))

    with handover.answering(answer, nothing):
        handover.ask(command(3))
        assert handover.take() == command(3, 0.5)
    handover.ask(command(4))
    assert threads == [threading.get_ident()]


def test_answer___that_fails_where_it_is_asked_for___is_an_error_of_the_commander() -> None:
    handover = DirectHandover()

    def fail(_: object) -> None:
        raise ArithmeticError("torn")

    with handover.answering(fail, nothing):
        handover.ask(command(1))
        # It has failed once, and is not asked again.
        handover.ask(command(2))
        with pytest.raises(ArithmeticError, match="torn"):
            handover.check()
        handover.check()
    with handover.answering(ignore, nothing):
        handover.ask(command(3))
        handover.check()


def test_end_of_answering___waits_for_the_answer_that_is_being_given() -> None:
    handover = DirectHandover()
    began, may_end = threading.Event(), threading.Event()
    ended: list[str] = []

    def answer(_: object) -> None:
        began.set()
        assert may_end.wait(PATIENCE_S)
        ended.append("answer")

    asking = threading.Thread(target=handover.ask, args=[command(1)])

    def ask_and_leave() -> None:
        with handover.answering(answer, nothing):
            asking.start()
            assert began.wait(PATIENCE_S)
        ended.append("answering")

    leaving = threading.Thread(target=ask_and_leave)
    leaving.start()
    assert began.wait(PATIENCE_S)
    may_end.set()
    leaving.join(PATIENCE_S)
    asking.join(PATIENCE_S)
    assert ended == ["answer", "answering"]


def test_rest_of_the_work___is_done_when_the_command_has_acted___or_at_the_end() -> None:
    handover = DirectHandover()
    done: list[str] = []

    def answer(state: Sample) -> None:
        handover.give(command(state.sequence), lambda: done.append(f"rest of {state.sequence}"))
        done.append(f"answer to {state.sequence}")

    with handover.answering(answer, lambda: done.append("spare")):
        handover.ask(command(1))
        handover.acted()
        handover.acted()
        handover.spare_time()
        handover.ask(command(2))
    handover.acted()
    handover.spare_time()
    assert done == ["answer to 1", "rest of 1", "spare", "answer to 2", "rest of 2"]


def test_check___without_samples___does_what_can_wait() -> None:
    handover, done = DirectHandover(), []
    with handover.answering(ignore, lambda: done.append("spare")):
        handover.ask(command(1))
        handover.check()
        assert done == []
        handover.check()
    assert done == ["spare"]


def test_rest_that_fails___is_an_error_of_the_commander() -> None:
    handover = DirectHandover()

    def fail() -> None:
        raise ArithmeticError("torn")

    with handover.answering(lambda state: handover.give(command(state.sequence), fail), nothing):
        handover.ask(command(1))
        handover.acted()
        handover.ask(command(2))
        assert handover.take() == command(1)
        with pytest.raises(ArithmeticError, match="torn"):
            handover.check()
