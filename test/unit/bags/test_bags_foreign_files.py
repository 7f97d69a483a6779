"""MCAP files of other programs: any order of chunks, other encodings, no metadata."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from flexarm_bags.check import check_bag
from flexarm_bags.reader import opened
from flexarm_bags.records.chunks import Messages
from flexarm_bags.repair import repair_bag
from flexarm_bags.writer import BagWriter, RecordingError
from flexarm_core.errors import BagError
from flexarm_ident.reading.fields import parse_field, values_of, wrong_topic
from support.bag_samples import (
    START_NS,
    controlled_run,
    experiment,
    mcap_file,
    recorded_topics,
    write_foreign_bag,
)
from support.damaged_bags import chunks_of
from support.foreign_bags import TYPES, float64, joint_states

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from support.foreign_bags import Topic

TOPIC = "/force"
STEP_NS = 5_000_000
ENCODINGS = [("json", "jsonschema"), ("json", ""), ("protobuf", "protobuf"), ("flatbuffer", "x")]


def write(
    file: Path,
    topic: Topic | None,
    order: Sequence[int],
    others: Sequence[tuple[str, str]] = (),
    **kinds: Any,  # noqa: ANN401 - of the writer
) -> Path:
    """Write a file of small chunks, its messages in an order, and one message of each encoding."""
    with file.open("wb") as stream:
        kinds = {"compression": CompressionType.NONE, **kinds}
        writer = Writer(stream, chunk_size=2000, **kinds)
        writer.start("ros2", "somebody's recorder")
        if topic is not None:
            text = TYPES.generate_msgdef(topic.type_name, ros_version=2)[0]
            schema = writer.register_schema(topic.type_name, "ros2msg", text.encode())
            channel = writer.register_channel(topic.name, "cdr", schema)
            for number in order:
                time_ns = int(topic.received_ns[number])
                writer.add_message(channel, time_ns, topic.raws[number], time_ns, number)
        for number, (encoding, kind) in enumerate(others):
            schema = writer.register_schema("Note", kind, b"{}") if kind else 0
            channel = writer.register_channel(f"/note{number}", encoding, schema)
            writer.add_message(channel, START_NS, json.dumps({"a": 1}).encode(), START_NS, 0)
        writer.finish()  # type: ignore[no-untyped-call]
    return file


def forces(count: int = 600) -> Topic:
    times_ns = START_NS + STEP_NS * np.arange(count)
    return float64(TOPIC, times_ns, np.arange(float(count)))


def numbers(path: Path) -> list[float]:
    with opened(path) as bag:
        found = values_of(bag.grouped(TOPIC), "data")
    assert found is not None
    return [float(value) for value in found]


@pytest.mark.parametrize("seed", range(4))
def test_chunks___in_any_order___are_read_by_their_instants(tmp_path: Path, seed: int) -> None:
    blocks = np.random.default_rng(seed).permutation(np.arange(600).reshape(6, 100))
    file = write(tmp_path / "run.mcap", forces(), blocks.ravel().tolist())
    assert numbers(file) == list(range(600))


def test_in_order___clock_that_was_set_back___stays_as_it_was_written() -> None:
    before = np.arange(100) * STEP_NS
    times_ns = np.concatenate([before, before + STEP_NS // 3])
    messages = Messages.of(times_ns.tolist(), [bytes([k]) for k in range(200)])
    assert messages.in_order() is messages
    # Two of a hundred that overtook each other are put right.
    swapped = before.copy()
    swapped[[40, 41]] = swapped[[41, 40]]
    found = Messages.of(swapped.tolist(), [bytes([k]) for k in range(100)]).in_order()
    assert [raw[0] for raw in found.raws()][39:43] == [39, 41, 40, 42]


@pytest.mark.parametrize("others", [[each] for each in ENCODINGS] + [ENCODINGS])
def test_topics___of_other_encodings___are_left_out_and_named(
    tmp_path: Path, others: list[tuple[str, str]]
) -> None:
    file = write(tmp_path / "run.mcap", forces(), range(600), others)
    assert numbers(file) == list(range(600))
    found = check_bag(file)
    assert not found.problems
    assert any(f"/note0 is {others[0][0]}, which is not read" in note for note in found.notes)


@pytest.mark.parametrize("others", [[each] for each in ENCODINGS])
def test_file___of_other_encodings_alone___is_refused_with_the_way_out(
    tmp_path: Path, others: list[tuple[str, str]]
) -> None:
    file = write(tmp_path / "run.mcap", None, (), others)
    with pytest.raises(BagError, match=rf"but /note0 \({others[0][0]}\): .* export the numbers"):
        numbers(file)
    (problem, *_) = check_bag(file).problems
    assert "damaged" not in problem


@pytest.mark.parametrize("storage", [None, ""])
def test_folder___without_metadata_or_storage___is_read_from_its_files(
    tmp_path: Path, storage: str | None
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    write(folder / "run_0.mcap", forces(), range(300))
    write(folder / "run_1.mcap", forces(), range(300, 600))
    if storage is not None:
        files = "[run_0.mcap, run_1.mcap]"
        (folder / "metadata.yaml").write_text(
            "rosbag2_bagfile_information: {version: 5, storage_identifier: '" + storage + "',\n"
            f"  relative_file_paths: {files}, duration: {{nanoseconds: 1}}, message_count: 600,\n"
            "  starting_time: {nanoseconds_since_epoch: 0}, topics_with_message_count: [],\n"
            "  compression_format: '', compression_mode: ''}\n"
        )
    assert numbers(folder) == list(range(600))
    problems = check_bag(folder).problems
    fault = "cannot be read: No such file" if storage is None else "names no storage"
    assert problems
    assert all("metadata.yaml" in each or "/force: " in each for each in problems)
    assert any(f"metadata.yaml: {fault}" in each for each in problems)
    assert numbers(folder / "run_1.mcap") == list(range(300, 600))


def test_joint_states___whose_names_change_places___are_taken_by_name(tmp_path: Path) -> None:
    times_ns = START_NS + STEP_NS * np.arange(40)
    first, second = np.arange(40.0), 100.0 + np.arange(40.0)
    names = ["shoulder", "motor"]
    values = np.stack([first, second], axis=1)
    straight = joint_states(times_ns[:20], names, values[:20])
    crossed = joint_states(times_ns[20:], names[::-1], values[20:, ::-1].copy())
    both = type(straight)(
        "/joint_states", straight.type_name, times_ns, [*straight.raws, *crossed.raws]
    )
    file = write(tmp_path / "run.mcap", both, range(40))
    with opened(file) as bag:
        messages = bag.grouped("/joint_states")
    for place, expected in enumerate((first, second)):
        np.testing.assert_allclose(values_of(messages, f"position[{place}]"), expected)  # type: ignore[arg-type]


def test_repair___message_with_a_time_beyond_the_range___keeps_the_others(tmp_path: Path) -> None:
    topic = forces(3000)
    topic.received_ns[1500] = np.int64(-1)
    file = tmp_path / "run.mcap"
    write(file, topic, range(1500))
    late = type(topic)(topic.name, topic.type_name, topic.received_ns.astype(np.uint64), topic.raws)
    write(file, late, range(3000))
    made = repair_bag(file, tmp_path / "repaired")
    assert made.messages == 2999
    assert any("time is beyond 2^63 ns" in line for line in made.damage)


def test_own_bag___in_the_order_of_writing___is_unchanged(tmp_path: Path) -> None:
    messages = experiment(50)
    with BagWriter(tmp_path / "bag", recorded_topics(messages)) as bag:
        for each in messages:
            bag.write(each.topic, each.raw, each.time_ns, each.time_ns)
    alone = tmp_path / "alone"
    alone.mkdir()
    shutil.copy(mcap_file(tmp_path / "bag"), alone)
    for path in (tmp_path / "bag", alone):
        with opened(path) as found:
            assert len(found.recorded("/flexarm/state")) == 50


@pytest.mark.parametrize(
    "kinds",
    [
        {"index_types": IndexType.NONE},
        {"index_types": IndexType.CHUNK},
        {"index_types": IndexType.MESSAGE},
        {"use_statistics": False},
        {"use_summary_offsets": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"use_chunking": False},
        {"index_types": IndexType.NONE, "use_statistics": False, "repeat_channels": False},
    ],
    ids=str,
)
def test_file___without_parts_of_its_summary___is_read_where_the_check_calls_it_good(
    tmp_path: Path, kinds: dict[str, Any]
) -> None:
    file = write(tmp_path / "run.mcap", forces(), range(600), **kinds)
    assert not check_bag(file).problems
    assert numbers(file) == list(range(600))


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("length", [0, 1, 1 << 31, 1 << 60, (1 << 64) - 1])
def test_chunk___whose_bytes_state_another_length_than_its_record___is_reported_and_read(
    tmp_path: Path, compression: CompressionType, length: int
) -> None:
    file = write(tmp_path / "run.mcap", forces(), range(600), compression=compression)
    raw = bytearray(file.read_bytes())
    start, _ = chunks_of(bytes(raw))[1]
    # The length of the packed bytes stands behind the record's own, times, sizes and a name.
    name_at = start + 9 + 8 + 8 + 8 + 4
    at = name_at + 4 + int.from_bytes(raw[name_at : name_at + 4], "little")
    raw[at : at + 8] = length.to_bytes(8, "little")
    file.write_bytes(raw)
    (problem, *_) = check_bag(file).problems
    assert f"the record at byte {start} does not have its length" in problem
    if length > len(raw):
        assert numbers(file) == list(range(600))
    else:
        with pytest.raises(BagError, match=r"damaged: (?!MemoryError)"):
            numbers(file)


@pytest.mark.parametrize("ending", [".mcap.zstd", ".mcap.zst"])
def test_file___compressed_as_a_whole_without_its_folder___is_read(
    tmp_path: Path, ending: str
) -> None:
    plain = write(tmp_path / "plain.mcap", forces(), range(600))
    folder = tmp_path / "run"
    folder.mkdir()
    packed = folder / f"run_0{ending}"
    packed.write_bytes(zstandard.compress(plain.read_bytes()))
    assert not check_bag(packed).problems
    assert numbers(packed) == numbers(folder) == list(range(600))
    with pytest.raises(RecordingError, match=r"unpack it first \(`zstd -d`\)"):
        repair_bag(packed, tmp_path / "repaired")


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("compression", [CompressionMode.NONE, CompressionMode.FILE])
def test_storage_file___alone___is_read_as_its_folder(
    tmp_path: Path, storage: StoragePlugin, compression: CompressionMode
) -> None:
    bag = write_foreign_bag(tmp_path / "run", controlled_run(50), storage, compression)
    (file,) = (each for each in bag.iterdir() if each.name != "metadata.yaml")
    assert not check_bag(file).problems
    for path in (bag, file):
        with opened(path) as found:
            assert len(found.recorded("/flexarm/state")) == 50


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_messages___compressed_without_their_metadata___are_named_with_the_way_out(
    tmp_path: Path, storage: StoragePlugin
) -> None:
    messages = controlled_run(20)
    bag = write_foreign_bag(tmp_path / "run", messages, storage, CompressionMode.MESSAGE)
    (bag / "metadata.yaml").unlink()
    for path in (bag, *bag.iterdir()):
        expected = "messages are compressed, as metadata.yaml says: read its folder"
        with opened(path) as found, pytest.raises(BagError, match=expected):
            found.recorded("/flexarm/state")


def test_topic___of_another_encoding___is_named_by_the_reader_and_by_the_repair(
    tmp_path: Path,
) -> None:
    file = write(tmp_path / "run.mcap", forces(), range(600), [("json", "jsonschema")])
    with opened(file) as bag:
        said = str(wrong_topic(bag, parse_field("/note0.a")))
    assert "/note0 is json and no topic of ROS 2: record it" in said
    (damage,) = repair_bag(file, tmp_path / "repaired").damage
    assert "a message of /note0 is json and none of ROS 2, and is left out" in damage
