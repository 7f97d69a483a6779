from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2, QosDurability

from flexarm_bags.metadata import TopicQos
from flexarm_bags.repair import repair_bag
from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_core.bounds import READ_VARIABLE
from support.bag_samples import (
    START_NS,
    Sent,
    channel_info,
    recorded_topics,
    reference,
    write_bag,
)
from support.damaged_bags import CHUNK, Recording, content, content_of_file, damaged_copy
from support.exhaustive import first_of, wide

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return Recording(tmp_path_factory.mktemp("recording") / "run")


def repaired(damaged: Path, copy: Path) -> tuple[list[Sent], list[str]]:
    """Return what a repair saves, and the damage it met."""
    try:
        summary = repair_bag(damaged, copy)
    except RecordingError as error:
        assert not copy.exists()
        return [], [str(error)]
    found = content_of_file(copy)
    loss = [f"lost: {summary.lost}"] if summary.lost else []
    return found, [*summary.damage, *loss]


def test_undamaged_bag___copy_is_identical(recording: Recording, tmp_path: Path) -> None:
    summary = repair_bag(recording.bag, tmp_path / "copy")

    assert summary.bag == tmp_path / "copy"
    assert (summary.messages, summary.lost, summary.damage) == (len(recording.messages), 0, ())
    assert content(summary.bag) == content(recording.bag) == recording.messages


def test_single_file___is_repaired_like_its_folder(recording: Recording, tmp_path: Path) -> None:
    repair_bag(recording.file, tmp_path / "copy")
    assert content(tmp_path / "copy") == recording.messages


def test_copy___keeps_definitions_and_durability(tmp_path: Path) -> None:
    info = channel_info(START_NS, ["current"], ["angle"], 500.0)
    topic = recorded_topics([info])[0]
    with BagWriter(
        tmp_path / "run",
        [type(topic)(topic.name, topic.definition, TopicQos(durability="transient_local"))],
    ) as bag:
        bag.write(info.topic, info.raw, info.time_ns, info.time_ns)

    repair_bag(tmp_path / "run", tmp_path / "copy")

    with AnyReader([tmp_path / "copy"]) as reader:
        (connection,) = reader.connections
        assert connection.digest == topic.definition.type_hash
        assert connection.msgdef.data.strip() == topic.definition.text.strip()
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        (profile,) = connection.ext.offered_qos_profiles
        assert profile.durability is QosDurability.TRANSIENT_LOCAL


@settings(max_examples=wide(30, 60))
@given(st.data())
def test_file_cut_anywhere___every_whole_chunk_is_saved(
    tmp_path_factory: pytest.TempPathFactory, recording: Recording, data: st.DataObject
) -> None:
    raw = recording.file.read_bytes()
    size = data.draw(st.integers(0, len(raw) - 1))
    folder = tmp_path_factory.mktemp("cut")
    damaged = damaged_copy(recording, folder / "run", raw[:size])
    whole = recording.whole_at(size)

    if whole == 0:
        with pytest.raises(RecordingError, match="run: has no whole message"):
            repair_bag(damaged, folder / "copy")
        assert not (folder / "copy").exists()
    else:
        summary = repair_bag(damaged, folder / "copy")
        assert summary.messages == whole
        # The metadata beside the file tells how many there were.
        assert summary.lost == len(recording.messages) - whole
        assert summary.damage
        assert not any("\n" in line for line in summary.damage)
        assert content_of_file(folder / "copy") == recording.messages[:whole]


@pytest.mark.slow
@pytest.mark.parametrize("indexed", first_of([True, False]))
@settings(max_examples=wide(30, 60))
@given(data=st.data())
def test_one_wrong_byte_in_a_chunk___costs_the_messages_of_that_chunk(
    tmp_path_factory: pytest.TempPathFactory,
    recording: Recording,
    data: st.DataObject,
    *,
    indexed: bool,
) -> None:
    raw = bytearray(recording.file.read_bytes())
    start, end = data.draw(st.sampled_from(recording.chunks[1:]))
    # The content: behind times, size, checksum and name of the compression.
    position = data.draw(st.integers(start + 9 + 28 + 4 + len("zstd") + 8, end - 1))
    raw[position] ^= data.draw(st.integers(1, 255))
    folder = tmp_path_factory.mktemp("flip")
    damaged = damaged_copy(recording, folder / "run", bytes(raw if indexed else raw[:-1]))

    saved, damage = repaired(damaged, folder / "copy")

    first = recording.whole_at(start)
    # Rarely the wrong byte does not matter: a bit of the compression that nobody reads.
    is_damaged = any("chunk is damaged" in line for line in damage)
    lost = len(recording.messages[first:][:CHUNK]) if is_damaged else 0
    assert saved == [*recording.messages[:first], *recording.messages[first + lost :]]
    assert f"lost: {lost}" in damage or not lost


@pytest.mark.slow
@settings(max_examples=wide(50, 100))
@given(st.data())
def test_one_wrong_byte_anywhere___no_message_is_changed(
    tmp_path_factory: pytest.TempPathFactory, recording: Recording, data: st.DataObject
) -> None:
    raw = bytearray(recording.file.read_bytes())
    position = data.draw(st.integers(0, len(raw) - 1))
    raw[position] ^= data.draw(st.integers(1, 255))
    folder = tmp_path_factory.mktemp("flip")
    damaged = damaged_copy(recording, folder / "run", bytes(raw))

    saved, damage = repaired(damaged, folder / "copy")

    in_order = iter(recording.messages)
    assert all(message in in_order for message in saved)
    assert len(saved) == len(recording.messages) or damage
    assert len(saved) >= len(recording.messages) - CHUNK


@pytest.mark.slow
@settings(max_examples=wide(50, 100))
@given(st.data())
def test_cut_and_wrong_bits___every_whole_chunk_is_saved_and_nothing_is_changed(
    tmp_path_factory: pytest.TempPathFactory, recording: Recording, data: st.DataObject
) -> None:
    raw = bytearray(recording.file.read_bytes())
    size = data.draw(st.just(len(raw)) | st.integers(0, len(raw)))
    wrong = data.draw(st.sets(st.integers(0, 8 * len(raw) - 1), max_size=6))
    for bit in wrong:
        raw[bit // 8] ^= 1 << bit % 8
    folder = tmp_path_factory.mktemp("bits")
    damaged = damaged_copy(recording, folder / "run", bytes(raw[:size]))

    def is_whole(start: int, end: int) -> bool:
        return end <= size and not any(start <= bit // 8 < end for bit in wrong)

    saved, damage = repaired(damaged, folder / "copy")

    in_order = iter(recording.messages)
    assert all(message in in_order for message in saved)
    assert len(saved) == len(recording.messages) or damage
    # The definitions are in the first chunk, and again in the summary.
    if is_whole(*recording.chunks[0]) or is_whole(recording.summary_at, len(raw)):
        for number, chunk in enumerate(recording.chunks):
            if is_whole(*chunk):
                assert all(each in saved for each in recording.messages[number * CHUNK :][:CHUNK])


def test_wrong_lengths_without_an_index___cost_their_chunk_only(
    recording: Recording, tmp_path: Path
) -> None:
    raw = bytearray(recording.file.read_bytes()[:-1])
    for start in (recording.chunks[1][0], recording.chunks[3][1]):
        # Of a chunk, and of the index of messages behind another one.
        raw[start + 4] ^= 0x40
    summary = repair_bag(damaged_copy(recording, tmp_path / "run", bytes(raw)), tmp_path / "copy")
    assert content(summary.bag) == [*recording.messages[:CHUNK], *recording.messages[2 * CHUNK :]]


def test_chunk_of_another_kind___is_missed(recording: Recording, tmp_path: Path) -> None:
    raw = bytearray(recording.file.read_bytes())
    raw[recording.chunks[1][0]] = 0x7F
    damaged = damaged_copy(recording, tmp_path / "run", bytes(raw))
    summary = repair_bag(damaged, tmp_path / "copy")
    assert (summary.messages, summary.lost) == (105, 16)
    assert summary.damage == (
        f"{recording.file.name}: a chunk is damaged: its kind is overwritten",
    )
    assert content(tmp_path / "copy") == [*recording.messages[:16], *recording.messages[32:]]


def test_damaged_index___costs_no_message(recording: Recording, tmp_path: Path) -> None:
    raw = bytearray(recording.file.read_bytes())
    raw[-20] ^= 0xFF
    summary = repair_bag(damaged_copy(recording, tmp_path / "run", bytes(raw)), tmp_path / "copy")
    assert content(summary.bag) == recording.messages


def test_definitions_in_a_damaged_chunk___are_those_of_the_index(
    recording: Recording, tmp_path: Path
) -> None:
    raw = bytearray(recording.file.read_bytes())
    raw[recording.chunks[0][1] - 3] ^= 0xFF
    summary = repair_bag(damaged_copy(recording, tmp_path / "run", bytes(raw)), tmp_path / "copy")
    assert content(summary.bag) == recording.messages[CHUNK:]


def test_definitions_in_a_damaged_chunk_without_an_index___are_those_at_the_end(
    recording: Recording, tmp_path: Path
) -> None:
    raw = bytearray(recording.file.read_bytes()[:-1])
    # A letter of a definition in the first chunk.
    raw[recording.chunks[0][0] + 100] ^= 0xFF
    summary = repair_bag(damaged_copy(recording, tmp_path / "run", bytes(raw)), tmp_path / "copy")
    assert content(summary.bag) == recording.messages[CHUNK:]
    assert summary.lost == CHUNK


def test_split_bag___damage_in_one_file_spares_the_other(
    recording: Recording, tmp_path: Path
) -> None:
    raw = recording.file.read_bytes()
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "run_0.mcap").write_bytes(raw[: recording.chunks[0][1] + 30])
    (folder / "run_1.mcap").write_bytes(raw)

    summary = repair_bag(folder, tmp_path / "copy")

    assert summary.messages == CHUNK + len(recording.messages)
    assert all(line.startswith("run_0.mcap: ") for line in summary.damage)
    # One file has no statistics, and there is no metadata.
    assert summary.lost is None


def test_bag_without_messages___has_nothing_to_repair(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "run", recorded_topics([reference(START_NS, 0.0)])):
        pass
    with pytest.raises(RecordingError, match="run: has no whole message"):
        repair_bag(tmp_path / "run", tmp_path / "copy")


def test_text_in_place_of_a_bag___has_nothing_to_repair(tmp_path: Path) -> None:
    file = tmp_path / "notes.mcap"
    file.write_text("no bag at all, but long enough to be one")
    with pytest.raises(RecordingError, match=r"notes\.mcap: has no whole message"):
        repair_bag(file, tmp_path / "copy")


def test_folder_without_mcap_file___says_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no \.mcap file in there"):
        repair_bag(tmp_path, tmp_path / "copy")


def test_same_damage_in_several_chunks___is_reported_once(
    recording: Recording, tmp_path: Path
) -> None:
    raw = bytearray(recording.file.read_bytes())
    for start, _ in recording.chunks[1:4]:
        raw[start] = 0x7F
    summary = repair_bag(damaged_copy(recording, tmp_path / "run", bytes(raw)), tmp_path / "copy")
    assert summary.lost == 3 * CHUNK
    (line,) = summary.damage
    assert line.endswith("a chunk is damaged: its kind is overwritten (3 times)")


@pytest.mark.parametrize("name", ["README.md", "run.db3"])
def test_file_of_another_kind___is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("no bag at all, but long enough to be one")
    with pytest.raises(RecordingError, match=f"{name}: no bag of MCAP files"):
        repair_bag(tmp_path / name, tmp_path / "copy")


def test_missing_bag___says_so(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="nowhere: no such bag"):
        repair_bag(tmp_path / "nowhere", tmp_path / "copy")


def test_existing_target___is_not_touched(recording: Recording, tmp_path: Path) -> None:
    write_bag(tmp_path / "copy", [reference(START_NS, 1.0)])
    with pytest.raises(RecordingError, match="copy: exists already"):
        repair_bag(recording.bag, tmp_path / "copy")
    assert len(content(tmp_path / "copy")) == 1


def test_foreign_definition___is_copied_without_our_types(tmp_path: Path) -> None:
    sent = reference(START_NS, 2.0)
    topic = recorded_topics([sent])[0]
    foreign = type(topic.definition)("lab/msg/Level", "float64 data\n", "")
    with BagWriter(tmp_path / "run", [type(topic)("/level", foreign)]) as bag:
        bag.write("/level", sent.raw, sent.time_ns, sent.time_ns)

    repair_bag(tmp_path / "run", tmp_path / "copy")

    with AnyReader([tmp_path / "copy"]) as reader:
        ((connection, _, raw),) = reader.messages()
        assert reader.deserialize(raw, connection.msgtype).data == 2.0  # type: ignore[attr-defined]


def file_of(file: Path, type_name: str, text: str, raws: list[bytes], **kinds: Any) -> Path:  # noqa: ANN401
    """Write a file with messages on /level, and behind the first one an attachment."""
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, **kinds)
        writer.start("ros2", "")
        schema = writer.register_schema(type_name, "ros2msg", text.encode())
        channel = writer.register_channel("/level", "cdr", schema)
        for number, raw in enumerate(raws):
            writer.add_message(channel, START_NS + number, raw, START_NS + number, number)
            if number == 0:
                writer.add_attachment(0, 0, "video", "", b"x" * ATTACHED)
        writer.finish()  # type: ignore[no-untyped-call]
    return file


ATTACHED = 3 << 20


@pytest.mark.parametrize(
    ("other", "saved"),
    [("int64 data\n", 1), ("float64 data  # metres\n", 2), ("float64 data\n", 2)],
)
def test_topic_with_two_definitions___has_that_of_the_first_file_and_its_messages(
    tmp_path: Path, other: str, saved: int
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    first = "float64 data\n"
    file_of(folder / "run_0.mcap", "lab/msg/Level", first, [bytes([0, 1, 0, 0, *bytes(8)])])
    file_of(folder / "run_1.mcap", "lab/msg/Level", other, [bytes([0, 1, 0, 0, *bytes(8)])])
    summary = repair_bag(folder, tmp_path / "copy")
    assert summary.messages == saved
    assert any("another definition than the first" in line for line in summary.damage) == (
        saved == 1
    )
    with AnyReader([tmp_path / "copy"]) as reader:
        (connection,) = reader.connections
        assert connection.msgdef.data.strip() == first.strip()


def test_honest_chunks___that_exceed_the_bound_together___are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raws = [bytes([0, 1, 0, 0]) + bytes([number]) * 400_000 for number in range(6)]
    file = file_of(tmp_path / "run.mcap", "lab/msg/Level", "byte[] data\n", raws, chunk_size=1)
    monkeypatch.setattr("flexarm_core.bounds._RATIO", 0)
    monkeypatch.setenv(READ_VARIABLE, "3")
    assert repair_bag(file, tmp_path / "copy").messages == 6
    monkeypatch.setenv(READ_VARIABLE, "2")
    with pytest.raises(RecordingError, match="unpacked it has more than 2 MB"):
        repair_bag(file, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_attachment___larger_than_any_record___is_passed_over_unparsed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexarm_bags.records.layout.CHUNK_BYTES", ATTACHED - 1)
    raws = [bytes([0, 1, 0, 0, *bytes(8)])] * 5
    file = file_of(tmp_path / "run.mcap", "lab/msg/Level", "float64 data\n", raws, chunk_size=1)
    # Without its end it has no index, and is walked through.
    file.write_bytes(file.read_bytes()[:-8])
    summary = repair_bag(file, tmp_path / "copy")
    assert summary.messages == 5
    assert not any("MB" in line for line in summary.damage)


def test_two_channels_of_one_topic___give_it_the_definition_of_the_first(tmp_path: Path) -> None:
    raw = bytes([0, 1, 0, 0, *bytes(8)])
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "")
        for number, text in enumerate(("float64 data\n", "int64 data\n")):
            schema = writer.register_schema("lab/msg/Level", "ros2msg", text.encode())
            channel = writer.register_channel("/level", "cdr", schema, {"by": str(number)})
            writer.add_message(channel, START_NS + number, raw, START_NS + number, number)
        writer.finish()  # type: ignore[no-untyped-call]
    assert repair_bag(tmp_path / "run.mcap", tmp_path / "copy").messages == 1
    ((sent,),) = [content_of_file(tmp_path / "copy")]
    assert sent.time_ns == START_NS
