"""One MCAP file of a bag while it is written."""

from __future__ import annotations

import os
from contextlib import suppress
from importlib.metadata import version
from typing import TYPE_CHECKING, NamedTuple

from mcap.writer import CompressionType, Writer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping
    from pathlib import Path
    from typing import BinaryIO

CHUNK_BYTES = 1 << 16
"""Size of a full chunk: about half a second of samples and commands, also in virtual time."""


class FileTopic(NamedTuple):
    """Topic as a file has it: name, type with its whole definition, and what is noted of it."""

    name: str
    type_name: str
    definition: str
    notes: Mapping[str, str]


class StorageFile:
    """New MCAP file of raw CDR messages, with checksums of each chunk and of the whole.

    Each method raises OSError when the disk refuses the data.

    Parameters
    ----------
    path : Path
        File to create.
    topics : iterable of FileTopic
        All topics; names are unique.
    create : callable
        Function that creates the file and opens it for writing.

    Attributes
    ----------
    finished : bool
        True when the file is complete, with its index.
    flushed_bytes : int
        Size of what the operating system has.
    """

    def __init__(
        self, path: Path, topics: Iterable[FileTopic], create: Callable[[Path], BinaryIO]
    ) -> None:
        self._path = path
        self.flushed_bytes = 0
        self.finished = False
        self._stream = create(path)
        self._writer = Writer(
            self._stream,
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_crcs=True,
            enable_data_crcs=True,
        )
        self._channels: dict[str, int] = {}
        try:
            self._begin(topics)
        except OSError:
            self.abandon()
            path.unlink()
            raise

    def add(self, topic: str, raw: bytes, log_time_ns: int, publish_time_ns: int) -> None:
        """Add a message of one of the topics."""
        self._writer.add_message(self._channels[topic], log_time_ns, raw, publish_time_ns)

    def flush(self) -> None:
        """Complete the present chunk and hand everything to the operating system."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self.flushed_bytes = self._stream.tell()

    def finish(self, metadata: str) -> None:
        """Write the bag's metadata and the index, and close."""
        self._writer.add_metadata("rosbag2", {"serialized_metadata": metadata})
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()
        self.finished = True

    def abandon(self) -> None:
        """Close a file that is not finished, with what was flushed."""
        if self.finished:
            return
        with suppress(OSError):
            self._stream.close()
        with suppress(OSError):
            os.truncate(self._path, self.flushed_bytes)

    def _begin(self, topics: Iterable[FileTopic]) -> None:
        self._writer.start(profile="ros2", library=f"flexarm, mcap {version('mcap')}")
        schemas: dict[str, int] = {}
        for topic in topics:
            if topic.type_name not in schemas:
                schemas[topic.type_name] = self._writer.register_schema(
                    topic.type_name, "ros2msg", topic.definition.encode()
                )
            self._channels[topic.name] = self._writer.register_channel(
                topic.name, "cdr", schemas[topic.type_name], dict(topic.notes)
            )
        self.flush()
