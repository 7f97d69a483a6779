from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
import yaml
from mcap.reader import make_reader
from mcap.records import Chunk, DataEnd
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability, QosReliability

from flexarm_bags.metadata import NO_START_NS, RecordedTopic, TopicQos
from flexarm_bags.schema import DefinitionError, describe, load_typestore
from flexarm_bags.writer import BagWriter, RecordingError
from support.bag_samples import (
    MESSAGE_PACKAGES,
    START_NS,
    STEP_NS,
    Sent,
    experiment,
    information,
    mcap_file,
    recorded_topics,
    reference,
    typestore,
    write_bag,
)

if TYPE_CHECKING:
    from pathlib import Path

# Published by ROS 2 Jazzy with its own std_msgs (share/std_msgs/msg/Header.json).
HEADER_HASH = "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01"


def test_definition___header___has_the_hash_that_ros_publishes() -> None:
    assert describe(typestore(), "std_msgs/msg/Header").type_hash == HEADER_HASH


def test_definition___nested_type___holds_every_type_that_is_needed() -> None:
    text = describe(typestore(), "flexarm_msgs/msg/ArmState").text

    own, *nested = text.split("=" * 80 + "\n")

    assert "float64 middle_strain_v" in own
    assert [part.splitlines()[0] for part in nested] == [
        "MSG: std_msgs/Header",
        "MSG: builtin_interfaces/Time",
    ]


def test_definition___unknown_type___names_it() -> None:
    with pytest.raises(DefinitionError, match="nowhere_msgs/msg/Nothing is unknown"):
        describe(typestore(), "nowhere_msgs/msg/Nothing")


def test_definition___folder_without_messages___names_the_folder(tmp_path: Path) -> None:
    with pytest.raises(DefinitionError, match=f"{tmp_path}/msg: no .msg file of package some_msgs"):
        load_typestore({"some_msgs": tmp_path})


def test_definition___broken_file___names_the_file(tmp_path: Path) -> None:
    (tmp_path / "msg").mkdir()
    (tmp_path / "msg" / "Bad.msg").write_text("float64 = = nothing\n")

    with pytest.raises(DefinitionError, match=r"Bad\.msg: no message definition"):
        load_typestore({**MESSAGE_PACKAGES, "some_msgs": tmp_path})


def test_bag___read_by_rosbags___gives_back_every_message(tmp_path: Path) -> None:
    messages = experiment(50)
    bag = write_bag(tmp_path / "run", messages)

    with AnyReader([bag]) as reader:
        found = [
            Sent(connection.topic, connection.msgtype, time_ns, bytes(raw))
            for connection, time_ns, raw in reader.messages()
        ]
        last = reader.deserialize(messages[-2].raw, "flexarm_msgs/msg/ArmState")

    assert sorted(found) == sorted(messages)
    assert getattr(last, "position_v") == pytest.approx(4.9)  # noqa: B009 - generated type


def test_bag___read_by_mcap___embeds_definitions_and_checksums(tmp_path: Path) -> None:
    messages = experiment(50)
    bag = write_bag(tmp_path / "run", messages)

    with mcap_file(bag).open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = list(reader.iter_messages(log_time_order=False))
        header = reader.get_header()
        (note,) = reader.iter_metadata()
    with mcap_file(bag).open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True).records
        chunks = [record for record in records if isinstance(record, Chunk)]

    assert header.profile == "ros2"
    assert [(channel.topic, record.data) for _, channel, record in found] == [
        (message.topic, message.raw) for message in messages
    ]
    assert all(record.log_time == record.publish_time for _, _, record in found)
    for schema, channel, _ in found:
        assert schema is not None
        assert schema.encoding == "ros2msg"
        assert channel.message_encoding == "cdr"
        definition = describe(typestore(), schema.name)
        assert schema.data.decode() == definition.text
        assert channel.metadata["topic_type_hash"] == definition.type_hash
    assert all(chunk.compression == "zstd" and chunk.uncompressed_crc for chunk in chunks)
    assert yaml.safe_load(note.metadata["serialized_metadata"]) == information(bag)


def test_metadata___after_close___counts_and_times_are_those_of_the_messages(
    tmp_path: Path,
) -> None:
    bag = write_bag(tmp_path / "run", experiment(50))
    found = information(bag)

    assert (found["version"], found["storage_identifier"]) == (9, "mcap")
    assert found["relative_file_paths"] == [mcap_file(bag).name]
    assert found["message_count"] == 101
    assert found["starting_time"] == {"nanoseconds_since_epoch": START_NS}
    assert found["duration"] == {"nanoseconds": 49 * STEP_NS + 400_000}
    assert found["ros_distro"] == "jazzy"
    topics = found["topics_with_message_count"]
    assert isinstance(topics, list)
    assert {topic["topic_metadata"]["name"]: topic["message_count"] for topic in topics} == {
        "/flexarm/reference": 1,
        "/flexarm/state": 50,
        "/flexarm/command": 50,
    }
    assert "&id" not in (bag / "metadata.yaml").read_text()


def test_metadata___offered_qos___comes_back(tmp_path: Path) -> None:
    definition = describe(typestore(), "std_msgs/msg/Float64")
    qos = TopicQos(reliability="best_effort", durability="transient_local", depth=1)
    with BagWriter(tmp_path / "run", [RecordedTopic("/r", definition, qos)]) as bag:
        bag.write("/r", reference(1, 2.0).raw, 1, 1)

    with AnyReader([tmp_path / "run"]) as reader:
        (connection,) = reader.connections
        assert connection.digest == definition.type_hash
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        (found,) = connection.ext.offered_qos_profiles
        # The messages are found only when folder and file agree on the QoS.
        assert len(list(reader.messages([connection]))) == 1

    assert found.reliability is QosReliability.BEST_EFFORT
    assert found.durability is QosDurability.TRANSIENT_LOCAL
    assert found.depth == 1


def test_metadata___while_recording___is_there_already(tmp_path: Path) -> None:
    messages = experiment(3)
    with BagWriter(tmp_path / "run", recorded_topics(messages)) as bag:
        bag.write(messages[0].topic, messages[0].raw, START_NS, START_NS)
        found = information(tmp_path / "run")

    assert found["message_count"] == 0
    assert found["starting_time"] == {"nanoseconds_since_epoch": NO_START_NS}
    assert len(found["topics_with_message_count"]) == 3  # type: ignore[arg-type]


def test_bag___without_messages___is_a_valid_empty_bag(tmp_path: Path) -> None:
    BagWriter(tmp_path / "run", recorded_topics(experiment(1))).close()

    with AnyReader([tmp_path / "run"]) as reader:
        assert reader.message_count == 0
        assert len(reader.connections) == 3


@pytest.mark.parametrize("kind", ["folder", "file", "finished bag"])
def test_writer___existing_path___is_never_touched(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "run"
    if kind == "folder":
        path.mkdir()
    elif kind == "file":
        path.write_text("precious")
    else:
        write_bag(path, experiment(2))
    before = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}

    with pytest.raises(RecordingError, match=f"{path}: exists already and is not overwritten"):
        BagWriter(path, recorded_topics(experiment(1)))

    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == before


def test_writer___folder_in_another_bag___is_refused(tmp_path: Path) -> None:
    outer = tmp_path / "outer"
    write_bag(outer, experiment(2))

    with pytest.raises(RecordingError, match=f"run: {outer} is a bag: choose a name outside"):
        BagWriter(outer / "run", recorded_topics(experiment(1)))

    assert not any(each.is_dir() for each in outer.iterdir())


def test_writer___folder_below_a_file___says_why(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")

    with pytest.raises(RecordingError, match=r"file/run: cannot create: Not a directory"):
        BagWriter(tmp_path / "file" / "run", recorded_topics(experiment(1)))


def test_writer___topic_named_twice___is_refused_before_anything_is_created(
    tmp_path: Path,
) -> None:
    (topic, *_) = recorded_topics(experiment(1))

    with pytest.raises(RecordingError, match="a topic is to be recorded twice"):
        BagWriter(tmp_path / "run", [topic, topic])

    assert not (tmp_path / "run").exists()


def test_write___unknown_topic___names_it(tmp_path: Path) -> None:
    with (
        BagWriter(tmp_path / "run", recorded_topics(experiment(1))) as bag,
        pytest.raises(RecordingError, match="/elsewhere is none of the recorded topics"),
    ):
        bag.write("/elsewhere", b"", 0, 0)


@pytest.mark.parametrize("times_ns", [(-1, 0), (0, -1), (2**63, 0)])
def test_write___impossible_time___is_refused_and_the_bag_stays_whole(
    tmp_path: Path, times_ns: tuple[int, int]
) -> None:
    message = reference(START_NS, 1.0)
    with BagWriter(tmp_path / "run", recorded_topics([message])) as bag:
        with pytest.raises(RecordingError, match="is not a time since the epoch"):
            bag.write(message.topic, message.raw, *times_ns)
        bag.write(message.topic, message.raw, START_NS, START_NS)

    with AnyReader([tmp_path / "run"]) as reader:
        assert [time_ns for _, time_ns, _ in reader.messages()] == [START_NS]


def test_write___after_close___is_refused(tmp_path: Path) -> None:
    message = reference(START_NS, 1.0)
    bag = BagWriter(tmp_path / "run", recorded_topics([message]))
    bag.close()
    bag.close()

    with pytest.raises(RecordingError, match="run: is closed"):
        bag.write(message.topic, message.raw, 0, 0)


def test_write___error_in_the_block___still_closes_the_bag(tmp_path: Path) -> None:
    messages = experiment(5)

    def record_and_fail() -> None:
        with BagWriter(tmp_path / "run", recorded_topics(messages)) as bag:
            for message in messages:
                bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        record_and_fail()

    with AnyReader([tmp_path / "run"]) as reader:
        assert reader.message_count == len(messages)


def test_bag___closed___has_a_checksum_over_everything(tmp_path: Path) -> None:
    file = mcap_file(write_bag(tmp_path / "run", experiment(10)))
    with file.open("rb") as stream:
        records = list(StreamReader(stream, validate_crcs=True).records)
    (end,) = [record for record in records if isinstance(record, DataEnd)]
    assert end.data_section_crc


def test_sequences___of_a_bag_with_a_gap___complain(tmp_path: Path) -> None:
    messages = [message for k, message in enumerate(experiment(10)) if k not in {7, 8, 11}]
    with BagWriter(tmp_path / "run", recorded_topics(messages)) as bag:
        for message in messages:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
        assert bag.sequences.complaints() == [
            "/flexarm/state: 2 periods without a sample at 2 places",
            "/flexarm/command: 1 command missing at 1 place",
        ]
