"""Columns of serialised messages of one type: CDR (XCDR version 1, little endian) in numpy.

The layout follows the definition that the bag carries, so this module depends on no message type.
Every member is aligned to its own size, counted from behind the 4 bytes of encapsulation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rosbags.interfaces.typing import FieldDesc, Typesdict

ByteRows = NDArray[np.uint8]
# Any of the primitive types, as the definition says.
Column = NDArray[np.generic]

ENCAPSULATION = 4
# Types that contain each other twice double at each level.
_MOST_MEMBERS = 10_000
# A middleware may pad the end of a message; more than this is another layout.
_LONGEST_PADDING = 8
_ZSTD = bytes.fromhex("28b52ffd")
_DTYPES = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "<i2",
    "uint16": "<u2",
    "int32": "<i4",
    "uint32": "<u4",
    "int64": "<i8",
    "uint64": "<u8",
    "float32": "<f4",
    "float64": "<f8",
}
_COUNT = np.dtype("<u4")


class CdrError(FlexarmError):
    """Bytes that do not follow the definition, or a definition that has no columns."""


class _DifferentLengths(Exception):  # noqa: N818 - a branch of the decoding, not an error
    """A string or sequence has another length in other rows."""

    def __init__(self, lengths: NDArray[np.int64]) -> None:
        super().__init__()
        self.lengths = lengths


@dataclass(frozen=True)
class Member:
    """One member of a message; nested messages are flattened, arrays of them are not.

    Attributes
    ----------
    name : str
        Path with dots, ``header.stamp.sec``.
    dtype : dtype or None
        Type of one element; None for texts and messages.
    length : int or None
        Elements of a fixed array, 1 for a scalar; None when each message has its own length.
    scalar : bool
        True when the column has no second axis.
    parts : tuple of Member
        Members of each element of an array of messages.
    """

    name: str
    dtype: np.dtype[np.generic] | None
    length: int | None
    scalar: bool
    parts: tuple[Member, ...] = ()

    @property
    def is_list(self) -> bool:
        """True for an array of texts or messages, whose elements have columns of their own."""
        return self.dtype is None and not self.scalar


def members(type_name: str, definitions: Typesdict) -> tuple[Member, ...]:
    """Return the members of a type, ``package/msg/Type``, in the order of their bytes.

    Raises
    ------
    CdrError
        If the type, or one that it contains, is unknown or without end.
    """
    if type_name not in definitions:
        raise CdrError(f"no definition of {type_name} in the bag; a bag recorded as MCAP has it")
    flat: list[Member] = []
    for name, description in definitions[type_name][1]:
        flat.extend(_spread(name, description, definitions))
        if len(flat) > _MOST_MEMBERS:
            raise CdrError(f"{type_name} has more than {_MOST_MEMBERS} members")
    return tuple(flat)


def _spread(name: str, description: FieldDesc, definitions: Typesdict) -> Iterator[Member]:
    if description[0] == Nodetype.NAME:
        for member in members(str(description[1]), definitions):
            yield replace(member, name=f"{name}.{member.name}")
        return
    if description[0] == Nodetype.BASE:
        yield Member(name, _dtype(name, str(description[1][0])), 1, scalar=True)
        return
    element, bound = description[1]
    length = int(bound) if description[0] == Nodetype.ARRAY else None
    if element[0] == Nodetype.NAME:
        parts = members(str(element[1]), definitions)
        yield Member(name, None, length, scalar=False, parts=parts)
    else:
        yield Member(name, _dtype(name, str(element[1][0])), length, scalar=False)


def _dtype(name: str, base: str) -> np.dtype[np.generic] | None:
    if base == "string":
        return None
    if base not in _DTYPES:
        raise CdrError(f"member {name} has the unsupported type {base}")
    return np.dtype(_DTYPES[base])


def decode(
    groups: Sequence[tuple[NDArray[np.intp], ByteRows]], layout: Sequence[Member]
) -> dict[str, Column]:
    """Return the columns of messages that come in groups of equal size.

    Parameters
    ----------
    groups : sequence of (ndarray of int, (n,), ndarray of uint8, (n, size))
        Message numbers and bytes; together the numbers are 0 .. N-1.
    layout : sequence of Member
        Members of the type, from `members`.

    Returns
    -------
    dict of str to ndarray
        Member name -> (N,), or (N, length) for arrays and sequences. Texts are left out, and so
        are arrays of texts or messages.

    Raises
    ------
    CdrError
        If bytes do not fit the layout or a sequence has differing lengths.
    """
    wanted = [member.name for member in layout if member.dtype is not None]
    return _merge(
        [
            (numbers, {name: columns[name] for name in wanted})
            for numbers, columns in alike(groups, layout)
        ]
    )


def alike(
    groups: Sequence[tuple[NDArray[np.intp], ByteRows]], layout: Sequence[Member]
) -> Iterator[tuple[NDArray[np.intp], dict[str, Column]]]:
    """Yield messages whose texts and sequences have the same lengths, with their columns.

    Parameters
    ----------
    groups, layout
        As in `decode`.

    Yields
    ------
    tuple of ndarray of int, (n,), and dict of str to ndarray
        Message numbers and their columns. An array of texts or messages has columns for each of
        its elements, ``name[0]`` and ``transforms[0].transform.translation.x``; texts are bytes.

    Raises
    ------
    CdrError
        If bytes do not fit the layout.
    """
    for numbers, rows in groups:
        yield from _alike(numbers, rows, layout)


def _alike(
    numbers: NDArray[np.intp], rows: ByteRows, layout: Sequence[Member]
) -> Iterator[tuple[NDArray[np.intp], dict[str, Column]]]:
    try:
        columns = _decode_alike(rows, layout)
    except _DifferentLengths as difference:
        for length in np.unique(difference.lengths):
            here = difference.lengths == length
            yield from _alike(numbers[here], rows[here], layout)
    else:
        yield numbers, columns


def _decode_alike(rows: ByteRows, layout: Sequence[Member]) -> dict[str, Column]:
    """Decode rows in which every text and sequence has one length."""
    if bytes(rows[0, : len(_ZSTD)]) == _ZSTD:
        raise CdrError("the messages are compressed, as metadata.yaml says: read its folder")
    if rows.shape[1] < ENCAPSULATION or not np.all(rows[:, :2] == (0, 1)):
        raise CdrError("a message is not little-endian CDR")
    cursor = _Cursor(rows[:, ENCAPSULATION:])
    cursor.read(layout)
    if not 0 <= cursor.body.shape[1] - cursor.position <= _LONGEST_PADDING:
        raise CdrError(
            f"a message of {rows.shape[1]} bytes, but its definition has "
            f"{cursor.position + ENCAPSULATION}"
        )
    return cursor.columns


class _Cursor:
    """Place in messages that are alike, and the columns before it."""

    def __init__(self, body: ByteRows) -> None:
        self.body = body
        self.position = 0
        self.columns: dict[str, Column] = {}

    def read(self, layout: Sequence[Member], prefix: str = "") -> None:
        for member in layout:
            name = prefix + member.name
            if member.scalar:
                self.columns[name] = (
                    self._text() if member.dtype is None else self._values(member.dtype, 1)[:, 0]
                )
                continue
            length = self._count() if member.length is None else member.length
            if member.dtype is not None:
                self.columns[name] = self._values(member.dtype, length)
                continue
            for element in (f"{name}[{index}]" for index in range(length)):
                if member.parts:
                    self.read(member.parts, f"{element}.")
                else:
                    self.columns[element] = self._text()

    def _text(self) -> Column:
        length = self._count()
        if not length:
            return np.zeros(len(self.body), "S1")
        # The zero at its end counts; numpy leaves it out.
        return self._values(np.dtype("u1"), length).view(f"S{length}")[:, 0]

    def _count(self) -> int:
        lengths = self._values(_COUNT, 1)[:, 0]
        if np.any(lengths != lengths[0]):
            raise _DifferentLengths(lengths.astype(np.int64))
        return int(lengths[0])

    def _values(self, dtype: np.dtype[np.generic], length: int) -> Column:
        if not length:
            return np.empty((len(self.body), 0), dtype)
        start = -(-self.position // dtype.itemsize) * dtype.itemsize
        self.position = start + length * dtype.itemsize
        if self.position > self.body.shape[1]:
            raise CdrError(
                f"a message of {self.body.shape[1] + ENCAPSULATION} bytes is too short for its "
                "definition"
            )
        return self.body[:, start : self.position].view(dtype)


def _merge(parts: Sequence[tuple[NDArray[np.intp], dict[str, Column]]]) -> dict[str, Column]:
    if len(parts) == 1 and np.array_equal(parts[0][0], np.arange(len(parts[0][0]))):
        return parts[0][1]
    total = sum(len(numbers) for numbers, _ in parts)
    merged: dict[str, Column] = {}
    for name, column in parts[0][1].items():
        merged[name] = np.empty((total, *column.shape[1:]), column.dtype)
        for numbers, columns in parts:
            if columns[name].shape[1:] != column.shape[1:]:
                raise CdrError(
                    f"member {name} has {column.shape[1]} values in message {parts[0][0][0]}"
                    f" and {columns[name].shape[1]} in message {numbers[0]}"
                )
            merged[name][numbers] = columns[name]
    return merged
