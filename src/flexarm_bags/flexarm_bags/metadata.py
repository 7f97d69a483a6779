"""The metadata of a rosbag2 folder, version 9, as ROS 2 Jazzy writes it."""

from __future__ import annotations

import re
import shlex
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml
from rosbags.interfaces import QosDurability, QosReliability

from flexarm_core.bounds import read_text_bytes, yaml_content
from flexarm_core.errors import BagError, FlexarmError, reason

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from rosbags.interfaces import Qos

    from flexarm_bags.schema import MessageDefinition

FILE_NAME = "metadata.yaml"
_KEY = "rosbag2_bagfile_information"
_STORAGES = (".mcap", ".db3")
_UNPACK, _SAVE = "unpack it first", "save its signals as CSV, a column each, with their names above"
_REMEDIES = {
    ".bag": "a bag of ROS 1 is converted by `rosbags-convert --src FILE --dst FOLDER`",
    **dict.fromkeys((".npy", ".npz", ".json", ".jsonl", ".pkl", ".ulg", ".blf", ".bin"), _SAVE),
    **dict.fromkeys((".mf4", ".mdf", ".tdm", ".wav", ".nc", ".uff", ".dxd", ".d7d", ".db"), _SAVE),
    ".arrow": f"an Arrow file: {_SAVE}",
    ".rrd": f"a recording of Rerun: {_SAVE}",
    **dict.fromkeys((".gz", ".zip", ".bz2", ".xz", ".zst", ".7z", ".tar"), _UNPACK),
}
"""What to do with files that are neither bags nor tables, by their ending."""
BAG_FILES = (f"{FILE_NAME}*", "*.mcap*", "*.db3*")
"""Patterns of the files of a bag."""
VERSION = 9
# What rosbag2 writes while it has seen no message: the largest time there is.
NO_START_NS = 2**63 - 1
_INFINITE_NS = 2**63 - 1
_NS = 1_000_000_000
# A recorder writes a chunk every second or two.
_WRITES_EVERY_S = 5.0


@dataclass(frozen=True)
class TopicQos:
    """Quality of service that a publisher offers; liveliness is automatic, without a deadline."""

    reliability: str = "reliable"
    durability: str = "volatile"
    history: str = "keep_last"
    depth: int = 10
    lifespan_ns: int = _INFINITE_NS

    @classmethod
    def of(cls, profiles: Sequence[Qos]) -> TopicQos:
        """Return what the first profile of a bag says; what rosbag2 did not know stays default."""
        if not profiles:
            return cls()
        reliable = profiles[0].reliability is not QosReliability.BEST_EFFORT
        latched = profiles[0].durability is QosDurability.TRANSIENT_LOCAL
        return cls(
            reliability="reliable" if reliable else "best_effort",
            durability="transient_local" if latched else "volatile",
            depth=profiles[0].depth or cls.depth,
            lifespan_ns=profiles[0].lifespan.sec * _NS + profiles[0].lifespan.nsec,
        )

    def as_rosbag2(self) -> dict[str, object]:
        """Return the entry of ``offered_qos_profiles``."""
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": _time(_INFINITE_NS),
            "lifespan": _time(self.lifespan_ns),
            "liveliness": "automatic",
            "liveliness_lease_duration": _time(_INFINITE_NS),
            "avoid_ros_namespace_conventions": False,
        }


def _time(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // _NS, "nsec": time_ns % _NS}


@dataclass(frozen=True)
class RecordedTopic:
    """One topic of a bag: its name, its type with the definition, and the offered QoS."""

    name: str
    definition: MessageDefinition
    qos: TopicQos = field(default_factory=TopicQos)

    def qos_text(self) -> str:
        """Return the offered QoS as the YAML text that an MCAP channel carries."""
        return as_yaml([self.qos.as_rosbag2()]).strip()


@dataclass
class Tally:
    """Number of messages of each topic, and the extent of their log times.

    Attributes
    ----------
    counts : dict of str to int
        Topic name -> messages.
    first_ns, last_ns : int
        Earliest and latest log time.
    """

    counts: dict[str, int]
    first_ns: int = NO_START_NS
    last_ns: int = 0

    def add(self, topic: str, log_time_ns: int) -> None:
        """Count one message."""
        self.counts[topic] += 1
        self.first_ns = min(self.first_ns, log_time_ns)
        self.last_ns = max(self.last_ns, log_time_ns)

    def copy(self) -> Tally:
        """Return the present state."""
        return Tally(dict(self.counts), self.first_ns, self.last_ns)

    @classmethod
    def together(cls, parts: Sequence[Tally]) -> Tally:
        """Return the content of several files with the same topics."""
        return cls(
            {topic: sum(part.counts[topic] for part in parts) for topic in parts[0].counts},
            min(part.first_ns for part in parts),
            max(part.last_ns for part in parts),
        )

    def extent(self) -> dict[str, object]:
        """Return number and times of the messages as ``metadata.yaml`` has them."""
        return {
            "starting_time": {"nanoseconds_since_epoch": self.first_ns},
            "duration": {"nanoseconds": self.duration_ns},
            "message_count": self.total,
        }

    @property
    def total(self) -> int:
        """Messages of all topics."""
        return sum(self.counts.values())

    @property
    def duration_ns(self) -> int:
        """Time from the earliest to the latest message, 0 without messages."""
        return max(0, self.last_ns - self.first_ns)


def in_order(files: Iterable[Path]) -> list[Path]:
    """Return the files of a split bag by their numbers: the tenth follows the ninth."""

    def number(file: Path) -> tuple[int, str]:
        found = re.search(r"_(\d+)\.(mcap|db3)", file.name)
        return int(found[1]) if found else 0, file.name

    return sorted(files, key=number)


def plain_name(name: str) -> str:
    """Return the name of a file without the ending of one that is compressed as a whole."""
    return re.sub(r"\.zstd?$", "", name)


def _is_storage(path: Path) -> bool:
    return plain_name(path.name).endswith(_STORAGES)


def parts_of(path: Path) -> list[Path]:
    """Return what is opened of a bag: itself, or the files of a folder that does not name them.

    A folder may lack its metadata, or have metadata without a storage, as `ros2 bag reindex` leaves
    them.
    """
    if not path.is_dir():
        return [path]
    files = in_order(filter(_is_storage, path.iterdir()))
    if not files:
        return [path]
    if not (path / FILE_NAME).exists():
        return files
    return [path] if read_information(path).get("storage_identifier") else files


def require_bag(path: Path) -> None:
    """Raise a BagError for a path that is not a bag, before any parser wonders about its bytes."""
    if not path.exists():
        raise BagError(f"{path}: no such bag")
    if path.is_dir():
        if not (path / FILE_NAME).exists():
            raise BagError(f"{path}: no bag: the folder has no {FILE_NAME}{repair_advice(path)}")
    elif not _is_storage(path):
        expected = "expected a rosbag2 folder or a .mcap or .db3 file"
        raise BagError(f"{path}: no bag: {_REMEDIES.get(path.suffix.lower(), expected)}")


def repair_advice(path: Path) -> str:
    """Return the end of a sentence about a damaged bag; empty where there is nothing to repair."""
    files = [*path.glob("*.mcap")] if path.is_dir() else [path] * (path.suffix == ".mcap")
    if not files:
        return ""
    still = "end the record if it still runs, else " if _are_being_written(files) else ""
    return f"; {still}try {repair_command(path)}"


def _are_being_written(files: Iterable[Path]) -> bool:
    """Return whether a recorder may be at work."""
    written_s = max((each.stat().st_mtime for each in files if each.exists()), default=0.0)
    return time.time() - written_s < _WRITES_EVERY_S


def repair_command(path: Path) -> str:
    """Return the command that repairs a bag, as a sentence has it and a shell takes it."""
    return f"`flexarm bag repair {shlex.quote(str(path))} -o NEW`"


def read_information(bag: Path) -> dict[str, Any]:
    """Return the content of a folder's ``metadata.yaml`` below ``rosbag2_bagfile_information``.

    Raises
    ------
    BagError
        When it cannot be read or does not name the files.
    """
    try:
        content: Any = yaml_content(read_text_bytes(bag / FILE_NAME).decode("utf-8"))
    except (OSError, FlexarmError, ValueError) as error:
        text = reason(error).removeprefix(f"{bag / FILE_NAME}: ")
        raise BagError(f"{FILE_NAME}: cannot be read: {text}") from error
    information = content.get(_KEY) if isinstance(content, dict) else None
    if not isinstance(information, dict):
        raise BagError(f"{FILE_NAME}: cannot be read: it has no {_KEY}{repair_advice(bag)}")
    names = information.get("relative_file_paths")
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise BagError(f"{FILE_NAME}: cannot be read: relative_file_paths is not a list of names")
    return information


class StatedContent(NamedTuple):
    """What a folder's ``metadata.yaml`` says of its messages, which takes no parser of theirs."""

    messages: int
    duration_s: float
    topics: tuple[str, ...]


def stated_content(bag: Path) -> StatedContent:
    """Return number, extent and topics of a folder's messages; BagError when they are not given."""
    information = read_information(bag)
    try:
        return StatedContent(
            int(information["message_count"]),
            information["duration"]["nanoseconds"] / _NS,
            tuple(
                str(each["topic_metadata"]["name"])
                for each in information["topics_with_message_count"]
                if each["message_count"]
            ),
        )
    except (LookupError, TypeError, ValueError) as error:
        raise BagError(f"{bag}: {FILE_NAME} does not describe its messages: {error!r}") from error


def bag_information(
    files: Mapping[str, Tally], topics: Sequence[RecordedTopic], ros_distro: str
) -> dict[str, object]:
    """Return the part of ``metadata.yaml`` below ``rosbag2_bagfile_information``, in plain types.

    Parameters
    ----------
    files : mapping of str to Tally
        The storage files in order, relative to the folder, and their present content.
    topics : sequence of RecordedTopic
        All recorded topics.
    ros_distro : str
        Distribution that the messages come from.
    """
    tally = Tally.together(list(files.values()))
    return {
        "version": VERSION,
        "storage_identifier": "mcap",
        **tally.extent(),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.definition.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [topic.qos.as_rosbag2()],
                    "type_description_hash": topic.definition.type_hash,
                },
                "message_count": tally.counts[topic.name],
            }
            for topic in topics
        ],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": list(files),
        "files": [{"path": name, **content.extent()} for name, content in files.items()],
        "custom_data": None,
        "ros_distro": ros_distro,
    }


def as_yaml(content: object) -> str:
    """Return plain YAML without anchors, as rosbag2's parser expects it."""
    return yaml.dump(content, Dumper=_PlainDumper, sort_keys=False)


# With libyaml, where PyYAML has it, the same text takes a quarter of the time.
class _PlainDumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    """Writes a value that occurs twice in full both times."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002 - the name is PyYAML's
        """Return that no value becomes an alias."""
        return True
