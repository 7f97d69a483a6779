from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any, NamedTuple

import pytest

from flexarm_node.topics.handover import CommandWaiter, DirectHandover, Mailbox

PATIENCE_S = 60.0


class Command(NamedTuple):
    sequence: int
    effort_v: float = 0.0


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


def waiter(handover: DirectHandover, topic: Topic) -> CommandWaiter:
    others: Any = topic
    return CommandWaiter(handover, others)


def test_mailbox___has_the_newest_item_once() -> None:
    box: Mailbox[int] = Mailbox()
    assert box.wait_newest(0.0) is None
    box.put(1)
    box.put(2)
    assert box.wait_newest(0.0) == 2
    assert box.wait_newest(0.0) is None


def test_mailbox___emptied_without_a_wait___waits_its_whole_time_then() -> None:
    box: Mailbox[int] = Mailbox()
    box.put(1)
    assert box.wait_newest(0.0) == 1
    begin_s = time.monotonic()
    assert box.wait_newest(0.05) is None
    assert time.monotonic() - begin_s >= 0.05


def test_mailbox___between_threads___hands_every_item_over_in_turns() -> None:
    there: Mailbox[int] = Mailbox()
    back: Mailbox[int] = Mailbox()

    def answer() -> None:
        while (item := there.wait_newest(PATIENCE_S)) is not None and item >= 0:
            back.put(2 * item)

    thread = threading.Thread(target=answer)
    thread.start()
    answers = []
    for item in range(500):
        there.put(item)
        answers.append(back.wait_newest(PATIENCE_S))
    there.put(-1)
    thread.join()
    assert answers == list(range(0, 1000, 2))


def test_mailbox___closed___is_empty() -> None:
    box: Mailbox[int] = Mailbox()
    box.put(1)
    box.close()
    assert box.wait_newest(0.0) is None


def test_command___handed_over___comes_once_although_its_topic_has_it_too() -> None:
    handover, own = DirectHandover(), Command(1, 0.5)
    topic = Topic([own])
    commands = waiter(handover, topic)
    with handover.answering(ignore):
        handover.give(own)
        assert commands.wait_newest(PATIENCE_S) == own
        assert commands.wait_newest(0.0) is None
    # The topic has its turn behind a command, and when none has come.
    assert topic.waits_s == [0.0, 0.0]


def test_command_of_others___beside_ours___is_heard_behind_ours() -> None:
    handover, own, other = DirectHandover(), Command(1, 0.5), Command(1, -0.5)
    commands = waiter(handover, Topic([other, own]))
    with handover.answering(ignore):
        handover.give(own)
        assert commands.wait_newest(PATIENCE_S) == own
        assert commands.wait_newest(PATIENCE_S) == other


def test_command_of_others___while_our_commander_is_silent___is_heard() -> None:
    handover, other = DirectHandover(), Command(1, -0.5)
    commands = waiter(handover, Topic([other]))
    with handover.answering(ignore):
        assert commands.wait_newest(0.0) == other


def test_commander_of_this_process___inactive___topic_is_waited_on() -> None:
    handover, other = DirectHandover(), Command(7)
    topic = Topic([other])
    commands = waiter(handover, topic)
    assert commands.wait_newest(0.25) == other
    assert topic.waits_s == [0.25]
    assert (commands.topic, commands.publishers()) == (topic.topic, 2)


def test_last_command___of_a_commander_that_was_deactivated___is_still_taken() -> None:
    handover, last = DirectHandover(), Command(9)
    commands = waiter(handover, Topic([last]))
    with handover.answering(ignore):
        handover.give(last)
    assert commands.wait_newest(0.0) == last
    assert commands.wait_newest(0.0) is None


def test_commands___closed___drop_what_waits_and_the_subscription() -> None:
    handover, topic = DirectHandover(), Topic()
    handover.give(Command(1))
    waiter(handover, topic).close()
    assert topic.closed
    assert handover.commands.wait_newest(0.0) is None


def test_answering___ended_by_an_error___is_over() -> None:
    handover = DirectHandover()

    def fail() -> None:
        with handover.answering(ignore):
            assert handover.answers
            raise RuntimeError("torn")

    with pytest.raises(RuntimeError, match="torn"):
        fail()
    assert not handover.answers


def test_sample___that_is_asked_for___is_answered_in_the_thread_that_asks() -> None:
    handover, threads = DirectHandover(), []

    def answer(state: Command) -> None:
        threads.append(threading.get_ident())
        handover.give(Command(state.sequence, 0.5))

    with handover.answering(answer):
        handover.ask(Command(3))
        assert handover.commands.wait_newest(0.0) == Command(3, 0.5)
    handover.ask(Command(4))
    assert threads == [threading.get_ident()]


def test_answer___that_fails_where_it_is_asked_for___is_an_error_of_the_commander() -> None:
    handover = DirectHandover()

    def fail(_: object) -> None:
        raise ArithmeticError("torn")

    with handover.answering(fail):
        handover.ask(Command(1))
        # It has failed once, and is not asked again.
        handover.ask(Command(2))
        with pytest.raises(ArithmeticError, match="torn"):
            handover.check()
        handover.check()
    with handover.answering(ignore):
        handover.ask(Command(3))
        handover.check()


def test_end_of_answering___waits_for_the_answer_that_is_being_given() -> None:
    handover = DirectHandover()
    began, may_end = threading.Event(), threading.Event()
    ended: list[str] = []

    def answer(_: object) -> None:
        began.set()
        assert may_end.wait(PATIENCE_S)
        ended.append("answer")

    asking = threading.Thread(target=handover.ask, args=[Command(1)])

    def ask_and_leave() -> None:
        with handover.answering(answer):
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
