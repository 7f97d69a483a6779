from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from flexarm_bags.check import check_bag
from flexarm_bags.playback import PlaybackPlan
from flexarm_bags.writer import BagWriter
from flexarm_core.errors import BagError
from flexarm_ident.reading.read import read_bag
from support.bag_samples import (
    FOREIGN_FORMATS,
    START_NS,
    STEP_NS,
    arm_state,
    channel_info,
    controlled_run,
    io_sample,
    mcap_file,
    motor_command,
    recorded_topics,
    reference,
    write_bag,
    write_foreign_bag,
)
from support.exhaustive import wide
from support.ros2_bags import LAYOUTS, Layout, write_ros2_bag

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

SAMPLES = 200


def problems(bag: Path) -> tuple[str, ...]:
    return check_bag(bag).problems


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a good bag in several chunks."""
    messages = controlled_run()
    path = tmp_path_factory.mktemp("whole") / "run"
    with BagWriter(path, recorded_topics(messages), flush_period_s=0.1) as bag:
        for message in messages:
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
    return path


@pytest.fixture
def copy(whole: Path, tmp_path: Path) -> Path:
    shutil.copytree(whole, tmp_path / "run")
    return tmp_path / "run"


def test_check___own_bag___is_good_and_fully_protected(whole: Path) -> None:
    found = check_bag(whole)
    assert (found.bag, found.messages) == (whole, 404)
    assert (found.problems, found.notes) == ((), ())


def test_check___single_file___needs_no_folder(whole: Path) -> None:
    assert check_bag(mcap_file(whole)).problems == ()


@pytest.mark.slow
@settings(max_examples=wide(20, 80))
@given(data=st.data())
def test_check___one_wrong_bit_in_the_file___is_noticed(whole: Path, data: st.DataObject) -> None:
    file = mcap_file(whole)
    raw = file.read_bytes()
    position = data.draw(st.integers(0, len(raw) - 1))
    changed = bytearray(raw)
    changed[position] ^= 1 << data.draw(st.integers(0, 7))
    try:
        file.write_bytes(changed)
        assert problems(whole)
    finally:
        file.write_bytes(raw)


@pytest.mark.slow
@settings(max_examples=30)
@given(data=st.data())
def test_check___one_wrong_bit_in_the_metadata___is_noticed_or_means_nothing(
    whole: Path, data: st.DataObject
) -> None:
    file = whole / "metadata.yaml"
    raw = file.read_bytes()
    changed = bytearray(raw)
    changed[data.draw(st.integers(0, len(raw) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    try:
        file.write_bytes(changed)
        if not problems(whole):
            assert yaml.safe_load(bytes(changed)) == yaml.safe_load(raw)
    finally:
        file.write_bytes(raw)


@pytest.mark.parametrize("size", [0, 5, 40, 3000, -100, -4])
def test_check___cut_file___is_noticed(copy: Path, size: int) -> None:
    file = mcap_file(copy)
    file.write_bytes(file.read_bytes()[:size])
    words = ("cut", "empty", "does not begin", "does not end")
    assert any(word in line for line in problems(copy) for word in words)


def test_check___something_behind_the_end___is_noticed(copy: Path) -> None:
    with mcap_file(copy).open("ab") as stream:
        stream.write(b"more")
    assert any("does not end as an MCAP file" in line for line in problems(copy))


def test_check___another_bag_s_metadata___is_noticed(copy: Path, tmp_path: Path) -> None:
    other = write_bag(tmp_path / "other", controlled_run(100))
    text = (other / "metadata.yaml").read_text("utf-8").replace("other_0", "run_0")
    (copy / "metadata.yaml").write_text(text, "utf-8")
    found = problems(copy)
    assert "metadata.yaml: differs from its copy inside the file" in found
    assert "/flexarm/state: metadata.yaml says 100 messages, there are 200" in found
    assert "metadata.yaml: does not have the times of the messages" in found


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda bag: (bag / "metadata.yaml").unlink(), "metadata.yaml: cannot be read"),
        (lambda bag: (bag / "metadata.yaml").write_text("- 1"), "metadata.yaml: cannot be read"),
        (lambda bag: mcap_file(bag).unlink(), "run_0.mcap: is missing"),
        (
            lambda bag: shutil.copy(mcap_file(bag), bag / "stray.mcap"),
            "stray.mcap: is not named in metadata.yaml",
        ),
    ],
)
def test_check___folder_out_of_order___says_how(
    copy: Path, change: Callable[[Path], object], line: str
) -> None:
    change(copy)
    assert any(found.startswith(line) for found in problems(copy))


def test_check___stamp_that_is_no_time___is_named(tmp_path: Path) -> None:
    state = arm_state(1, START_NS)
    raw = state.raw[:8] + (10**9).to_bytes(4, "little") + state.raw[12:]
    found = problems(write_bag(tmp_path / "run", [state._replace(raw=raw)]))
    assert "/flexarm/state: a stamp is not a time since the epoch" in found


def test_check___value_that_is_not_finite___is_named(tmp_path: Path) -> None:
    messages = [
        arm_state(k + 1, START_NS + k * STEP_NS, (0.0, 0.0, v, 0.0))
        for k, v in enumerate((0.0, float("nan"), 0.0))
    ]
    assert problems(write_bag(tmp_path / "run", messages)) == (
        "/flexarm/state: middle_strain_v is not finite in message 1",
    )


def test_check___output_that_was_not_measured___is_a_note(tmp_path: Path) -> None:
    rows = [(1.0, 2.0), (float("nan"), 2.0), (float("nan"), float("nan")), (1.0, 2.0)]
    messages = [io_sample(k + 1, START_NS + k * STEP_NS, [0.0], row) for k, row in enumerate(rows)]
    found = check_bag(write_bag(tmp_path / "run", messages))
    assert found.problems == ()
    assert found.notes == ("/flexarm/io: 3 outputs without a value (NaN): not measured",)
    for value, other, name in ((1.0, np.inf, "outputs"), (np.nan, 1.0, "inputs")):
        sample = io_sample(5, START_NS + 4 * STEP_NS, [value], [other])
        found = check_bag(write_bag(tmp_path / name, [sample]))
        assert found.problems == (f"/flexarm/io: {name} is not finite in message 0",)


def test_check___topic_of_another_type___is_named(tmp_path: Path) -> None:
    command = motor_command(1, START_NS, 1.0)._replace(topic="/flexarm/state")
    assert problems(write_bag(tmp_path / "run", [command])) == (
        "/flexarm/state: has type flexarm_msgs/msg/MotorCommand, not flexarm_msgs/msg/ArmState",
    )


def test_check___messages_that_do_not_fit_their_type___are_named(tmp_path: Path) -> None:
    state = arm_state(1, START_NS)._replace(raw=motor_command(1, START_NS, 1.0).raw)
    (found,) = problems(write_bag(tmp_path / "run", [state]))
    assert found.startswith("/flexarm/state: do not fit the definition: ")


def test_check___definition_without_its_hash___is_named(tmp_path: Path) -> None:
    sent = reference(START_NS, 1.0)
    (topic,) = recorded_topics([sent])
    wrong = replace(topic, definition=replace(topic.definition, type_hash="RIHS01_" + "0" * 64))
    with BagWriter(tmp_path / "run", [wrong]) as bag:
        bag.write(sent.topic, sent.raw, START_NS, START_NS)
    (found,) = problems(tmp_path / "run")
    assert found.startswith("cannot be opened: Message type 'std_msgs/msg/Float64' hash mismatch")


def test_check___arrays_and_strings___are_read_too(tmp_path: Path) -> None:
    info = channel_info(START_NS, ["current"], ["angle", "strain"], 500.0)
    samples = [io_sample(k + 1, START_NS + k * STEP_NS, [1.0], [2.0, 3.0]) for k in range(20)]
    good = write_bag(tmp_path / "good", [info, *samples])
    bad = write_bag(tmp_path / "bad", [info._replace(raw=info.raw[:30]), *samples])
    assert problems(good) == ()
    (found,) = problems(bad)
    assert found.startswith("/flexarm/io_channels: do not fit the definition: ")


def test_check___bag_without_messages___says_so(tmp_path: Path) -> None:
    BagWriter(tmp_path / "run", recorded_topics([reference(START_NS, 0.0)])).close()
    assert problems(tmp_path / "run") == ("has no message",)


def test_check___no_bag___is_an_error(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="nowhere: no such bag"):
        check_bag(tmp_path / "nowhere")


def test_check___recorder_that_was_killed___points_at_the_end(tmp_path: Path) -> None:
    messages = controlled_run(20)
    writer = BagWriter(tmp_path / "run", recorded_topics(messages))
    for message in messages:
        writer.write(message.topic, message.raw, message.time_ns, message.time_ns)
    writer.flush()
    found = check_bag(tmp_path / "run")
    assert any("run_0.mcap: is cut at byte" in line for line in found.problems)
    writer.close()
    assert problems(tmp_path / "run") == ()


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_ros2_bag___as_recorded___is_read_played_and_good(tmp_path: Path, layout: Layout) -> None:
    messages = controlled_run(60)
    bag = write_ros2_bag(tmp_path / "run", messages, layout)
    ours = read_bag(write_bag(tmp_path / "ours", messages))

    data, found = read_bag(bag), check_bag(bag)

    np.testing.assert_array_equal(data.y, ours.y)
    np.testing.assert_array_equal(data.u, ours.u)
    assert (data.dt_s, data.closed_loop) == (ours.dt_s, ours.closed_loop)
    played = [(m.topic, m.raw) for m in PlaybackPlan(bag).messages()]
    assert played == [(m.topic, m.raw) for m in messages]
    assert (found.messages, found.problems) == (len(messages), ())
    assert found.notes


@pytest.mark.parametrize(("storage", "compression"), FOREIGN_FORMATS)
def test_foreign_bag___whole___is_good_with_notes(
    tmp_path: Path, storage: StoragePlugin, compression: CompressionMode
) -> None:
    messages = controlled_run(60)
    found = check_bag(write_foreign_bag(tmp_path / "run", messages, storage, compression))
    assert (found.messages, found.problems) == (len(messages), ())
    assert any("checksum" in note for note in found.notes)


@pytest.mark.parametrize("layout", ["jazzy", "compressed_files"])
def test_ros2_bag___damaged_chunk___is_noticed(tmp_path: Path, layout: str) -> None:
    bag = write_ros2_bag(tmp_path / "run", controlled_run(60), LAYOUTS[layout])
    file = min(bag.glob("*.mcap*"))
    raw = bytearray(file.read_bytes())
    raw[len(raw) // 2] ^= 0x10
    file.write_bytes(raw)
    assert problems(bag)


def test_sqlite___damaged___is_noticed(tmp_path: Path) -> None:
    bag = write_foreign_bag(tmp_path / "run", controlled_run(60), StoragePlugin.SQLITE3)
    (file,) = bag.glob("*.db3")
    raw = file.read_bytes()
    file.write_bytes(raw[: len(raw) // 2])
    assert problems(bag)


def chunked_file(file: Path, change: Callable[[Writer], None]) -> Path:
    """Write a bare MCAP file of two chunks, tampered with in between."""
    sent = [reference(START_NS + k, float(k)) for k in range(4)]
    (topic,) = recorded_topics(sent)
    with file.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("ros2", "another writer")
        schema = writer.register_schema(
            topic.definition.type_name, "ros2msg", topic.definition.text.encode()
        )
        channel = writer.register_channel(topic.name, "cdr", schema)
        for message in sent:
            writer.add_message(channel, message.time_ns, message.raw, message.time_ns)
            writer.flush()  # type: ignore[no-untyped-call]
        change(writer)
        writer.finish()  # type: ignore[no-untyped-call]
    return file


def tampered(name: str, **values: object) -> Callable[[Writer], None]:
    """Return a change of what the writer will state in its summary."""

    def change(writer: Writer) -> None:
        stated = getattr(writer, f"_Writer__{name}")
        for target in stated if isinstance(stated, list) else [stated]:
            for key, value in values.items():
                setattr(target, key, value)

    return change


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (tampered("statistics", message_count=5), "messages: the statistics say 5, there are 4"),
        (tampered("statistics", chunk_count=3), "chunks: the statistics say 3, there are 4"),
        (tampered("statistics", message_start_time=7), "first time: the statistics say 7"),
        (tampered("chunk_indices", message_end_time=7), "the index of the chunk at byte"),
        (tampered("chunk_indices", message_index_offsets={}), "the index of the chunk at byte"),
        (lambda writer: writer._Writer__chunk_indices.pop(), "the numbers of chunks and of"),
    ],
)
def test_file___that_contradicts_itself___is_noticed(
    tmp_path: Path, change: Callable[[Writer], None], line: str
) -> None:
    good = chunked_file(tmp_path / "good.mcap", lambda _: None)
    bad = chunked_file(tmp_path / "bad.mcap", change)
    assert problems(good) == ()
    assert any(line in found for found in problems(bad))
