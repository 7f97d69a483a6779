"""Columns of serialised messages of one type: CDR (XCDR version 1, little endian) in numpy.

The layout follows the definition that the bag carries, so this module depends on no message type.
Every member is aligned to its own size, counted from behind the 4 bytes of encapsulation.
"""

from __future__ import annotations

from dataclasses import dataclass
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
# A middleware may pad the end of a message; more than this is another layout.
_LONGEST_PADDING = 8
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
    """One primitive member of a message; nested messages are flattened.

    Attributes
    ----------
    name : str
        Path with dots, ``header.stamp.sec``.
    dtype : dtype or None
        Type of one element; None for a string, which has no column.
    length : int or None
        Elements of a fixed array, 1 for a scalar; None when each message has its own length.
    scalar : bool
        True when the column has no second axis.
    """

    name: str
    dtype: np.dtype[np.generic] | None
    length: int | None
    scalar: bool


def members(type_name: str, definitions: Typesdict) -> tuple[Member, ...]:
    """Return the members of a type, ``package/msg/Type``, in the order of their bytes.

    Raises
    ------
    CdrError
        If the type is unknown or holds sequences of strings or messages, which make no columns.
    """
    if type_name not in definitions:
        raise CdrError(f"no definition of {type_name}")
    flat: list[Member] = []
    for name, description in definitions[type_name][1]:
        flat.extend(_spread(name, description, definitions))
    return tuple(flat)


def _spread(name: str, description: FieldDesc, definitions: Typesdict) -> Iterator[Member]:
    if description[0] == Nodetype.NAME:
        for member in members(str(description[1]), definitions):
            yield Member(f"{name}.{member.name}", member.dtype, member.length, member.scalar)
        return
    if description[0] == Nodetype.BASE:
        base = description[1][0]
        length = None if base == "string" else 1
        yield Member(name, _dtype(name, str(base)), length, scalar=True)
        return
    element, bound = description[1]
    if element[0] != Nodetype.BASE or element[1][0] == "string":
        raise CdrError(f"member {name} is an array of strings or messages and makes no column")
    length = int(bound) if description[0] == Nodetype.ARRAY else None
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
        Member name -> (N,), or (N, length) for arrays and sequences. Strings are left out.

    Raises
    ------
    CdrError
        If bytes do not fit the layout or a sequence has differing lengths.
    """
    return _merge([(numbers, _decode_rows(rows, layout)) for numbers, rows in groups])


def _decode_rows(rows: ByteRows, layout: Sequence[Member]) -> dict[str, Column]:
    try:
        return _decode_alike(rows, layout)
    except _DifferentLengths as difference:
        lengths = difference.lengths
    parts = []
    for length in np.unique(lengths):
        numbers = np.flatnonzero(lengths == length)
        parts.append((numbers, _decode_rows(rows[numbers], layout)))
    return _merge(parts)


def _decode_alike(rows: ByteRows, layout: Sequence[Member]) -> dict[str, Column]:
    """Decode rows in which every string and sequence has one length."""
    if rows.shape[1] < ENCAPSULATION or not np.all(rows[:, :2] == (0, 1)):
        raise CdrError("a message is not little-endian CDR")
    body = rows[:, ENCAPSULATION:]
    columns: dict[str, Column] = {}
    position = 0
    for member in layout:
        length = member.length
        if length is None:
            lengths, position = _take(body, position, _COUNT, 1)
            if np.any(lengths != lengths[0]):
                raise _DifferentLengths(lengths[:, 0].astype(np.int64))
            length = int(lengths[0, 0])
        if member.dtype is None:
            position += length
        elif length:
            values, position = _take(body, position, member.dtype, length)
            columns[member.name] = values[:, 0] if member.scalar else values
        else:
            columns[member.name] = np.empty((len(rows), 0), member.dtype)
    if not 0 <= body.shape[1] - position <= _LONGEST_PADDING:
        raise CdrError(
            f"a message of {rows.shape[1]} bytes, but its definition has {position + ENCAPSULATION}"
        )
    return columns


def _take(
    body: ByteRows, position: int, dtype: np.dtype[np.generic], length: int
) -> tuple[Column, int]:
    start = -(-position // dtype.itemsize) * dtype.itemsize
    end = start + length * dtype.itemsize
    if end > body.shape[1]:
        raise CdrError(
            f"a message of {body.shape[1] + ENCAPSULATION} bytes is too short for its definition"
        )
    return body[:, start:end].view(dtype), end


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
