"""Bag integrity check of files, definitions, samples and clocks.

It covers every bit that a checksum or a second copy protects.
"""

from __future__ import annotations

import sqlite3
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from rosbags.highlevel import AnyReader

from flexarm_bags.bounds import bounded, require_bounded_file, require_bounded_messages
from flexarm_bags.content import ContentCheck
from flexarm_bags.mcap_check import McapExamination, TopicMessages
from flexarm_bags.metadata import in_order, parts_of, plain_name, read_information
from flexarm_bags.records.chunks import Messages
from flexarm_bags.schema import foreign_topics, ros_messages
from flexarm_core.bounds import YamlError, shown, yaml_content
from flexarm_core.errors import BagError, FlexarmError, one_line

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


_OURS = "flexarm"
_BATCH = 20_000


@dataclass(frozen=True)
class BagCheck:
    """Findings of a check.

    Attributes
    ----------
    bag : Path
        The bag.
    messages : int
        Messages that could be read.
    samples : int
        Messages that are samples, or may be: a damaged bag does not always tell.
    problems : tuple of str
        What is wrong, one line each; empty for a good bag.
    skipped : tuple of str
        Those of `problems` that are periods without a sample.
    notes : tuple of str
        What could not be checked, and restarts of the sampling, one line each.
    is_cut : bool
        Whether a file with messages lacks its end, or the folder its metadata: the recording was
        interrupted, or goes on.
    """

    bag: Path
    messages: int
    samples: int
    problems: tuple[str, ...]
    skipped: tuple[str, ...]
    notes: tuple[str, ...]
    is_cut: bool


def check_bag(uri: Path | str) -> BagCheck:
    """Check everything about a bag that can be checked; damage is a problem, not an exception.

    Parameters
    ----------
    uri : Path or str
        rosbag2 folder (MCAP or SQLite, split or compressed) or a single ``.mcap`` or ``.db3`` file.

    Raises
    ------
    BagError
        If there is no such bag.
    """
    path = Path(uri)
    if not path.exists():
        raise BagError(f"{path}: no such bag")
    return _Check(path).result()


class _Check:
    """One check: collects problems while it goes through a bag."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._problems: list[str] = []
        self._notes: list[str] = []
        self._is_cut = False
        self._content = ContentCheck(self._problems, self._notes)

    def result(self) -> BagCheck:
        information = self._information()
        with ExitStack() as stack:
            try:
                plain = self._bounded(information, stack)
            except FlexarmError as error:
                self._problems.append(str(error).removeprefix(f"{self._path}: "))
            else:
                # Without metadata rosbags finds no bag in a folder.
                is_bag = bool(information) or not self._path.is_dir()
                reader = self._opened(plain, stack) if is_bag else None
                for messages in self._messages(information, reader, plain):
                    self._content.add(messages)
        if information:
            self._compare(information)
        self._content.judge()
        total = self._content.total
        if not total and not self._problems:
            self._problems.append("has no message")
        samples = self._content.samples
        problems, notes = tuple(self._problems), tuple(self._notes)
        skipped = tuple(self._content.skipped)
        return BagCheck(self._path, total, samples, problems, skipped, notes, self._is_cut)

    def _information(self) -> dict[str, Any]:
        try:
            return read_information(self._path) if self._path.is_dir() else {}
        except BagError as error:
            self._problems.append(str(error))
            return {}

    def _bounded(self, information: Mapping[str, Any], stack: ExitStack) -> Path:
        """Return the bag, or its plain copy where it is compressed."""
        if information or not self._path.is_dir():
            return stack.enter_context(bounded(self._path))
        for file in self._present():
            require_bounded_file(file)
        return self._path

    def _present(self) -> list[Path]:
        return in_order([*self._path.glob("*.mcap*"), *self._path.glob("*.db3*")])

    def _opened(self, plain: Path, stack: ExitStack) -> AnyReader | None:
        """Open the bag for its definitions, which rosbags compares with their type hashes."""
        try:
            parts = [stack.enter_context(ros_messages(each)) for each in parts_of(plain)]
            reader = stack.enter_context(AnyReader(parts))
            require_bounded_messages(reader)
            self._content.connect(reader)
        except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
            self._problems.append(f"cannot be opened: {one_line(error)}")
            return None
        return reader

    def _messages(
        self, information: Mapping[str, Any], reader: AnyReader | None, plain_bag: Path
    ) -> Iterator[TopicMessages]:
        names = information.get("relative_file_paths")
        files = [self._path]
        if self._path.is_dir():
            # A folder without readable metadata still shows its files.
            stored = (PurePath(name).name for name in names or ())
            files = [self._path / name for name in stored]
            present = self._present()
            self._problems += [f"{file.name}: is missing" for file in files if not file.exists()]
            if names is not None:
                strange = [file.name for file in present if file not in files]
                self._problems += [f"{name}: is not named in metadata.yaml" for name in strange]
            files = [file for file in present if names is None or file in files]
        compressed = str(information.get("compression_mode") or "").lower()
        plain = compressed != "message"
        for stored_file in files:
            file = stored_file
            if plain_bag != self._path:
                file = plain_bag
                if plain_bag.is_dir():
                    file /= plain_name(stored_file.name)
            if file.suffix == ".mcap":
                yield from self._mcap(file, information, hand_on=plain)
            elif file.suffix == ".db3":
                self._sqlite(file)
                plain = False
            else:
                self._problems.append(f"{file.name}: is neither .mcap nor .db3")
        if not plain and reader is not None:
            yield from self._one_by_one(reader)

    def _mcap(
        self, file: Path, information: Mapping[str, Any], *, hand_on: bool
    ) -> Iterator[TopicMessages]:
        examination = McapExamination(file)
        foreign = foreign_topics(file)
        for messages in examination.messages():
            if hand_on and messages.topic not in foreign:
                yield messages
        has_no_facts = self._path.is_dir() and not information
        self._is_cut |= bool(examination.counts) and (examination.is_cut or has_no_facts)
        self._problems += examination.problems
        self._notes += examination.notes
        for channel in examination.channels.values():
            schema = examination.schemas.get(channel.schema_id)
            if channel.topic in foreign:
                self._notes.append(
                    f"{file.name}: {channel.topic} is {foreign[channel.topic]}, which is not read"
                )
            elif schema is None:
                self._problems.append(f"{file.name}: {channel.topic} has no definition")
        if information and examination.library.startswith(_OURS):
            self._compare_file(examination, information)

    def _compare_file(self, examination: McapExamination, information: Mapping[str, Any]) -> None:
        """Compare metadata.yaml with its copy in a file of ours."""
        text = examination.metadata.get("rosbag2", {}).get("serialized_metadata")
        said: Any = None
        with suppress(YamlError):
            said = yaml_content(text or "")
        if said == information:
            return
        # A file that others follow describes itself and those before it.
        names = [PurePath(name).name for name in information["relative_file_paths"]]
        number = 1 + names.index(examination.file.name) if examination.file.name in names else 0
        entries: Any = information.get("files")
        is_followed = isinstance(said, dict) and isinstance(entries, list) and number < len(names)
        if not (is_followed and said.get("files") == entries[:number]):
            self._problems.append("metadata.yaml: differs from its copy inside the file")

    def _sqlite(self, file: Path) -> None:
        self._notes.append(
            f"{file.name}: SQLite keeps no checksums, a wrong bit can stay unnoticed"
        )
        try:
            with closing(sqlite3.connect(f"file:{file}?mode=ro", uri=True)) as database:
                (answer,) = database.execute("PRAGMA integrity_check").fetchone()
        except sqlite3.Error as error:
            answer = one_line(error)
        if answer != "ok":
            self._problems.append(f"{file.name}: {answer}")

    def _one_by_one(self, reader: AnyReader) -> Iterator[TopicMessages]:
        for connection in reader.connections:
            found = reader.messages([connection])
            try:
                while batch := list(islice(found, _BATCH)):
                    messages = Messages.of(
                        [time_ns for _, time_ns, _ in batch], [raw for _, _, raw in batch]
                    )
                    yield TopicMessages(connection.topic, messages)
            except Exception as error:  # noqa: BLE001 - parsers raise anything on damaged bytes
                self._problems.append(f"{connection.topic}: {one_line(error)}")

    def _compare(self, information: Mapping[str, Any]) -> None:
        """Compare metadata.yaml with the messages."""
        if not information.get("storage_identifier"):
            self._problems.append("metadata.yaml: names no storage")
        content = self._content
        try:
            said = {
                str(entry["topic_metadata"]["name"]): (
                    entry["message_count"],
                    entry["topic_metadata"]["type"],
                )
                for entry in information["topics_with_message_count"]
            }
            total = information["message_count"]
            first_ns = information["starting_time"]["nanoseconds_since_epoch"]
            duration_ns = information["duration"]["nanoseconds"]
        except (KeyError, TypeError) as error:
            self._problems.append(f"metadata.yaml: lacks {one_line(error)}")
            return
        if total != content.total:
            self._problems.append(
                f"metadata.yaml: says {shown(total)} messages, there are {content.total}"
            )
        for name, topic in content.topics.items():
            count, type_name = said.get(name, (None, None))
            if count != topic.count:
                self._problems.append(
                    f"{name}: metadata.yaml says {shown(count)} messages, there are {topic.count}"
                )
            if type_name != topic.type_name:
                self._problems.append(f"{name}: metadata.yaml says type {shown(type_name)}")
        times_ns = (content.first_ns, content.last_ns - content.first_ns)
        if content.total and (first_ns, duration_ns) != times_ns:
            self._problems.append("metadata.yaml: does not have the times of the messages")
