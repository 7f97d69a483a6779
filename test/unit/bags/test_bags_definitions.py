from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from mcap.records import Channel, Schema
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype

from flexarm_bags.check import check_bag
from flexarm_bags.reader import opened
from flexarm_bags.records.columns import CdrError, members
from flexarm_bags.repair import Definitions, definition_hash, repair_bag
from flexarm_bags.schema import describe, load_typestore
from support.bag_samples import (
    controlled_run,
    experiment,
    mcap_file,
    open_loop,
    typestore,
    write_bag,
    write_in_chunks,
)
from support.damaged_bags import chunks_of, content
from support.hostile_bags import ARM_STATE, STATE, definition, write_defined_bag

if TYPE_CHECKING:
    from pathlib import Path

FLOAT = "std_msgs/msg/Float64"


def test_member_that_a_known_type_lacks___is_no_fault(tmp_path: Path) -> None:
    text = definition().replace("uint64 command_sequence", "uint64 command_number")
    bag = write_defined_bag(tmp_path / "run", open_loop(range(1, 100)), text)
    with opened(bag) as found:
        np.testing.assert_array_equal(
            found.recorded(STATE).real("position_v"), np.arange(1.0, 100.0)
        )


def test_states_without_a_header___are_reported(tmp_path: Path) -> None:
    text = definition().replace("std_msgs/Header header", "uint64 a\nuint64 b")
    bag = write_defined_bag(tmp_path / "run", open_loop(range(1, 10)), text)
    problems = check_bag(bag).problems
    assert (
        "/flexarm/state: flexarm_msgs/msg/ArmState is without header.stamp.sec, "
        "header.stamp.nanosec"
    ) in problems


@pytest.mark.slow
def test_types_that_double_at_each_level___are_refused() -> None:
    nested = [f"x/msg/A{k}" for k in range(40)]
    definitions: dict[str, Any] = {
        outer: ([], [(name, (Nodetype.NAME, inner)) for name in ("a", "b")])
        for outer, inner in pairwise(nested)
    }
    definitions[nested[-1]] = ([], [("v", (Nodetype.BASE, ("float64", 0)))])
    with pytest.raises(CdrError, match="has more than 10000 members"):
        members(nested[0], definitions)


def test_repeated_chunks___are_reported_and_copied_once(tmp_path: Path) -> None:
    messages = experiment(100)
    bag = write_in_chunks(tmp_path / "run", messages, 50)
    file = mcap_file(bag)
    raw = file.read_bytes()
    (start, _), (_, end) = chunks_of(raw)[0], chunks_of(raw)[2]
    file.write_bytes(raw[:end] + raw[start:end] + raw[end:])

    problems = check_bag(bag).problems
    assert sum(" again" in problem for problem in problems) == 3
    summary = repair_bag(bag, tmp_path / "copy")
    assert (summary.messages, summary.lost) == (len(messages), 0)
    assert summary.damage == (f"{file.name}: a chunk is there twice (3 times)",)
    assert content(tmp_path / "copy") == content(write_bag(tmp_path / "whole", messages))


def schema(text: str, number: int = 1, name: str = FLOAT) -> Schema:
    return Schema(data=text.encode(), encoding="ros2msg", id=number, name=name)


def channel(type_hash: str, topic: str = "/reference") -> Channel:
    return Channel(
        id=1,
        topic=topic,
        message_encoding="cdr",
        metadata={"topic_type_hash": type_hash},
        schema_id=1,
    )


def chosen(schemas: list[Schema], channels: list[Channel]) -> str | None:
    """Return the text that is taken from some copies."""
    definitions = Definitions()
    for copy in schemas:
        definitions.add_schema(copy)
    for its_channel in channels:
        definitions.add_channel(its_channel)
    topic = definitions.topic(1)
    return None if topic is None else topic.definition.text


def test_definition___with_the_stated_hash___is_taken_wherever_it_stands() -> None:
    good, wrong = schema("float64 data\n"), schema("float64 dbta\n")
    stated = definition_hash(good)
    assert stated is not None
    for copies in ([good, wrong], [wrong, good], [schema("float64 da\xff"), good], [good]):
        assert chosen(copies, [channel(stated)]) == "float64 data\n"
    assert chosen([good], [channel("RIHS01_0"), channel(stated)]) == "float64 data\n"


def test_definition___that_no_hash_proves___is_taken_when_its_copies_agree() -> None:
    good, wrong = schema("float64 data\n"), schema("float64 dbta\n")
    assert chosen([good], [channel("")]) == "float64 data\n"
    assert chosen([good, good], [channel("RIHS01_0")]) == "float64 data\n"
    assert chosen([good], [channel("RIHS01_0")]) is None
    assert chosen([good, wrong], [channel("")]) is None
    assert chosen([schema("float6 4data")], [channel("")]) is None
    assert chosen([], [channel("")]) is None


def test_wrong_byte_in_a_definition_without_a_checksum___is_mended_by_its_other_copy(
    tmp_path: Path,
) -> None:
    bag = write_bag(tmp_path / "run", controlled_run(50))
    file = mcap_file(bag)
    raw = file.read_bytes()
    # The copy in the summary; the file ends without its magic, so nothing checks the summary.
    at = raw.rindex(b"float64 position_v")
    file.write_bytes(raw[:at] + raw[at:].replace(b"position_v", b"pos tion_v", 1)[:-1])

    summary = repair_bag(bag, tmp_path / "copy")

    assert summary.messages == len(controlled_run(50))
    with AnyReader([tmp_path / "copy"]) as reader:
        assert "position_v" in dict(reader.typestore.fielddefs[ARM_STATE][1])


def file_of(folder: Path, name: str, text: str) -> None:
    package, _, short = name.partition("/")
    file = folder / package / "msg" / f"{short}.msg"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, "utf-8")


def test_described_type___has_the_files_of_all_its_types_as_rosbag2_puts_them_together(
    tmp_path: Path,
) -> None:
    time = "# since the epoch\nint32 sec  # s\nuint32 nanosec\n"
    file_of(tmp_path, "b/Time", time)
    file_of(tmp_path, "a/Pair", "# two of them\nb/Time[2] times\nb/Time last\n")
    file_of(tmp_path, "a/Top", "Pair[] pairs # µV\nb/Time now\nfloat64 value # V\n")

    def folder_of(package: str) -> Path:
        return tmp_path / package

    types = load_typestore({package: tmp_path / package for package in ("a", "b")})
    found = describe(types, "a/msg/Top", folder_of)

    rule = "=" * 80
    assert found.text == (
        "Pair[] pairs # µV\nb/Time now\nfloat64 value # V\n"
        f"\n{rule}\nMSG: a/Pair\n# two of them\nb/Time[2] times\nb/Time last\n"
        f"\n{rule}\nMSG: b/Time\n{time}"
    )
    assert (
        found.type_hash == types.hash_rihs01("a/msg/Top") == describe(types, "a/msg/Top").type_hash
    )


def test_described_type___without_all_its_files___has_the_members_alone(tmp_path: Path) -> None:
    file_of(tmp_path, "std_msgs/Header", "builtin_interfaces/Time stamp # when\nstring frame_id\n")
    found = describe(typestore(), "std_msgs/msg/Header", lambda package: tmp_path / package)
    assert found == describe(typestore(), "std_msgs/msg/Header")
