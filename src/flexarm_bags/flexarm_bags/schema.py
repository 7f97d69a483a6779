"""Message definitions without a ROS installation: text, type hash and CDR of a message type.

The common interfaces come with *rosbags*; the project's own types are read from their ``.msg``
files, in the source tree or in the installed share folder.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from rosbags.interfaces.typing import Typesdict
    from rosbags.typesys.store import Typestore


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


def load_typestore(packages: Mapping[str, Path]) -> Typestore:
    """Return a store of the Jazzy types together with the messages of further packages.

    Parameters
    ----------
    packages : mapping of str to Path
        Package name -> its folder (source or share) that holds ``msg/*.msg``.

    Raises
    ------
    DefinitionError
        If a folder holds no ``.msg`` file or a file is not a valid definition.
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


def _parse(file: Path, type_name: str) -> Typesdict:
    try:
        return get_types_from_msg(file.read_text("utf-8"), type_name)
    except (TypesysError, OSError, UnicodeDecodeError) as error:
        raise DefinitionError(f"{file}: no message definition: {error}") from error


def describe(typestore: Typestore, type_name: str) -> MessageDefinition:
    """Return the definition of one type, ``package/msg/Type``, with all nested types.

    Raises
    ------
    DefinitionError
        If the store does not know the type or one that it contains.
    """
    try:
        text, _ = typestore.generate_msgdef(type_name, ros_version=2)
        return MessageDefinition(type_name, text, typestore.hash_rihs01(type_name))
    except (TypesysError, KeyError) as error:
        raise DefinitionError(
            f"message type {type_name} is unknown; give the folder of its package"
        ) from error
