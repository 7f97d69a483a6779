"""Fault schedules: all invariants hold, a seed repeats, planted defects are found and shrunk."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import distributed
import numpy as np
import pytest

from bench.schedules import bag_content
from bench.schedules.messages import (
    STATE,
    Raw,
    command_bytes,
    commander_bytes,
    recorded_topics,
    state_bytes,
)
from bench.schedules.oracle import Violation
from bench.schedules.recorder import Ledger
from bench.schedules.schedule import Event, draw
from bench.schedules.schedules import Failure, campaign, described, run_seeds, shrunk_schedule
from bench.schedules.shrink import shrunk
from bench.schedules.simulation import ACTS, run
from bench.schedules.world import Link, World
from flexarm_bags.writer import BagWriter
from flexarm_core.signals import Command
from flexarm_core.workers import Workers
from flexarm_daq.loop import limiter
from flexarm_daq.loop.commander import Commander, Verdict
from flexarm_daq.loop.exchange import Record
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.nodes.recording import Recording
from support.bag_samples import START_NS, arm_state, header, serialised
from support.exhaustive import first_of, wide

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

PARTS = 3
SEEDS = wide(24, 100)
MOST_EVENTS = 12
QUIET_NS = 500_000_000


@pytest.mark.slow
@pytest.mark.parametrize("part", first_of(range(PARTS)))
def test_seeds___all_invariants_hold(part: int) -> None:
    _, failures = run_seeds(range(part, SEEDS, PARTS))
    assert not failures, "\n".join(map(described, failures))


def test_seed___run_again___does_the_same_to_the_bit() -> None:
    first, second, other = (replace(run(draw(seed)), cpu_s=0.0) for seed in (4, 4, 1))
    assert first == second
    assert other.digest != first.digest


def test_bag___of_a_time_in_which_nobody_sends___is_removed_and_no_violation() -> None:
    silence = Event(1.0, "deactivate", "daq", length_s=1.5)
    bags = [Event(at_s, "record", "recorder", length_s=0.6) for at_s in (1.1, 1.8)]
    assert run(replace(draw(0), commander="square").of((silence, *bags))).violation == ""


def test_bag___that_is_empty_although_messages_came___is_a_violation(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    BagWriter(path, recorded_topics()).close()
    message = Raw(STATE, b"a sample", START_NS, 0.0)
    ledger = Ledger(path, [(message, 0.1)], "closed", f"0 messages in {path}", before=1)
    with pytest.raises(Violation, match="lacks messages"):
        bag_content.check(ledger, every_bit=True)


def test_recorder___killed_while_it_ends_a_bag___has_flushed_what_is_due() -> None:
    # The end waits for samples that are lost, beyond the instant at which a flush is due.
    events = (
        Event(2.6, "drop", "daq>recorder", 1.0, 0.5),
        Event(2.65, "record", "recorder", length_s=0.1),
        Event(3.1, "kill", "recorder", length_s=0.1),
    )
    assert run(draw(0).of(events)).violation == ""


def fed_late(self: Watchdog, _: int) -> None:
    self._answered = self._recent[-1]


@pytest.mark.exhaustive
def test_watchdog___fed_with_the_newest_sample___is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Watchdog, "fed", fed_late)
    assert found(range(1064, 1066), "the drive has the answer to sample") <= MOST_EVENTS


@pytest.mark.slow
def test_limiter___off_by_a_fifth___is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def wide(settings: limiter.LimiterSettings) -> limiter.InputLimits:
        true = limits(settings)
        most_v, slew = 1.2 * settings.max_command_v, 1.2 * true.slew_per_s
        return true._replace(low=-most_v, high=most_v, slew_per_s=slew)

    limits = limiter.LimiterSettings.limits
    monkeypatch.setattr(limiter.LimiterSettings, "limits", wide)
    assert found(range(10), "the limit is") <= MOST_EVENTS


@pytest.mark.exhaustive
def test_recorder___that_acknowledges_before_it_writes___is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flush = BagWriter._flush

    def flush_late(self: BagWriter) -> None:
        self._keep()
        flush(self)

    monkeypatch.setattr(BagWriter, "_flush", flush_late)
    assert found(range(69, 70), "messages are kept, the bag has") <= MOST_EVENTS


@pytest.mark.slow
@pytest.mark.exhaustive
def test_commander___that_forgets_a_silence_at_the_next_one___is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def release(self: Commander) -> None:
        self._spent.clear()
        self._ended = None
        if self._last is not None:
            self._spent.append(self._last.sequence)
        self._last, self._has_rival = None, False

    monkeypatch.setattr(Commander, "release", release)
    assert found(range(20, 21), "is obeyed again with number") <= MOST_EVENTS


@pytest.mark.slow
@pytest.mark.exhaustive
def test_commander___that_obeys_a_number_again___is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    judge = Commander.judge

    def forget(self: Commander, command: Command, newest: int, *, in_time: bool = True) -> Verdict:
        self._spent.clear()
        self._ended = None
        return judge(self, command, newest, in_time=in_time)

    monkeypatch.setattr(Commander, "judge", forget)
    assert found(range(8, 9), "is obeyed again with number") <= MOST_EVENTS


@pytest.mark.slow
@pytest.mark.exhaustive
def test_recorder___that_awaits_recent_topics_alone___is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    end = Recording.end

    def end_of_recent(self: Recording, now_ns: int) -> None:
        end(self, now_ns)
        heard = self._heard_ns
        self._awaited = {k: ns for k, ns in self._awaited.items() if now_ns - heard[k] < QUIET_NS}

    monkeypatch.setattr(Recording, "end", end_of_recent)
    assert found(range(7, 8), "that were on their way") <= MOST_EVENTS


@pytest.mark.slow
@pytest.mark.exhaustive
def test_recorder___whose_wait_a_backlog_does_not_renew___is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    finish = Recording.finish

    def finish_by_the_end(self: Recording, messages: Sequence[Raw], received_ns: int) -> None:
        finish(self, messages, received_ns)
        self._awaited = dict.fromkeys(self._awaited, self._ended_ns)

    monkeypatch.setattr(Recording, "finish", finish_by_the_end)
    assert found(range(9, 10), "that were on their way") <= MOST_EVENTS


def found(seeds: range, what: str) -> int:
    """Return how many events of the first seed that shows a defect are left, shrunk."""
    outcomes = (run(draw(seed)) for seed in seeds)
    seed = next(outcome.seed for outcome in outcomes if what in outcome.violation)
    smallest = shrunk_schedule(draw(seed))
    assert what in run(smallest).violation
    return len(smallest.events)


@pytest.mark.parametrize("wanted", [(), (3,), (0, 7), (1, 2, 9), tuple(range(10))])
def test_shrunk___items_that_fail_together___are_left(wanted: tuple[int, ...]) -> None:
    tried: list[tuple[int, ...]] = []

    def fails(items: Sequence[int]) -> bool:
        tried.append(tuple(items))
        assert list(items) == sorted(items)
        return set(wanted) <= set(items)

    assert shrunk(range(10), fails) == wanted
    # Quadratic at the worst, of which nothing is asked twice in a row.
    assert len(tried) <= 100


def test_shrunk___items_of_which_either_fails___are_one() -> None:
    left = shrunk(range(8), lambda items: 2 in items or 5 in items)
    assert left in {(2,), (5,)}


def test_events___of_every_kind___are_drawn() -> None:
    drawn = {event.kind for seed in range(200) for event in draw(seed).events}
    assert drawn == {*ACTS, "sensor"}


def arrivals(*faults: Event) -> list[tuple[int, float]]:
    """Return number and instant of ten messages, one a second, on a link with faults."""
    world = World()
    received: list[tuple[int, float]] = []
    link = Link(world, "a seed", lambda number: received.append((number, world.now_s)))
    for fault in faults:
        world.at(fault.at_s, link.fail, fault)
    for number in range(10):
        world.at(float(number), link.send, number)
    world.advance(100.0)
    return received


def test_link___without_faults___has_short_delays_in_order() -> None:
    received = arrivals()
    assert [number for number, _ in received] == list(range(10))
    assert all(0.0 < at_s - number < 1e-3 for number, at_s in received)


@pytest.mark.parametrize(
    ("fault", "numbers"),
    [
        (Event(2.5, "drop", value=1.0, length_s=3.0), [0, 1, 2, 6, 7, 8, 9]),
        (Event(2.5, "delay", value=4.0, length_s=3.0), list(range(10))),
        (Event(2.5, "reorder", value=1.5, length_s=3.0), [0, 1, 2, 4, 3, 6, 5, 7, 8, 9]),
        (Event(2.5, "duplicate", value=0.5, length_s=1.0), [0, 1, 2, 3, 3, 4, 5, 6, 7, 8, 9]),
    ],
)
def test_link___with_a_fault___has_it_for_its_time(fault: Event, numbers: list[int]) -> None:
    received = arrivals(fault)
    assert [number for number, _ in received] == numbers
    if fault.kind == "delay":
        # What is sent behind a late message waits for it.
        assert [at_s > 9.0 for _, at_s in received] == [False] * 5 + [True] * 5


def test_messages___are_serialised_as_the_middleware_does() -> None:
    volts = [0.5, -1.0, 2.0, 3.25]
    record = Record(7, 0.1, 5.0, np.array(volts), (1.5,), (0.25,), 6)
    sent = arm_state(
        7,
        START_NS,
        volts,
        command_v=1.5,
        compensation_v=0.25,
        command_sequence=6,
        frame_id="flexarm",
    )
    assert state_bytes(record, volts, START_NS) == sent.raw
    head = header(START_NS, "flexarm")
    assert command_bytes(Command(3, 2, (0.5,), (-0.25,), START_NS)) == serialised(
        "flexarm_msgs/msg/MotorCommand",
        header=head,
        sequence=3,
        state_sequence=2,
        effort_v=0.5,
        compensation_v=-0.25,
    )
    assert commander_bytes(START_NS, "rival 2", "pdpc", uses_outputs=True) == serialised(
        "flexarm_msgs/msg/CommanderInfo", header=head, node="rival 2", law="pdpc", uses_outputs=True
    )


def test_failure___in_words___has_its_schedule() -> None:
    failure = Failure(3, "at 1 s: a reason", repeats=False, schedule="seed 3\n  kill", events=1)
    assert described(failure).splitlines()[:3] == ["seed 3", "  kill", "  -> at 1 s: a reason"]
    assert "does NOT repeat" in described(failure)


@pytest.mark.slow
def test_campaign___dask___does_the_same_on_the_cluster() -> None:
    local_cluster: Any = distributed.LocalCluster
    with local_cluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, processes=False
    ) as cluster:
        figures = campaign(range(2), Workers(dask=cluster.scheduler_address))
    assert figures.seeds == 2
    assert [each.violation for each in figures.failures] == []
    assert figures.samples == sum(run(draw(seed)).samples for seed in range(2))
