from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_bags.writer import BagWriter
from flexarm_core.errors import BagError, IdentificationError
from flexarm_ident.reading.read import read_bag, stream_bag
from support.bag_samples import (
    START_NS,
    STEP_NS,
    arm_state,
    channel_info,
    io_sample,
    mcap_file,
    open_loop,
    recorded_topics,
    reference,
    write_bag,
)
from support.exhaustive import wide

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flexarm_ident import IoData


def test_read___two_rigs_in_one_bag___wants_a_choice(tmp_path: Path) -> None:
    first = open_loop([1, 2, 3])
    second = [entry._replace(topic="/other/state") for entry in open_loop([11, 12, 13])]
    bag = write_bag(tmp_path / "run", [*first, *second])

    with pytest.raises(BagError, match="choose one topic of /flexarm/state, /other/state"):
        read_bag(bag)
    assert read_bag(bag, topic="/other/state").u.tolist() == [[112.0], [113.0]]


def test_read___chosen_topic_without_samples___lists_the_topics(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", [*open_loop([1, 2, 3]), reference(START_NS, 1.0)])

    with pytest.raises(BagError, match=r"run: /flexarm/reference has no samples; topics: /fl"):
        read_bag(bag, topic="/flexarm/reference")


def test_read___bag_of_something_else___lists_its_topics(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run", [reference(START_NS, 1.0)])

    with pytest.raises(
        BagError, match=r"run: holds neither .* topics: /flexarm/reference \(std_msgs/msg/Float64\)"
    ):
        read_bag(bag)


def no_folder(path: Path) -> Path:
    return path / "nothing"


def empty_folder(path: Path) -> Path:
    return path


def metadata_only(path: Path) -> Path:
    bag = write_bag(path / "run", open_loop([1, 2, 3]))
    mcap_file(bag).unlink()
    return bag


def garbage_metadata(path: Path) -> Path:
    bag = write_bag(path / "run", open_loop([1, 2, 3]))
    (bag / "metadata.yaml").write_bytes(bytes(range(256)))
    return bag


def foreign_metadata(path: Path) -> Path:
    bag = write_bag(path / "run", open_loop([1, 2, 3]))
    (bag / "metadata.yaml").write_text("- a list\n")
    return bag


def text_file(path: Path) -> Path:
    (path / "notes.txt").write_text("no bag")
    return path / "notes.txt"


def garbage_file(path: Path) -> Path:
    (path / "run.mcap").write_bytes(bytes(range(256)) * 20)
    return path / "run.mcap"


def empty_file(path: Path) -> Path:
    (path / "run.mcap").write_bytes(b"")
    return path / "run.mcap"


def garbage_database(path: Path) -> Path:
    (path / "run.db3").write_bytes(b"SQLite format 3\0" + bytes(range(256)) * 20)
    return path / "run.db3"


def cut_bag(path: Path) -> Path:
    bag = write_bag(path / "run", open_loop(range(1, 100)))
    content = mcap_file(bag).read_bytes()
    mcap_file(bag).write_bytes(content[: len(content) // 2])
    return bag


def no_messages(path: Path) -> Path:
    BagWriter(path / "run", recorded_topics(open_loop([1]))).close()
    return path / "run"


def two_samples(path: Path) -> Path:
    return write_bag(path / "run", open_loop([1, 2]))


def lonely_io_sample(path: Path) -> Path:
    return write_bag(path / "run", [io_sample(1, START_NS, [1.0], [1.0])])


def inf_in_output(path: Path) -> Path:
    states = open_loop([1, 2, 3, 4])
    states[1] = arm_state(2, states[1].time_ns, (0.0, 0.0, float("inf"), 0.0))
    return write_bag(path / "run", states)


def ragged_io(path: Path) -> Path:
    samples = [io_sample(k, START_NS + k * STEP_NS, [1.0], [1.0] * k) for k in (1, 2)]
    return write_bag(path / "run", samples)


def misnamed_io(path: Path) -> Path:
    samples = [io_sample(k, START_NS + k * STEP_NS, [1.0], [1.0]) for k in (1, 2)]
    return write_bag(path / "run", [channel_info(START_NS, ["a"], ["q", "r"], 500.0), *samples])


def stopped_clock(path: Path) -> Path:
    return write_bag(path / "run", [arm_state(k, START_NS) for k in (1, 2, 3)])


def short_message(path: Path) -> Path:
    states = open_loop([1, 2, 3])
    states[1] = states[1]._replace(raw=states[1].raw[:-20])
    return write_bag(path / "run", states)


def big_endian(path: Path) -> Path:
    states = [state._replace(raw=b"\0\0" + state.raw[2:]) for state in open_loop([1, 2, 3])]
    return write_bag(path / "run", states)


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (no_folder, "no such bag"),
        (empty_folder, "no bag: the folder has no metadata.yaml"),
        (metadata_only, "truncated or damaged: Some database files are missing"),
        (garbage_metadata, "run: metadata.yaml: cannot be read: "),
        (foreign_metadata, "run: metadata.yaml: cannot be read: "),
        (text_file, "no bag: expected a rosbag2 folder or a .mcap or .db3 file"),
        (garbage_file, "truncated or damaged: File magic is invalid"),
        (empty_file, "seems to be empty"),
        (garbage_database, "truncated or damaged: "),
        (cut_bag, "File end magic is invalid; end the record if it still runs, else try"),
        (no_messages, "no messages on /flexarm/state"),
        (two_samples, "only 2 samples follow each other"),
        (lonely_io_sample, "only 1 samples follow each other"),
        (inf_in_output, "middle_strain_v is inf in row 1"),
        (ragged_io, "/flexarm/io: member outputs has 1 values in message 0 and 2 in message 1"),
        (misnamed_io, "y has 1 channel, but 2 names"),
        (stopped_clock, "the stamps do not advance"),
        (short_message, "/flexarm/state: a message of 64 bytes is too short"),
        (big_endian, "/flexarm/state: a message is not little-endian CDR"),
    ],
)
def test_read___unusable_bag___is_one_line_that_names_it(
    tmp_path: Path, make: Callable[[Path], Path], complaint: str
) -> None:
    path = make(tmp_path)

    with pytest.raises(BagError) as caught:
        read_bag(path)

    assert isinstance(caught.value, IdentificationError)
    assert str(caught.value).startswith(str(path))
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("make", [short_message, big_endian])
def test_read___bytes_that_do_not_fit___have_one_text_as_a_whole_and_in_pieces(
    tmp_path: Path, make: Callable[[Path], Path]
) -> None:
    path = make(tmp_path)

    with pytest.raises(BagError) as whole:
        read_bag(path)
    with pytest.raises(BagError) as in_pieces:
        stream_bag(path)

    assert str(in_pieces.value) == str(whole.value)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes, IoData]:
    """Return a bag, the content of its file and what is read from it."""
    bag = write_bag(tmp_path_factory.mktemp("bag") / "run", open_loop(range(1, 40)))
    return bag, mcap_file(bag).read_bytes(), read_bag(bag)


@pytest.mark.slow
@settings(max_examples=wide(75, 150))
@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_read___one_flipped_bit___never_changes_a_value_unnoticed(
    whole: tuple[Path, bytes, IoData], place: float, bit: int
) -> None:
    bag, raw, good = whole
    content = bytearray(raw)
    content[int(place * len(content))] ^= 1 << bit
    mcap_file(bag).write_bytes(content)

    try:
        data = read_bag(bag)
    except BagError:
        return

    np.testing.assert_array_equal(data.u, good.u)
    np.testing.assert_array_equal(data.y, good.y)
    assert data.dt_s == good.dt_s
