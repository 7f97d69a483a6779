from __future__ import annotations

import threading
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

from flexarm_daq.loop.safety import TRANSITIONS, DriveState, Event, Safety
from flexarm_daq.rigs.rig_protocol import RigError
from support.acquisition_bench import PERIOD_S, Bench, Clock, reply
from support.project import PROJECT

if TYPE_CHECKING:
    from flexarm_core.signals import Command
    from flexarm_daq.loop.exchange import Record

DRAWING = PROJECT / "docs" / "images" / "states.svg"
RUNNING = (DriveState.READY, DriveState.DRIVING, DriveState.HELD)
CAUSE_AT, LOOK_AT = 8, 12
"""Samples at which an event is caused, and at which its effect is looked at."""


def arrows() -> list[tuple[DriveState, Event, DriveState]]:
    """Return the events at the arrows of the drawing."""
    return [
        (
            DriveState[arrow.attrib["data-from"]],
            Event[str(event.text)],
            DriveState[arrow.attrib["data-to"]],
        )
        for arrow in ET.parse(DRAWING).iterfind(".//*[@data-from]")  # noqa: S314 - our own file
        for event in arrow
    ]


def drawn() -> dict[tuple[DriveState, Event], DriveState]:
    """Return the drawing as a table."""
    return {(before, event): after for before, event, after in arrows()}


def test_table___is_the_drawing() -> None:
    assert drawn() == TRANSITIONS
    assert len(arrows()) == len(TRANSITIONS)


@pytest.mark.parametrize("state", DriveState)
@pytest.mark.parametrize("event", Event)
def test_machine___every_state_and_event___goes_as_drawn(state: DriveState, event: Event) -> None:
    safety = Safety()
    safety.state = state
    safety.on(event, "why")
    expected = drawn().get((state, event), state)
    assert safety.state is expected
    assert safety.reason == ("why" if expected is not state else "")
    assert safety.counts.total() == (expected is not state)


def test_first_reason___stands() -> None:
    safety = Safety()
    safety.on(Event.START)
    safety.on(Event.SENSOR_FAULT, "first")
    safety.on(Event.FAILURE, "second")
    assert safety.reason == "first"


def test_event___that_happens_again___is_counted_again() -> None:
    safety = Safety()
    for event in (Event.START, *[Event.COMMAND, Event.STALE] * 3):
        safety.on(event)
    assert safety.counts == {Event.START: 1, Event.COMMAND: 3, Event.STALE: 3}


class Walk:
    """Brings a running loop into a state, causes an event, and looks at what came of it."""

    def __init__(self, clock: Clock, state: DriveState, event: Event) -> None:
        self.state, self.event = state, event
        self.stop = threading.Event()
        self.before: DriveState | None = None
        self.after: DriveState | None = None
        self.bench = Bench(clock, self.answer, virtual=True, samples=0)
        self.bench.run_until(self.stop)
        if self.after is None:
            self.after = self.bench.acquisition.safety.state

    def answer(self, record: Record) -> list[tuple[float, Command]]:
        acquisition, sequence = self.bench.acquisition, record.sequence
        if sequence == 3 and self.state is DriveState.HELD:
            acquisition.emergency_stop()
        if sequence == CAUSE_AT:
            self.before = acquisition.safety.state
            self.cause()
        if sequence == LOOK_AT:
            self.after = acquisition.safety.state
            self.stop.set()
            return []
        command = reply(record, 2.0)
        has_happened = sequence >= CAUSE_AT
        if has_happened and self.event is Event.STALE:
            return []
        if has_happened and self.event is Event.TWO_COMMANDERS:
            return [(0.0, command), (0.0, command._replace(efforts=(-2.0,)))]
        if self.state is DriveState.READY and not (has_happened and self.event is Event.COMMAND):
            return []
        return [(0.0, command)]

    def cause(self) -> None:
        rig = self.bench.rig
        if self.event is Event.EMERGENCY_STOP:
            self.bench.acquisition.emergency_stop()
        if self.event is Event.SENSOR_FAULT:
            rig.position_v = float("nan")
        if self.event is Event.FAILURE:
            rig.fails_at = len(rig.read_times_s)
        if self.event is Event.END:
            self.stop.set()


@pytest.mark.parametrize("state", RUNNING)
@pytest.mark.parametrize("event", [event for event in Event if event is not Event.START])
def test_loop___every_state_and_cause___goes_as_drawn_and_drives_in_no_other_state(
    monkeypatch: pytest.MonkeyPatch, state: DriveState, event: Event
) -> None:
    clock = Clock()
    monkeypatch.setattr("flexarm_daq.loop.acquisition.time", clock)

    walk = Walk(clock, state, event)

    assert walk.before is state
    assert walk.after is drawn().get((state, event), state)
    if walk.after is not DriveState.OFF:
        assert [0.0, *walk.bench.rig.writes][-1] == (2.0 if walk.after is DriveState.DRIVING else 0)
    assert walk.bench.rig.calls[-2:] == [("safe_stop", 0.0), ("close", 0.0)]
    assert walk.bench.acquisition.safety.state is DriveState.OFF


def test_emergency_stop___in_the_middle_of_a_period___lets_no_more_command_act(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    monkeypatch.setattr("flexarm_daq.loop.acquisition.time", clock)

    def answer(record: Record) -> list[tuple[float, Command]]:
        if record.sequence == 4:
            bench.acquisition.emergency_stop()
        return [(0.0, reply(record, 2.0 + record.sequence))]

    bench = Bench(clock, answer, virtual=True, samples=8)
    bench.run()
    assert bench.rig.writes == [3.0, 4.0, 5.0, 0.0]
    assert bench.acquisition.safety.counts[Event.EMERGENCY_STOP] == 1
    assert bench.acquisition.safety.reason == "emergency stop"
    # Asked for at sample 4, taken at the fifth.
    assert bench.acquisition.held_s == pytest.approx(4 * PERIOD_S)


def test_error_after_a_hold___keeps_the_first_reason_and_ends_off(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    monkeypatch.setattr("flexarm_daq.loop.acquisition.time", clock)
    bench = Bench(clock, lambda record: [(0.0, reply(record, 2.0))], virtual=True, samples=9)
    bench.acquisition.emergency_stop()
    bench.rig.fails_at = 3
    with pytest.raises(RigError):
        bench.run()
    assert bench.acquisition.safety.reason == "emergency stop"
    assert bench.acquisition.safety.state is DriveState.OFF
