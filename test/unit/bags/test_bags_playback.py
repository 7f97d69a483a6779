from __future__ import annotations

import os
from itertools import islice, pairwise
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.playback import DueMessage, PlaybackError, PlaybackPlan, PlayedTopic
from flexarm_bags.writer import BagWriter
from support.bag_samples import (
    FOREIGN_FORMATS,
    START_NS,
    Sent,
    arm_state,
    motor_command,
    recorded_topics,
    reference,
    write_bag,
    write_foreign_bag,
)

if TYPE_CHECKING:
    from pathlib import Path

STEP_NS = 100_000_000


def steps(count: int) -> list[Sent]:
    """Return one reference every 0.1 s, its value its number."""
    return [reference(START_NS + k * STEP_NS, float(k)) for k in range(count)]


def raws(count: int) -> list[bytes]:
    return [message.raw for message in steps(count)]


def test_messages___whole_bag___are_due_at_their_log_times(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", steps(4))

    due = list(PlaybackPlan(bag).messages())

    assert [message.due_s for message in due] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert [message.raw for message in due] == raws(4)
    assert {message.topic for message in due} == {"/flexarm/reference"}


def test_messages___several_topics___come_in_order_of_log_time(tmp_path: Path) -> None:
    late = motor_command(1, START_NS + 400, 1.0)
    early = arm_state(1, START_NS)
    bag = write_bag(tmp_path / "run", [late, early])

    assert list(PlaybackPlan(bag).messages()) == [
        DueMessage(0.0, early.topic, early.raw, START_NS),
        DueMessage(400e-9, late.topic, late.raw, START_NS + 400),
    ]


def test_messages___rate_two___are_due_in_half_the_time(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", steps(4))

    due = PlaybackPlan(bag, rate=2.0).messages()

    assert [message.due_s for message in due] == pytest.approx([0.0, 0.05, 0.1, 0.15])


def test_messages___start_and_duration___are_in_the_time_of_the_bag(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", steps(8))

    due = list(PlaybackPlan(bag, rate=2.0, start_s=0.15, duration_s=0.3).messages())

    assert [message.raw for message in due] == raws(8)[2:5]
    assert [message.due_s for message in due] == pytest.approx([0.025, 0.075, 0.125])


def test_messages___loop___start_again_where_the_bag_ends(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", steps(3))

    due = list(islice(PlaybackPlan(bag, loop=True).messages(), 7))

    assert [message.raw for message in due] == [*raws(3), *raws(3), raws(1)[0]]
    assert [message.due_s for message in due] == pytest.approx(
        [0.0, 0.1, 0.2, 0.2, 0.3, 0.4, 0.4], abs=1e-8
    )


@settings(max_examples=25)
@given(
    times_ns=st.lists(st.integers(0, 10**10), min_size=1, max_size=20),
    rate=st.floats(0.01, 100.0),
    loop=st.booleans(),
)
@pytest.mark.slow
def test_messages___any_bag___due_times_never_decrease(
    tmp_path_factory: pytest.TempPathFactory, times_ns: list[int], rate: float, *, loop: bool
) -> None:
    bag = write_bag(
        tmp_path_factory.mktemp("play") / "run", [reference(time_ns, 0.0) for time_ns in times_ns]
    )

    plan = PlaybackPlan(bag, rate=rate, loop=loop)
    due = [message.due_s for message in islice(plan.messages(), 3 * len(times_ns))]

    assert len(due) == (3 if loop else 1) * len(times_ns)
    assert due[0] == 0.0
    assert all(earlier <= later for earlier, later in pairwise(due))
    span_s = (max(times_ns) - min(times_ns)) / 1e9
    assert due[len(times_ns) - 1] == pytest.approx(span_s / rate)


@pytest.mark.parametrize(("storage", "compression"), FOREIGN_FORMATS)
def test_messages___foreign_bag___play_the_same(
    tmp_path: Path, storage: StoragePlugin, compression: CompressionMode
) -> None:
    bag = write_foreign_bag(tmp_path / "run", steps(5), storage, compression)

    assert [message.raw for message in PlaybackPlan(bag).messages()] == raws(5)


def test_topics___recorded_qos_and_type___are_those_to_advertise(tmp_path: Path) -> None:
    messages = [arm_state(1, START_NS), reference(START_NS, 1.0), reference(START_NS + 1, 2.0)]
    state, latched = recorded_topics(messages)
    state_qos = TopicQos(reliability="best_effort", depth=5)
    latched_qos = TopicQos(durability="transient_local", depth=1)
    with BagWriter(
        tmp_path / "run",
        [
            RecordedTopic(state.name, state.definition, state_qos),
            RecordedTopic(latched.name, latched.definition, latched_qos),
        ],
    ) as bag:
        for message in messages:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)

    assert PlaybackPlan(tmp_path / "run").topics() == (
        PlayedTopic("/flexarm/state", "flexarm_msgs/msg/ArmState", state_qos, 1),
        PlayedTopic("/flexarm/reference", "std_msgs/msg/Float64", latched_qos, 2),
    )


def test_topics___no_qos_recorded___offers_the_default(tmp_path: Path) -> None:
    bag = write_foreign_bag(tmp_path / "run", steps(1), StoragePlugin.SQLITE3)

    (topic,) = PlaybackPlan(bag).topics()

    assert topic.qos == TopicQos()


@pytest.mark.parametrize(
    ("settings_", "complaint"),
    [
        ({"rate": 0.0}, r"rate 0\.0 must be a positive number"),
        ({"rate": float("nan")}, "rate nan must be a positive number"),
        ({"start_s": -1.0}, r"start -1\.0 s must not be negative"),
        ({"duration_s": 0.0}, r"duration 0\.0 s must be positive"),
    ],
)
def test_plan___number_out_of_range___names_it(
    tmp_path: Path, settings_: dict[str, float], complaint: str
) -> None:
    with pytest.raises(PlaybackError, match=complaint):
        PlaybackPlan(tmp_path, **settings_)  # type: ignore[arg-type]


def test_plan___missing_bag___names_it(tmp_path: Path) -> None:
    with pytest.raises(PlaybackError, match="nothing: no such bag"):
        PlaybackPlan(tmp_path / "nothing")


def test_messages___start_behind_the_end___says_so(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", steps(2))

    with pytest.raises(PlaybackError, match=r"run: no message from 5\.0 s on"):
        list(PlaybackPlan(bag, start_s=5.0).messages())


def test_messages___part_between_messages___says_so_instead_of_looping_for_ever(
    tmp_path: Path,
) -> None:
    bag = write_bag(tmp_path / "run", steps(3))

    with pytest.raises(PlaybackError, match=r"no message from 0\.01 s on"):
        list(PlaybackPlan(bag, start_s=0.01, duration_s=0.05, loop=True).messages())


def test_messages___empty_bag___says_so(tmp_path: Path) -> None:
    BagWriter(tmp_path / "run", recorded_topics(steps(1))).close()

    with pytest.raises(PlaybackError, match="run: no message"):
        list(PlaybackPlan(tmp_path / "run").messages())


def test_messages___truncated_bag___points_to_the_repair(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", steps(100))
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-100])

    # A recorder may still be at work.
    advice = "end the record if it still runs, else try `flexarm bag repair"
    with pytest.raises(PlaybackError, match=rf"run: cannot read: .*; {advice}"):
        list(PlaybackPlan(bag).messages())
    long_ago_s = file.stat().st_mtime - 60.0
    os.utime(file, (long_ago_s, long_ago_s))
    with pytest.raises(PlaybackError, match=r"run: cannot read: .*; try `flexarm bag repair"):
        list(PlaybackPlan(bag).messages())


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("", "no bag: the folder has no metadata.yaml$"),
        ("README.md", "no bag: expected a rosbag2 folder or a .mcap or .db3 file$"),
        ("run.bag", "no bag: a bag of ROS 1 is converted by `rosbags-convert --src FILE"),
        ("run.NPZ", "no bag: save its signals as CSV"),
        ("run.csv.gz", "no bag: unpack it first$"),
    ],
)
def test_plan___what_is_no_bag___is_not_to_be_repaired(
    tmp_path: Path, name: str, complaint: str
) -> None:
    (tmp_path / (name or "README.md")).write_text("no bag")
    with pytest.raises(PlaybackError, match=complaint):
        PlaybackPlan(tmp_path / name)
