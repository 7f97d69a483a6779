from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import pytest

from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_daq.nodes.recording import LastMessages, Recording
from support.acquisition_bench import Clock
from support.bag_samples import START_NS, arm_state, mcap_file, motor_command, recorded_topics
from support.recorded_samples import content, salvaged

if TYPE_CHECKING:
    from pathlib import Path

MS = 1_000_000
NOW_NS = START_NS + 1000 * MS
QUIET_S = 0.5
QUIET_MS = round(QUIET_S * 1e3)
STATE, COMMAND = 0, 1
NAMES = ("/flexarm/state", "/flexarm/command")
SAMPLES = [arm_state(k, START_NS + k * MS) for k in range(1, 6)]
COMMANDS = [motor_command(k, START_NS + k * MS, 0.1) for k in range(1, 6)]


class Raw(NamedTuple):
    topic: int
    raw: bytes
    source_ns: int


def sample(number: int) -> Raw:
    """Return a sample that is sent so many milliseconds after the start."""
    return Raw(STATE, SAMPLES[number - 1].raw, START_NS + number * MS)


def command(number: int) -> Raw:
    return Raw(COMMAND, COMMANDS[number - 1].raw, START_NS + number * MS)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return tmp_path / "bag"


@pytest.fixture
def recording(bag: Path) -> Recording:
    """Return a recording that has the first sample and the first command, 1 ms after the start."""
    made = Recording(NAMES, [], quiet_s=QUIET_S)
    made.open(BagWriter(bag, recorded_topics([SAMPLES[0], COMMANDS[0]])), START_NS)
    made.take([sample(1), command(1)], MS)
    return made


def closed(recording: Recording, bag: Path) -> tuple[list[bytes], list[bytes]]:
    """Close the bag; return the samples and the commands in it."""
    recording.close()
    found = content(bag)
    return found[NAMES[STATE]], found[NAMES[COMMAND]]


def test_end___what_comes_after_it___is_reported_by_its_time_of_sending(
    recording: Recording, bag: Path
) -> None:
    recording.end(3 * MS)
    recording.finish([sample(2), sample(4), command(3), command(4)], 4 * MS)
    assert not recording.ending
    samples, commands = closed(recording, bag)
    assert samples == [SAMPLES[0].raw, SAMPLES[1].raw]
    assert commands == [COMMANDS[0].raw, COMMANDS[2].raw]


def test_end___a_topic_that_lags_behind_another___is_waited_for(
    recording: Recording, bag: Path
) -> None:
    recording.end(3 * MS)
    recording.finish([command(4)], 5 * MS)
    assert recording.ending
    recording.finish([command(5)], 6 * MS)
    recording.finish([sample(2), sample(3)], 9 * MS)
    assert recording.ending
    recording.finish([sample(4)], 10 * MS)
    assert not recording.ending
    samples, commands = closed(recording, bag)
    assert samples == [each.raw for each in SAMPLES[:3]]
    assert commands == [COMMANDS[0].raw]


def test_end___a_topic_that_has_fallen_silent___is_waited_for_a_while(
    recording: Recording,
) -> None:
    recording.end(3 * MS)
    recording.finish([command(4)], 5 * MS)
    recording.finish([command(5)], (2 + QUIET_MS) * MS)
    assert recording.ending
    recording.finish([], (3 + QUIET_MS) * MS)
    assert not recording.ending


def test_end___a_topic_without_a_message_for_long___is_not_waited_for(
    recording: Recording,
) -> None:
    recording.take([command(2)], 2 * QUIET_MS * MS)
    recording.end(2 * QUIET_MS * MS)
    recording.finish([command(5)._replace(source_ns=START_NS + 3 * QUIET_MS * MS)], MS)
    assert not recording.ending


def test_end___after_a_silence_of_all_topics___waits_a_while_for_what_is_on_its_way(
    recording: Recording, bag: Path
) -> None:
    end = 2 * QUIET_MS
    recording.end(end * MS)
    recording.finish([], (end + 1) * MS)
    assert recording.ending
    recording.finish([sample(2)], (end + 2) * MS)
    recording.finish([], (end + 2 + QUIET_MS) * MS)
    assert not recording.ending
    assert closed(recording, bag)[0] == [each.raw for each in SAMPLES[:2]]


def test_end___a_backlog_that_still_comes___renews_the_wait(
    recording: Recording, bag: Path
) -> None:
    recording.end(4 * MS)
    recording.finish([sample(2)], QUIET_MS * MS)
    recording.finish([], (4 + QUIET_MS) * MS)
    assert recording.ending
    recording.finish([sample(3)], (2 * QUIET_MS - 1) * MS)
    recording.finish([], 2 * QUIET_MS * MS)
    assert recording.ending
    recording.finish([], (3 * QUIET_MS - 1) * MS)
    assert not recording.ending
    assert closed(recording, bag)[0] == [each.raw for each in SAMPLES[:3]]


def test_end___that_waits_for_a_topic___leaves_nothing_in_memory_for_long(bag: Path) -> None:
    clock = Clock()
    recording = Recording(NAMES, [], quiet_s=QUIET_S)
    topics = recorded_topics([SAMPLES[0], COMMANDS[0]])
    recording.open(BagWriter(bag, topics, flush_period_s=0.9, clock=clock), START_NS)
    recording.take([sample(1), command(1)], MS)
    recording.end(3 * MS)
    recording.finish([command(4)], 5 * MS)
    assert salvaged(mcap_file(bag)) == []
    clock.sleep(1.0)
    # What came was sent after the end; what came before it must not wait for the end.
    recording.finish([command(5)], 6 * MS)
    assert recording.ending
    assert salvaged(mcap_file(bag)) == [SAMPLES[0].raw, COMMANDS[0].raw]


def test_end___without_a_bag___is_over_at_once(recording: Recording, bag: Path) -> None:
    assert recording.close() == f"2 messages in {bag}"
    recording.end(3 * MS)
    assert not recording.ending
    assert recording.close() == "was not recording"


def test_close___without_a_message___leaves_no_bag(bag: Path) -> None:
    recording = Recording(NAMES, [], quiet_s=QUIET_S)
    recording.open(BagWriter(bag, recorded_topics([SAMPLES[0], COMMANDS[0]])), START_NS)
    assert recording.close() == f"0 messages: no bag is left in {bag}"
    assert not bag.exists()


def test_close___missing_samples___are_named(recording: Recording, bag: Path) -> None:
    recording.take([sample(4)], 4 * MS)
    said = "/flexarm/state: 2 periods without a sample at 1 place"
    assert recording.close() == f"3 messages in {bag}; {said.replace(' missing', '')}"


def test_snapshot___has_what_was_sent_before_it___and_later_messages_wait(
    recording: Recording, bag: Path
) -> None:
    recording.last = LastMessages(10.0, [])
    recording.take([sample(2)], 2 * MS)
    recording.end(3 * MS)
    recording.finish([sample(4), command(3), command(4)], 4 * MS)
    assert not recording.ending
    assert recording.snapshot(NOW_NS) == f"snapshot of 2 messages in {bag}"
    recording.end(5 * MS)
    recording.finish([], (5 + QUIET_MS) * MS)
    assert recording.snapshot(NOW_NS) == f"snapshot of 2 messages in {bag}"
    samples, commands = closed(recording, bag)
    assert samples == [SAMPLES[0].raw, SAMPLES[1].raw, SAMPLES[3].raw]
    assert commands == [COMMANDS[0].raw, COMMANDS[2].raw, COMMANDS[3].raw]


def test_snapshot___without_messages_that_wait___is_refused(recording: Recording) -> None:
    with pytest.raises(RecordingError, match="nothing is kept"):
        recording.snapshot(NOW_NS)


def test_disk___that_refuses_the_data___ends_the_recording_with_its_reason(
    recording: Recording, bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse() -> None:
        raise RecordingError(f"{bag}: cannot write")

    assert recording.writer is not None
    monkeypatch.setattr(recording.writer, "flush_if_due", refuse)
    with pytest.raises(RecordingError, match="cannot write"):
        recording.take([sample(2)], 2 * MS)
    assert recording.writer is None
    with pytest.raises(RecordingError, match=r"recording stopped: .*bag: cannot write"):
        recording.close()


def test_disk___that_refuses_the_data_at_the_end___ends_the_recording_with_its_reason(
    recording: Recording, bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse() -> None:
        raise RecordingError(f"{bag}: cannot write")

    assert recording.writer is not None
    recording.end(3 * MS)
    monkeypatch.setattr(recording.writer, "flush_if_due", refuse)
    with pytest.raises(RecordingError, match="cannot write"):
        recording.finish([], 4 * MS)
    assert not recording.ending
    assert recording.writer is None
