"""Bags of every kind that flexarm writes, as strict readers of other projects see them."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

import pytest
import yaml
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from rosbags.convert.cli import main as rosbags_convert
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from flexarm_bags.check import check_bag
from flexarm_bags.reader import opened
from flexarm_bags.repair import repair_bag
from flexarm_bags.writer import BagWriter
from flexarm_core.errors import BagError
from flexarm_ident.importing.csv_import import import_csv
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap
from support.bag_samples import controlled_run, information, recorded_topics, typestore, write_bag
from support.damaged_bags import content

if TYPE_CHECKING:
    from pathlib import Path

    from mcap.records import Schema

KINDS = ("recorded", "split", "snapshots", "imported", "repaired")


def made(kind: str, folder: Path) -> Path:
    """Return a new bag of a kind."""
    messages, path = controlled_run(), folder / kind
    if kind == "imported":
        file = folder / "data.csv"
        file.write_text("i,q\n" + "".join(f"{k},{-k}\n" for k in range(50)), "utf-8")
        columns = CsvMap((CsvChannel("i", "i"),), (CsvChannel("q", "q"),), rate_hz=100.0)
        import_csv(file, columns, path, typestore=typestore())
    elif kind == "repaired":
        cut = next(write_bag(folder / "cut", messages).glob("*.mcap"))
        cut.write_bytes(cut.read_bytes()[:-100])
        repair_bag(cut.parent, path)
    else:
        limit_s = 0.1 if kind == "split" else 0.0
        with BagWriter(path, recorded_topics(messages), max_file_s=limit_s) as bag:
            for number, message in enumerate(messages):
                bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
                if kind == "snapshots" and number == 200:
                    bag.end_file()
    return path


@pytest.fixture(scope="module", params=KINDS)
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(str(request.param), tmp_path_factory.mktemp("kinds"))


def hash_of(schema: Schema) -> str:
    """Return the hash of a definition by rosbags, from its text alone."""
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(schema.data.decode(), schema.name))
    return types.hash_rihs01(schema.name)


def test_files___of_every_kind___pass_a_strict_reader(bag: Path) -> None:
    """The checks of `mcap doctor`: every record and checksum, order, indexes, statistics."""
    reported = information(bag)
    files: Any = reported["files"]
    assert [file.name for file in sorted(bag.glob("*.mcap"))] == reported["relative_file_paths"]
    for entry in files:
        with (bag / entry["path"]).open("rb") as stream:
            records = list(StreamReader(stream, validate_crcs=True).records)
        with (bag / entry["path"]).open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            summary, header = reader.get_summary(), reader.get_header()
            found = list(reader.iter_messages())
        assert summary is not None
        assert summary.statistics is not None
        assert (header.profile, len(found)) == ("ros2", summary.statistics.message_count)
        assert len(found) == entry["message_count"] > 0
        times_ns = [message.log_time for _, _, message in found]
        start_ns = entry["starting_time"]["nanoseconds_since_epoch"]
        assert (min(times_ns), max(times_ns)) == (
            summary.statistics.message_start_time,
            summary.statistics.message_end_time,
        )
        assert (min(times_ns), max(times_ns) - min(times_ns)) == (
            start_ns,
            entry["duration"]["nanoseconds"],
        )
        assert [type(record).__name__ for record in records[:1] + records[-1:]] == [
            "Header",
            "Footer",
        ]


def test_topics___of_every_kind___have_definition_hash_and_qos_twice_alike(bag: Path) -> None:
    reported = information(bag)
    topics: Any = reported["topics_with_message_count"]
    metadata = {topic["topic_metadata"]["name"]: topic["topic_metadata"] for topic in topics}
    for file in bag.glob("*.mcap"):
        with file.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        for channel in summary.channels.values():
            schema, noted = summary.schemas[channel.schema_id], metadata[channel.topic]
            assert noted["type"] == schema.name
            assert channel.metadata["topic_type_hash"] == noted["type_description_hash"]
            assert hash_of(schema) == noted["type_description_hash"]
            offered = yaml.safe_load(channel.metadata["offered_qos_profiles"])
            assert offered == noted["offered_qos_profiles"]
            latched = channel.topic == "/flexarm/io_channels"
            assert offered[0]["durability"] == ("transient_local" if latched else "volatile")


def test_rosbags_convert___takes_every_kind___without_a_word(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    words = f"--src {bag} --dst {tmp_path / 'converted'} --dst-storage sqlite3"
    monkeypatch.setattr(sys, "argv", ["rosbags-convert", *words.split()])
    with pytest.raises(SystemExit) as ended:
        rosbags_convert()
    assert ended.value.code == 0
    assert capfd.readouterr() == ("", "")
    assert content(tmp_path / "converted") == content(bag)


def test_check___of_every_kind___finds_nothing(bag: Path) -> None:
    assert check_bag(bag).problems == ()


def test_reader___of_an_installation_that_lacks_a_part___does_not_blame_the_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = write_bag(tmp_path / "run", controlled_run(3))
    monkeypatch.setitem(sys.modules, "numpy.testing", None)

    def read() -> None:
        with opened(bag):
            import_module("numpy.testing")

    with pytest.raises(BagError, match=r"numpy\.testing.*part of a library, install again"):
        read()
