"""Bytes of a message type by one precompiled `struct` (CDR, XCDR version 1).

rclpy makes a Python object of every message and of every message in it, which takes longer than
the transport of a sample. Where the texts of a message do not change, all its numbers have fixed
places. These follow from the message class. Every number is aligned to its own size, counted from
behind the encapsulation.
"""

from __future__ import annotations

from collections import namedtuple
from importlib import import_module
from operator import attrgetter
from struct import Struct, calcsize
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

Numbers: TypeAlias = Any
"""The numbers of a message as a NamedTuple, by their paths with an underscore for each dot, such as
``header_stamp_sec``: the message class says them, and no type."""
_LITTLE_ENDIAN: Final = b"\0\1"
_BIG_ENDIAN: Final = b"\0\0"
ENCAPSULATION: Final = _LITTLE_ENDIAN + b"\0\0"
"""Begin of the bytes of every message that is written."""
_TEXT: Final = "string"
_COUNT: Final = "I"
_CODES: Final = {
    "boolean": "?",
    "int8": "b",
    "uint8": "B",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float": "f",
    "double": "d",
}


class _Count(NamedTuple):
    """Length of a text or an array in all messages, and the number of numbers before it."""

    place: int
    length: int
    content: tuple[bytes, ...] = ()


class Layout:
    """Layout of one message type with constant texts and arrays of constant lengths.

    Parameters
    ----------
    message_type : type
        Class of the messages. It may hold numbers, texts, arrays of numbers, and other messages of
        such members.
    texts : mapping of str to str
        Content of each text by its path, ``header.frame_id``.
    lengths : mapping of str to int, optional
        Length of each array by its path. Its numbers are named with their places, ``inputs_0``.

    Attributes
    ----------
    message_type : type
        Class of the messages.

    Raises
    ------
    TypeError
        When a member has no fixed size.
    KeyError
        When a text has no content, or an array no length.
    """

    def __init__(
        self,
        message_type: type,
        texts: Mapping[str, str],
        lengths: Mapping[str, int] | None = None,
    ) -> None:
        self.message_type = message_type
        self._counts: list[_Count] = []
        self._members: list[tuple[str, int | None]] = []
        names: list[str] = []
        # Behind the encapsulation.
        packed = unpacked = ""
        size = 0
        for name, kind in _members(message_type):
            element = _element(kind)
            code = _COUNT if kind == _TEXT or element else _CODES[kind]
            code = f"{-size % calcsize('=' + code)}x{code}"
            packed += code
            unpacked += code
            if kind == _TEXT:
                content = texts[name].encode() + b"\0"
                self._counts.append(_Count(len(names), len(content), (content,)))
                packed += f"{len(content)}s"
                unpacked += f"{len(content)}x"
            elif element:
                length = (lengths or {})[name]
                self._counts.append(_Count(len(names), length))
                self._members.append((name, length))
                names += [f"{name}_{place}" for place in range(length)]
                size = calcsize("=" + packed)
                # An array without elements ends with its count.
                gap = -size % calcsize("=" + element) if length else 0
                packed += f"{gap}x{element * length}"
                unpacked += f"{gap}x{element * length}"
            else:
                self._members.append((name, None))
                names.append(name)
            size = calcsize("=" + packed)
        self._packing = Struct(f"<4s{packed}")
        self._unpackings = {
            _LITTLE_ENDIAN: Struct(f"<4x{unpacked}"),
            _BIG_ENDIAN: Struct(f">4x{unpacked}"),
        }
        named = [name.replace(".", "_") for name in names]
        self._values: Any = namedtuple(message_type.__name__, named)  # type: ignore[misc] # noqa: PYI024 - the message says the names

    def pack(self, *numbers: float) -> bytes:
        """Return the bytes of a message by its numbers, in the order of the definition."""
        values: list[float | bytes] = [*numbers]
        for place, length, content in reversed(self._counts):
            values[place:place] = length, *content
        return self._packing.pack(ENCAPSULATION, *values)

    def unpack(self, raw: bytes) -> Numbers | None:
        """Return the numbers of a message, little or big endian; None for another layout."""
        unpacking = self._unpackings.get(raw[:2])
        if unpacking is None or len(raw) != unpacking.size:
            return None
        found = unpacking.unpack(raw)
        for place, length, _ in self._counts:
            if found[place] != length:
                return None
            found = found[:place] + found[place + 1 :]
        return self._values._make(found)

    def numbers(self, message: object) -> Numbers | None:
        """Return the numbers of a message object; None when an array has another length."""
        found: list[float] = []
        for name, length in self._members:
            value = attrgetter(name)(message)
            if length is None:
                found.append(value)
            elif len(value) != length:
                return None
            else:
                found.extend(value)
        return self._values._make(found)


def _members(message_type: Any, prefix: str = "") -> Iterator[tuple[str, str]]:  # noqa: ANN401
    """Yield path and type of every number and text, in the order of their bytes."""
    for name, kind in message_type.get_fields_and_field_types().items():
        if kind in _CODES or kind == _TEXT or _element(kind):
            yield prefix + name, kind
            continue
        package, slash, member = kind.partition("/")
        if not slash or not member.isidentifier():
            raise TypeError(f"{message_type.__name__}.{name}: {kind} has no fixed layout")
        inner = getattr(import_module(f"{package}.msg"), member)
        yield from _members(inner, f"{prefix}{name}.")


def _element(kind: str) -> str:
    """Return the code of an array's elements; empty for what is not an array of numbers."""
    return _CODES.get(kind.removeprefix("sequence<").removesuffix(">"), "") * kind.startswith(
        "sequence<"
    )
