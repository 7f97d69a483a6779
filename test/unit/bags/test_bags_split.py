"""Split bags: several files as rosbag2 writes them, and every reader of ours on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from flexarm_bags.check import check_bag
from flexarm_bags.metadata import RecordedTopic, TopicQos
from flexarm_bags.playback import PlaybackPlan
from flexarm_bags.reader import opened
from flexarm_bags.repair import repair_bag
from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_ident.reading.read import read_bag
from support.bag_samples import (
    START_NS,
    STEP_NS,
    Sent,
    controlled_run,
    information,
    recorded_topics,
    write_bag,
)
from support.damaged_bags import content

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

FILE_S = 0.1
SAMPLES = 600
"""Of a run of 1.2 s."""


def split_bag(path: Path, messages: Sequence[Sent], file_s: float = FILE_S) -> Path:
    """Write messages into files of so many seconds."""
    with BagWriter(path, recorded_topics(messages), max_file_s=file_s) as bag:
        for message in messages:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
    return path


@pytest.fixture(scope="module")
def messages() -> list[Sent]:
    return controlled_run(SAMPLES)


@pytest.fixture(scope="module")
def split(tmp_path_factory: pytest.TempPathFactory, messages: list[Sent]) -> Path:
    return split_bag(tmp_path_factory.mktemp("split") / "run", messages)


def test_split___by_time___begins_a_file_when_the_time_is_exceeded(
    split: Path, messages: list[Sent]
) -> None:
    reported = information(split)
    names = [f"run_{number}.mcap" for number in range(12)]
    assert reported["relative_file_paths"] == names
    assert {file.name for file in split.iterdir()} == {*names, "metadata.yaml"}
    # As rosbag2 does: the first message that is later than that is the next file's first one.
    parts: list[list[Sent]] = [[]]
    for message in messages:
        if parts[-1] and message.time_ns - parts[-1][0].time_ns > FILE_S * 1e9:
            parts.append([])
        parts[-1].append(message)
    expected = [
        {
            "path": name,
            "starting_time": {"nanoseconds_since_epoch": part[0].time_ns},
            "duration": {"nanoseconds": part[-1].time_ns - part[0].time_ns},
            "message_count": len(part),
        }
        for name, part in zip(names, parts, strict=True)
    ]
    assert reported["files"] == expected
    assert reported["message_count"] == len(messages)
    assert reported["starting_time"] == {"nanoseconds_since_epoch": messages[0].time_ns}
    assert reported["duration"] == {"nanoseconds": messages[-1].time_ns - messages[0].time_ns}


def test_split___each_file___is_a_whole_one_with_all_topics(split: Path) -> None:
    for number, name in enumerate(information(split)["relative_file_paths"]):  # type: ignore[arg-type,var-annotated]
        with (split / name).open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            summary = reader.get_summary()
            (note,) = reader.iter_metadata()
        assert summary is not None
        assert {channel.topic for channel in summary.channels.values()} == {
            "/flexarm/state",
            "/flexarm/command",
            "/flexarm/reference",
        }
        reported = yaml.safe_load(note.metadata["serialized_metadata"])
        assert reported["files"] == information(split)["files"][: number + 1]  # type: ignore[index]


def test_split___by_size___begins_a_file_after_a_flush_beyond_it(
    tmp_path: Path, messages: list[Sent]
) -> None:
    path = tmp_path / "run"
    with BagWriter(
        path, recorded_topics(messages), flush_period_s=0.05, max_file_bytes=8000
    ) as bag:
        for message in messages:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
    *full, _ = sorted(path.glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns)
    assert len(full) >= 2
    assert all(file.stat().st_size >= 8000 for file in full)
    assert content(path) == content(write_bag(tmp_path / "one", messages))


@pytest.mark.slow
def test_readers___of_a_split_bag___find_every_message_once(
    split: Path, tmp_path: Path, messages: list[Sent]
) -> None:
    one = write_bag(tmp_path / "one", messages)
    assert content(split) == content(one)
    checked = check_bag(split)
    assert (checked.messages, checked.problems, checked.notes) == (len(messages), (), ())
    played = [(due.topic, due.raw) for due in PlaybackPlan(split).messages()]
    assert played == [(message.topic, message.raw) for message in messages[: len(played)]]
    assert len(played) >= len(messages) - 1
    with opened(split) as bag:
        assert bag.count("/flexarm/state") == SAMPLES
        assert bag.recorded("/flexarm/state").integer("sequence").tolist() == list(
            range(1, SAMPLES + 1)
        )
    assert read_bag(split).u.tolist() == read_bag(one).u.tolist()


def test_repair___of_a_split_bag_with_a_cut_file___copies_the_rest_in_order(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = split_bag(tmp_path / "run", messages)
    last = bag / "run_11.mcap"
    last.write_bytes(last.read_bytes()[:-200])
    (bag / "metadata.yaml").unlink()
    summary = repair_bag(bag, tmp_path / "whole")
    assert any("run_11.mcap" in line for line in summary.damage)
    with AnyReader([summary.bag]) as reader:
        times_ns = [time_ns for _, time_ns, _ in reader.messages()]
    with (tmp_path / "whole" / "whole_0.mcap").open("rb") as stream:
        written = [
            record.log_time
            for _, _, record in make_reader(stream).iter_messages(log_time_order=False)
        ]
    # As they stand in the file: the tenth file follows the ninth.
    assert written == times_ns == [message.time_ns for message in messages[: len(written)]]


def test_check___of_a_split_bag___compares_each_file_with_the_metadata(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = split_bag(tmp_path / "run", messages)
    reported = yaml.safe_load((bag / "metadata.yaml").read_text("utf-8"))
    reported["rosbag2_bagfile_information"]["files"][3]["message_count"] += 1
    (bag / "metadata.yaml").write_text(yaml.safe_dump(reported), "utf-8")
    assert "metadata.yaml: differs from its copy inside the file" in check_bag(bag).problems


def test_file___that_is_ended___is_followed_by_another_one_and_no_loss_is_reported(
    tmp_path: Path, messages: list[Sent]
) -> None:
    bag = BagWriter(tmp_path / "run", recorded_topics(messages))
    parts = (messages[:50], messages[400:450])
    for part in parts:
        for message in part:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
        bag.end_file()
        bag.end_file()
        with AnyReader([tmp_path / "run"]) as reader:
            assert reader.message_count == bag.message_count
    bag.flush_if_due()
    bag.close()
    assert [entry["message_count"] for entry in information(bag.path)["files"]] == [50, 50]  # type: ignore[attr-defined]
    assert bag.sequences.complaints() == []


def test_next_file___that_cannot_be_created___leaves_the_files_before_it_whole(
    tmp_path: Path, messages: list[Sent]
) -> None:
    def blocked() -> None:
        with BagWriter(tmp_path / "run", recorded_topics(messages), max_file_s=FILE_S) as bag:
            (tmp_path / "run" / "run_1.mcap").touch()
            for message in messages:
                bag.write(message.topic, message.raw, message.time_ns, message.time_ns)

    with pytest.raises(RecordingError, match="cannot write: File exists; the first 102 messages"):
        blocked()
    with AnyReader([tmp_path / "run"]) as reader:
        assert reader.message_count == 102


def test_repair___of_a_bag___keeps_what_the_publishers_offered(
    tmp_path: Path, messages: list[Sent]
) -> None:
    qos = TopicQos(reliability="best_effort", durability="transient_local", depth=1)
    (topic,) = recorded_topics(messages[:1])
    with BagWriter(tmp_path / "run", [RecordedTopic(topic.name, topic.definition, qos)]) as bag:
        bag.write(topic.name, messages[0].raw, START_NS, START_NS + STEP_NS)
    repaired = repair_bag(tmp_path / "run", tmp_path / "copy").bag
    assert (
        information(repaired)["topics_with_message_count"]
        == (information(tmp_path / "run")["topics_with_message_count"])
    )
