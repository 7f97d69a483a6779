"""Message definitions without a ROS installation: text, type hash, encoding and CDR of a type.

The common interfaces come with *rosbags*; the project's own types are read from their ``.msg``
files, in the source tree or in the installed share folder.
"""

from __future__ import annotations

import os
import sysconfig
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mcap.reader import make_reader
from mcap.records import Channel
from mcap.writer import Writer
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from flexarm_bags.records.layout import summary_of
from flexarm_core.bounds import BoundError, too_much, unpacked_bytes_allowed
from flexarm_core.errors import BagError, FlexarmError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rosbags.interfaces.typing import FieldDesc, Typesdict
    from rosbags.typesys.store import Typestore

_OWN = "flexarm_msgs"
# Between the types of a complete text.
_RULE = "=" * 80
CDR = "cdr"


class DefinitionError(FlexarmError):
    """A message type is unknown or its definition cannot be read."""


@dataclass(frozen=True)
class MessageDefinition:
    """Definition that a bag embeds, so that its messages stay readable without our software.

    Attributes
    ----------
    type_name : str
        Full name, ``package/msg/Type``.
    text : str
        Complete ``ros2msg`` text: the type, then every nested type behind a separator.
    type_hash : str
        ``RIHS01_...`` as ROS 2 computes it (REP 2016).
    """

    type_name: str
    text: str
    type_hash: str


def share_of(package: str) -> Path | None:
    """Return the share folder of a package, which holds ``msg/*.msg``; None without one.

    It lies below a prefix of ROS 2, or below that of this Python, where `pip install` puts it.
    """
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    schemes = (sysconfig.get_default_scheme(), sysconfig.get_preferred_scheme("user"))
    prefixes += [sysconfig.get_path("data", scheme) for scheme in schemes]
    shares = (Path(prefix, "share", package) for prefix in prefixes if prefix)
    return next((share for share in shares if share.is_dir()), None)


def load_typestore(packages: Mapping[str, Path]) -> Typestore:
    """Return a store of the Jazzy types together with the messages of further packages.

    Parameters
    ----------
    packages : mapping of str to Path
        Package name -> its folder that holds ``msg/*.msg``: the source, or `share_of` it.

    Raises
    ------
    DefinitionError
        If a folder has no ``.msg`` file or a file is not a valid definition.
    """
    typestore = get_typestore(Stores.ROS2_JAZZY)
    for package, folder in packages.items():
        files = sorted((folder / "msg").glob("*.msg"))
        if not files:
            raise DefinitionError(f"{folder / 'msg'}: no .msg file of package {package} in there")
        types: Typesdict = {}
        for file in files:
            types.update(_parse(file, f"{package}/msg/{file.stem}"))
        typestore.register(types)
    return typestore


def own_types() -> Typestore:
    """Return a store of the Jazzy types together with flexarm's own, as they are installed.

    Raises
    ------
    DefinitionError
        If they are not installed.
    """
    folder = share_of(_OWN)
    if folder is None:
        raise DefinitionError(
            f"the share folder of {_OWN} is not there: source the workspace, or pip install flexarm"
        )
    return load_typestore({_OWN: folder})


def _parse(file: Path, type_name: str) -> Typesdict:
    try:
        return get_types_from_msg(file.read_text("utf-8"), type_name)
    except (TypesysError, OSError, UnicodeDecodeError) as error:
        raise DefinitionError(f"{file}: no message definition: {error}") from error


def describe(
    typestore: Typestore, type_name: str, folder_of: Callable[[str], Path | None] | None = None
) -> MessageDefinition:
    """Return the definition of one type, ``package/msg/Type``, with all nested types.

    Parameters
    ----------
    typestore : Typestore
        Types, from `load_typestore`.
    type_name : str
        Full name.
    folder_of : callable, optional
        Returns the folder of a package that holds ``msg/*.msg``, None where there is none. With the
        files of all types the text is theirs, with the comments that tell units, as rosbag2 writes
        it; otherwise it has the members alone.

    Raises
    ------
    DefinitionError
        If the store does not know the type or one that it contains.
    """
    try:
        text = None if folder_of is None else _written(type_name, folder_of)
        if text is not None:
            return MessageDefinition(type_name, text, text_hash(type_name, text))
        text, _ = typestore.generate_msgdef(type_name, ros_version=2)
        return MessageDefinition(type_name, text, typestore.hash_rihs01(type_name))
    except (TypesysError, KeyError) as error:
        raise DefinitionError(
            f"message type {type_name} is unknown; give the folder of its package"
        ) from error


def text_hash(type_name: str, text: str) -> str:
    """Return the hash of a complete ``ros2msg`` text, ``RIHS01_...``; whatever rosbags raises."""
    typestore = get_typestore(Stores.EMPTY)
    typestore.register(get_types_from_msg(text, type_name))
    return typestore.hash_rihs01(type_name)


def _written(type_name: str, folder_of: Callable[[str], Path | None]) -> str | None:
    """Return a type's file, and behind it, each once, those of its members in depth first."""
    seen: set[str] = set()

    def appended(name: str) -> str:
        package, _, short = name.split("/")
        folder = folder_of(package)
        if folder is None:
            raise FileNotFoundError(package)
        text = (folder / "msg" / f"{short}.msg").read_text("utf-8")
        ((_, fields),) = get_types_from_msg(text, name).values()
        for nested in sorted(_named(description) for _, description in fields):
            if nested and nested not in seen:
                seen.add(nested)
                text += f"\n{_RULE}\nMSG: {nested.replace('/msg/', '/')}\n{appended(nested)}"
        return text

    try:
        return appended(type_name)
    except FileNotFoundError:
        return None


def _named(description: FieldDesc) -> str:
    """Return the message type of a member, or of its elements; empty for a primitive one."""
    if description[0] == Nodetype.NAME:
        return str(description[1])
    if description[0] in {Nodetype.ARRAY, Nodetype.SEQUENCE}:
        return _named(description[1][0])
    return ""


def foreign_topics(path: Path) -> dict[str, str]:
    """Return topic and encoding of the messages of an MCAP file that are not those of ROS 2.

    It is empty for another file, and for one without a summary.
    """
    if path.suffix != ".mcap" or path.is_dir():
        return {}
    with path.open("rb") as stream:
        try:
            summary = summary_of(stream)
        except Exception:  # noqa: BLE001 - who reads it says what is wrong with its bytes
            summary = []
    channels = [record for record in summary if isinstance(record, Channel)]
    return {
        each.topic: each.message_encoding or "nothing"
        for each in channels
        if each.message_encoding != CDR
    }


@contextmanager
def ros_messages(path: Path) -> Iterator[Path]:
    """Yield a file as it is, or where it has other messages too a copy with those of ROS 2.

    Raises
    ------
    BagError
        If it has no messages of ROS 2.
    BoundError
        If they take more than is allowed.
    """
    foreign = foreign_topics(path)
    if not foreign:
        yield path
        return
    with TemporaryDirectory(prefix="flexarm_bag_") as folder:
        copy = Path(folder, path.name)
        if not _copied(path, copy, foreign):
            listed = ", ".join(f"{topic} ({encoding})" for topic, encoding in foreign.items())
            raise BagError(
                f"has no messages of ROS 2, but {listed}: record the topics with `ros2 bag "
                "record`, or export the numbers as CSV and identify that file"
            )
        yield copy


def _copied(path: Path, copy: Path, foreign: dict[str, str]) -> int:
    """Copy the messages of all other topics; return their number."""
    allowed = left = unpacked_bytes_allowed(path.stat().st_size)
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    count = 0
    with path.open("rb") as source, copy.open("wb") as target:
        writer = Writer(target)
        writer.start("ros2", "flexarm")
        for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
            if channel.topic in foreign or schema is None:
                continue
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            left -= len(message.data)
            if left < 0:
                raise BoundError(too_much(allowed))
            writer.add_message(
                channels[channel.id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
            count += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return count
