"""Crash-safe bag writer: topics as bytes into a rosbag2 folder of one or more MCAP files.

Log time and publish time of a message are both its source timestamp: the instant of publication,
not that of reception. So messages of different topics stay in the order of sending, and a
reference can be aligned with the sample that it followed.

Messages wait in memory for at most one flush period, of the clock or of their own times, whichever
is over first. A flush completes a compressed chunk with its checksum and hands it to the operating
system: a killed recorder loses only later messages. A last checksum covers each whole file.
"""

from __future__ import annotations

import math
import shutil
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from flexarm_bags.metadata import (
    FILE_NAME,
    NO_START_NS,
    RecordedTopic,
    Tally,
    as_yaml,
    bag_information,
    repair_command,
)
from flexarm_bags.records.storage_file import FileTopic, StorageFile
from flexarm_bags.sequence import SequenceCheck
from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from typing import BinaryIO

    from flexarm_core.clock import Clock

LATEST_TIME_NS = 2**63 - 1


class RecordingError(FlexarmError):
    """The bag cannot be created or written."""


class BagWriter:
    """Writer of raw CDR messages into a new rosbag2 folder.

    Parameters
    ----------
    path : Path or str
        Folder to create. An existing path is never changed.
    topics : sequence of RecordedTopic
        All topics; names are unique.
    ros_distro : str
        Distribution named in the metadata.
    flush_period_s : float
        Longest time that messages stay in memory while others come in. A recorder whose topics
        may fall silent calls `flush_if_due` from time to time.
    max_file_bytes : int
        Size at which a file is full and the next one begins; 0: never.
    max_file_s : float
        Time from the first message of a file, s, at which the next one begins; 0: never.
    clock : Clock, optional
        Clock of the flush period, by default that of the machine.

    Attributes
    ----------
    sequences : SequenceCheck
        Losses among the messages written so far.

    Raises
    ------
    RecordingError
        If the path exists, is in another bag or cannot be created, or a topic is named twice.

    Examples
    --------
    ::

        with BagWriter(folder, [RecordedTopic("/flexarm/state", definition)]) as bag:
            bag.write("/flexarm/state", raw, stamp_ns, stamp_ns)
    """

    def __init__(
        self,
        path: Path | str,
        topics: Sequence[RecordedTopic],
        *,
        ros_distro: str = "jazzy",
        flush_period_s: float = 0.9,
        max_file_bytes: int = 0,
        max_file_s: float = 0.0,
        clock: Clock | None = None,
    ) -> None:
        self.path = Path(path)
        self.topics = tuple(topics)
        self._ros_distro = ros_distro
        self._flush_period_s = flush_period_s
        self._clock: Clock = time if clock is None else clock
        self._max_file_bytes = max_file_bytes or math.inf
        self._max_file_ns = max_file_s * 1e9 or math.inf
        types = {topic.name: topic.definition.type_name for topic in self.topics}
        if len(types) < len(self.topics):
            raise RecordingError(f"{self.path}: a topic is to be recorded twice; name each once")
        self.sequences = SequenceCheck(types)
        self._create_folder()
        self._closed = False
        # One for each file.
        self._tallies: list[Tally] = []
        self._waiting_since_ns = LATEST_TIME_NS
        try:
            self._begin_file()
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot create: {error.strerror}") from error

    @property
    def message_count(self) -> int:
        """Messages written so far, flushed or not."""
        return sum(tally.total for tally in self._tallies)

    def write(self, topic: str, raw: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Add one message, in a new file if the present one is full or complete.

        Flushes when the last flush is a flush period ago.

        Parameters
        ----------
        topic : str
            Name of one of the recorded topics.
        raw : bytes
            Serialised message with its 4 bytes of CDR encapsulation.
        log_time_ns, publish_time_ns : int
            Source timestamp, nanoseconds since the epoch (see the head of this module).

        Raises
        ------
        RecordingError
            If the bag is closed, the topic unknown, a time outside of a bag's range, or the disk
            refuses the data. In the last case the bag is closed and keeps what was flushed.
        """
        self._require_open()
        if topic not in self._tallies[-1].counts:
            raise RecordingError(f"{self.path}: {topic} is none of the recorded topics")
        if not (0 <= log_time_ns <= LATEST_TIME_NS and 0 <= publish_time_ns <= LATEST_TIME_NS):
            raise RecordingError(
                f"{self.path}: {topic}: time {log_time_ns} ns, published {publish_time_ns} ns, is"
                " not a time since the epoch"
            )
        try:
            if self._is_full(log_time_ns):
                self._complete_file()
            if self._file.finished:
                self._begin_file()
            self._file.add(topic, raw, log_time_ns, publish_time_ns)
        except OSError as error:
            self._fail(error)
        self._tallies[-1].add(topic, log_time_ns)
        self.sequences.add(topic, raw)
        self._waiting_since_ns = min(self._waiting_since_ns, log_time_ns)
        if log_time_ns - self._waiting_since_ns >= self._flush_period_s * 1e9:
            self.flush()
        self.flush_if_due()

    def flush_if_due(self) -> None:
        """Flush when messages have waited for a flush period; errors as in `flush`."""
        if self._clock.monotonic() - self._flushed_at_s >= self._flush_period_s:
            self.flush()

    def flush(self) -> None:
        """Complete the present chunk and hand everything to the operating system.

        Raises
        ------
        RecordingError
            If the bag is closed or the disk refuses the data.
        """
        self._require_open()
        try:
            self._flush()
        except OSError as error:
            self._fail(error)

    def end_file(self) -> None:
        """Complete the present file; the next message begins another one, and maybe after a gap.

        Errors are as in `flush`.
        """
        self._require_open()
        self.sequences.forget()
        if self._file.finished:
            return
        try:
            self._complete_file()
        except OSError as error:
            self._fail(error)

    def close(self) -> None:
        """Write index and metadata and close, once; RecordingError if the disk refuses the data."""
        if self._closed:
            return
        self.end_file()
        self._closed = True

    def discard(self) -> None:
        """Close the bag and remove it."""
        self.close()
        shutil.rmtree(self.path, ignore_errors=True)

    def __enter__(self) -> BagWriter:  # noqa: PYI034 - Self needs Python 3.11
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _create(self, file: Path) -> BinaryIO:
        """Create a file of messages, and open it for writing."""
        return file.open("xb")

    def _create_folder(self) -> None:
        outer = self.path.parent
        # Other programs write files of that name too, but not beside messages.
        if (outer / FILE_NAME).exists() and any(outer.glob("*.mcap*")):
            raise RecordingError(f"{self.path}: {outer} is a bag: choose a name outside of it")
        try:
            self.path.mkdir(parents=True)
        except FileExistsError as error:
            raise RecordingError(
                f"{self.path}: exists already and is not overwritten; choose another name"
            ) from error
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot create: {error.strerror}") from error

    def _file_name(self, number: int) -> str:
        return f"{self.path.name}_{number}.mcap"

    def _begin_file(self) -> None:
        self._file = StorageFile(
            self.path / self._file_name(len(self._tallies)),
            (
                FileTopic(
                    topic.name,
                    topic.definition.type_name,
                    topic.definition.text,
                    {
                        "offered_qos_profiles": topic.qos_text(),
                        "topic_type_hash": topic.definition.type_hash,
                    },
                )
                for topic in self.topics
            ),
            self._create,
        )
        self._tallies.append(Tally({topic.name: 0 for topic in self.topics}))
        self._keep()
        self._write_metadata()

    def _is_full(self, log_time_ns: int) -> bool:
        first_ns = self._tallies[-1].first_ns
        return (
            first_ns < NO_START_NS
            and not self._file.finished
            and (
                self._file.flushed_bytes >= self._max_file_bytes
                or log_time_ns - first_ns > self._max_file_ns
            )
        )

    def _complete_file(self) -> None:
        self._flush()
        self._file.finish(as_yaml(self._information()))
        self._write_metadata()

    def _flush(self) -> None:
        if not self._file.finished:
            self._file.flush()
        self._keep()

    def _keep(self) -> None:
        """Note that everything is with the operating system."""
        self._kept = [*self._tallies[:-1], self._tallies[-1].copy()]
        self._flushed_at_s = self._clock.monotonic()
        self._waiting_since_ns = LATEST_TIME_NS

    def _information(self) -> dict[str, object]:
        files = {self._file_name(number): tally for number, tally in enumerate(self._kept)}
        return bag_information(files, self.topics, self._ros_distro)

    def _write_metadata(self) -> None:
        # Replaced in one step: a crash leaves the old text or the new one, never half of it.
        target = self.path / FILE_NAME
        draft = target.with_suffix(".yaml.tmp")
        content = {"rosbag2_bagfile_information": self._information()}
        draft.write_text(as_yaml(content), "utf-8")
        draft.replace(target)

    def _require_open(self) -> None:
        if self._closed:
            raise RecordingError(f"{self.path}: is closed")

    def _fail(self, error: OSError) -> NoReturn:
        """Keep what was flushed, close, and report."""
        self._closed = True
        self._file.abandon()
        with suppress(OSError):
            self._write_metadata()
        kept = sum(tally.total for tally in self._kept)
        raise RecordingError(
            f"{self.path}: cannot write: {error.strerror}; the first {kept} messages"
            f" are kept, get them with {repair_command(self.path)}"
        ) from error


@contextmanager
def whole_bag(path: Path, topics: Sequence[RecordedTopic]) -> Iterator[BagWriter]:
    """Open a new bag that is there as a whole in the end, or not at all.

    What can be made again is not worth the half of it, which would stand in the way. A record of
    an experiment cannot: for that there is `BagWriter`, whose parameters and errors are the same.
    """
    # Nothing has to be safe before the end.
    bag = BagWriter(path, topics, flush_period_s=math.inf)
    try:
        with bag:
            yield bag
    except BaseException as error:
        shutil.rmtree(path, ignore_errors=True)
        if isinstance(error, RecordingError) and isinstance(error.__cause__, OSError):
            raise RecordingError(
                f"{path}: cannot write: {error.__cause__.strerror}; nothing is kept"
            ) from error
        raise
