"""Bounds of a bag: what reading it would take, found before anything of it is unpacked.

rosbags and the decompressors believe what a file says of its sizes, and a few bytes can say
terabytes. So a bag is opened inside `bounded`, which applies the rule of `flexarm_core.bounds`: a
plain file, and no more unpacked bytes than are allowed to one of its size.
"""

from __future__ import annotations

import shutil
import tempfile
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, BinaryIO

import zstandard
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Statistics
from rosbags.rosbag2.reader import DirectoryReader

from flexarm_bags.metadata import FILE_NAME, as_yaml, plain_name, read_information, require_bag
from flexarm_bags.records.database import require_database
from flexarm_bags.records.layout import (
    CHUNK_BYTES,
    MAGIC,
    ChunkSizes,
    CutError,
    TooManyError,
    chunk_records,
    chunk_sizes,
    mapped,
    summary_of,
    unpacked,
    unpacked_bytes,
    walk,
)
from flexarm_core.bounds import (
    BoundError,
    require_plain_file,
    too_much,
    unpacked_bytes_allowed,
)
from flexarm_core.errors import BagError, one_line

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from mmap import mmap

    from mcap.records import McapRecord
    from rosbags.highlevel import AnyReader

_COPY_BYTES = 1 << 20
# So few bytes do not hold too many records.
_FEW_BYTES = 8 << 20
# The copy of a compressed bag leaves as much of the temporary folder free as it takes.
_FREE_PART = 2


@contextmanager
def bounded(path: Path, *, unpacks: bool = False) -> Iterator[Path]:
    """Yield a bag that can be opened within bounds: itself, or a plain copy of a compressed one.

    Parameters
    ----------
    path : Path
        rosbag2 folder, or a single ``.mcap`` or ``.db3`` file, compressed or not.
    unpacks : bool
        True when rosbags is going to unpack the chunks.

    Raises
    ------
    BagError
        If there is no bag, or a compressed file is damaged.
    BoundError
        If a file is not a plain one, or unpacking it would take more than is allowed.
    """
    require_bag(path)
    with ExitStack() as stack:
        if not path.is_dir():
            if plain_name(path.name) != path.name:
                path = _unpacked(path, _temporary(stack))
            require_bounded_file(path, unpacks=unpacks)
            yield path
            return
        information = read_information(path)
        files = [path / PurePath(name).name for name in information["relative_file_paths"]]
        files = [file for file in files if file.exists()]
        if str(information.get("compression_mode") or "").lower() == "file":
            path, files = _plain_copy(_temporary(stack), files, information)
        for file in files:
            require_bounded_file(file, unpacks=unpacks)
        yield path


def _temporary(stack: ExitStack) -> Path:
    return Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="flexarm_bag_")))


def _plain_copy(
    folder: Path, files: list[Path], information: Mapping[str, Any]
) -> tuple[Path, list[Path]]:
    """Unpack the files of a bag into a folder; return the bag in there and its files."""
    copies = [_unpacked(file, folder) for file in files]
    plain = dict(information) | {
        "compression_mode": "",
        "compression_format": "",
        "relative_file_paths": [
            plain_name(PurePath(name).name) for name in information["relative_file_paths"]
        ],
    }
    (folder / FILE_NAME).write_text(as_yaml({"rosbag2_bagfile_information": plain}), "utf-8")
    return folder, copies


def _unpacked(file: Path, folder: Path) -> Path:
    allowed = unpacked_bytes_allowed(require_plain_file(file))
    free = shutil.disk_usage(folder).free // _FREE_PART
    copy, total = folder / plain_name(file.name), 0
    try:
        with file.open("rb") as source, copy.open("wb") as target:
            reader = zstandard.ZstdDecompressor().stream_reader(source)
            while part := reader.read(_COPY_BYTES):
                total += len(part)
                if total > allowed:
                    raise BoundError(f"{file.name}: {too_much(allowed)}")
                if total > free:
                    raise BoundError(
                        f"{file.name}: unpacked it would fill {folder.parent}: set TMPDIR to a "
                        "folder with more space"
                    )
                target.write(part)
    except (OSError, zstandard.ZstdError) as error:
        raise BagError(f"{file.name}: cannot be decompressed: {one_line(error)}") from error
    return copy


def require_bounded_file(file: Path, *, unpacks: bool = False) -> None:
    """Refuse a storage file that takes more than is allowed; `unpacks` as in `bounded`.

    Raises
    ------
    BoundError
        If the file is not a plain one or its chunks would take too much.
    BagError
        If it is called a database of a bag and is none.
    """
    allowed = unpacked_bytes_allowed(require_plain_file(file))
    if file.suffix == ".db3":
        require_database(file)
    if file.suffix == ".mcap" and file.stat().st_size:
        with (
            file.open("rb") as stream,
            mapped(stream) as data,
        ):
            has_statistics = _require_bounded_mcap(stream, data, allowed)
            # Without statistics rosbags unpacks every chunk when it opens the file.
            if unpacks or not has_statistics:
                require_honest_chunks(stream)


def _require_bounded_mcap(stream: BinaryIO, data: mmap, allowed: int) -> bool:
    name = Path(stream.name).name
    summary = _summary(stream)
    chunks = _stated_chunks(data)
    for index in summary:
        if isinstance(index, ChunkIndex):
            # The index and the chunk are believed by different readers.
            stated = max(index.uncompressed_size, chunks.get(index.chunk_start_offset, 0))
            chunks[index.chunk_start_offset] = stated
    for start, size in chunks.items():
        if size > CHUNK_BYTES:
            raise BoundError(
                f"{name}: the chunk at byte {start} says that it has {size >> 20} MB unpacked, "
                f"allowed are {CHUNK_BYTES >> 20}: `flexarm bag repair` leaves it out"
            )
    if sum(chunks.values()) > allowed:
        raise BoundError(f"{name}: {too_much(allowed)}")
    return any(isinstance(record, Statistics) for record in summary)


def _summary(stream: BinaryIO) -> list[McapRecord]:
    try:
        return summary_of(stream)
    except BoundError as error:
        raise BoundError(f"{Path(stream.name).name}: {error}") from error
    except Exception:  # noqa: BLE001 - who reads it reports what is wrong with it
        return []


def _stated_chunks(data: mmap) -> dict[int, int]:
    """Return the unpacked size that each chunk states, by its place; up to a cut."""
    return {start: sizes.unpacked for start, sizes in _chunks(data)}


def _chunks(data: mmap) -> Iterator[tuple[int, ChunkSizes]]:
    with suppress(CutError):
        for opcode, start, end in walk(data, len(MAGIC)):
            if opcode == Opcode.FOOTER:
                return
            if opcode == Opcode.CHUNK and (sizes := chunk_sizes(data, start, end)) is not None:
                yield sizes.record_start, sizes


def require_honest_chunks(stream: BinaryIO) -> None:
    """Unpack every chunk of a file up to the size that it states, before rosbags unpacks it all.

    Raises
    ------
    BoundError
        If a chunk has more than it states.
    """
    with mapped(stream) as data:
        for start, sizes in _chunks(data):
            packed = data[sizes.packed_start : sizes.packed_end]
            if unpacked_bytes(packed, sizes.compression, sizes.unpacked) > sizes.unpacked:
                raise BoundError(
                    f"{Path(stream.name).name}: the chunk at byte {start} has more than the "
                    f"{sizes.unpacked} bytes that it states"
                )
            if sizes.unpacked > _FEW_BYTES:
                _require_few_records(
                    f"{Path(stream.name).name}: the chunk at byte {start}", packed, sizes
                )


def _require_few_records(label: str, packed: bytes, sizes: ChunkSizes) -> None:
    """Refuse a chunk of millions of empty messages, which rosbags visits one by one."""
    try:
        chunk_records(unpacked(packed, sizes.compression, sizes.unpacked))
    except TooManyError as error:
        raise BoundError(f"{label}: {error}") from error
    except Exception:  # noqa: BLE001 - who reads it reports damage
        return


def storages(reader: AnyReader) -> list[Any]:
    """Return the storage files of an open bag."""
    # rosbags has a storage for a folder, which holds those of its files, or that of a single file.
    found: list[Any] = [getattr(each, "storage", None) for each in reader.readers]
    return [
        storage
        for each in found
        for storage in (each.storages if isinstance(each, DirectoryReader) else [each])
    ]


def allowed_bytes(reader: AnyReader) -> int:
    """Return how many bytes the messages of an open bag may take together."""
    files = (Path(str(storage.path)) for storage in storages(reader))
    return unpacked_bytes_allowed(sum(file.stat().st_size for file in files))


def is_compressed(reader: AnyReader) -> bool:
    """Return whether each message of an open bag is compressed by itself."""
    storage = getattr(reader.readers[0], "storage", None)
    return isinstance(storage, DirectoryReader) and bool(storage.metadata.compression_mode)


def require_bounded_messages(reader: AnyReader) -> None:
    """Unpack the messages of a bag that compresses each of them, up to what is allowed.

    Raises
    ------
    BoundError
        If they have more.
    """
    if not is_compressed(reader):
        return
    allowed = left = allowed_bytes(reader)
    for storage in storages(reader):
        for _, _, raw in storage.messages(storage.connections):
            left -= unpacked_bytes(bytes(raw), "zstd", left)
            if left < 0:
                raise BoundError(too_much(allowed))
