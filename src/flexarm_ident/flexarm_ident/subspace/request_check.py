"""Check of a request against its records before any computation."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import DataError, IdentificationError
from flexarm_ident.records.signals import check_magnitude
from flexarm_ident.subspace.gram import stretches
from flexarm_ident.subspace.methods import AUTO, METHODS, check_method

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source

BLOCK_ROWS = 40
"""Block rows q of (2-18), unless the records are too short for as many."""
_FEWEST_CHOSEN_ROWS = 8
_SMALLEST_BLOCK_ROWS = 2
_MAY_BE_OPEN = "feedthrough"
# Decompositions of larger matrices take minutes and gigabytes.
_LARGEST_MATRIX = 4000
_CHUNK, _SLICE = 16384, 512


def suitable_block_rows(records: Sequence[Source], order: int | None, method: str) -> int:
    """Return `BLOCK_ROWS`, more for a higher order, and fewer where the records are too short.

    Parameters
    ----------
    records : sequence of Source
        Records of one rig.
    order : int or None
        Number of states; None if it is chosen later.
    method : str
        'auto' or a name in `METHODS`.

    Raises
    ------
    IdentificationError
        If there is no such method.
    """
    check_method(method)
    wanted = max(BLOCK_ROWS, 0 if order is None else order + 1)
    allowed = _largest_block_rows(records, method, wanted)
    return min(wanted, max(allowed, _FEWEST_CHOSEN_ROWS))


def check_request(
    records: Sequence[Source], order: int | None, block_rows: int, method: str
) -> None:
    """Check method, block rows and order, the records' lengths and the variation of their inputs.

    Parameters
    ----------
    records : sequence of Source
        Records of one rig.
    order : int or None
        Number of states; None if it is chosen later.
    block_rows : int
        Block rows q of (2-18).
    method : str
        'auto' or a name in `METHODS`.

    Raises
    ------
    IdentificationError
        If method, order or block rows are out of range, or their matrices too large.
    DataError
        If the records together are too short or an input is constant.
    """
    check_method(method)
    if block_rows < _SMALLEST_BLOCK_ROWS:
        raise IdentificationError(f"block_rows must be 2 or more: {block_rows}")
    if order is not None:
        _check_order(records, order, block_rows, method)
    _check_length(records, block_rows, method)
    _check_size(records[0], block_rows, method)
    constant = np.all([_constant_inputs(record) for record in records], axis=0)
    for name, is_constant in zip(records[0].inputs, constant, strict=True):
        if is_constant:
            raise DataError(
                f"{records[0].label}: input {name} is constant in {_extent(records)}, it excites "
                f"nothing: record with a changing input{_longer_part(records)}"
            )


def check_types(data: object, order: object, switches: Mapping[str, object]) -> None:
    """Check what a notebook may get wrong without a type checker.

    Parameters
    ----------
    data : object
        What shall be records.
    order : object
        What shall be the number of states, or None.
    switches : mapping of str to object
        What shall be true or false by their names; only `feedthrough` may be None.

    Raises
    ------
    DataError
        If something is not a record.
    IdentificationError
        If the order is not an integer, or a switch neither true nor false.
    """
    each = data if isinstance(data, Sequence) and not isinstance(data, str) else [data]
    for record in each:
        if not hasattr(record, "chunks"):
            raise DataError(
                f"identify takes records, and no {type(record).__name__}: make one of arrays by "
                "IoData(u, y, dt_s=..., inputs=..., outputs=...), of a table by from_columns"
            )
    if order is not None and (isinstance(order, bool) or not isinstance(order, Integral)):
        raise IdentificationError(f"order must be an integer or None, got {order!r}")
    for name, value in switches.items():
        is_open = value is None and name == _MAY_BE_OPEN
        if not isinstance(value, bool | np.bool_) and not is_open:
            words = "True, False or None (as the records call for)" if name == _MAY_BE_OPEN else ""
            raise IdentificationError(f"{name} must be {words or 'True or False'}, got {value!r}")


def check_channels(records: Sequence[IoData]) -> None:
    """Check that the channels of records can be computed with, and that an output changes.

    Raises
    ------
    DataError
        If a channel's values are too far from 1, or all outputs are constant in all records.
    """
    for record in records:
        check_magnitude(record)
    if all(_constant(_slices(record.y)).all() for record in records):
        names = ", ".join(records[0].outputs)
        raise DataError(
            f"{records[0].label}: no output changes ({names}), there is nothing to identify: "
            "record a rig that moves"
        )


def _check_size(record: Source, block_rows: int, method: str) -> None:
    channels = len(record.outputs) + len(record.inputs)
    shifts = _shifts(method, block_rows)
    if shifts * channels > _LARGEST_MATRIX:
        most = _LARGEST_MATRIX // channels * block_rows // shifts
        raise IdentificationError(
            f"{record.label}: block_rows = {block_rows}, which is more than the order, makes "
            f"matrices of {shifts * channels} rows for {channels} channels: {most} at most, lower "
            "the order or block_rows"
        )


def _check_length(records: Sequence[Source], block_rows: int, method: str) -> None:
    shifts = _shifts(method, block_rows)
    past = f" ({shifts} with those of the past)" if shifts > block_rows else ""
    remedy = f"record longer or lower block_rows{_longer_part(records)}"
    for record in records:
        if len(record) < shifts:
            raise DataError(
                f"{record.label}: {_extent([record])} are too few, block_rows = {block_rows}{past} "
                f"needs at least {shifts} of each record: {remedy}"
            )
    needed = shifts * _samples_a_shift(records[0])
    usable = sum(_usable(record, needed) for record in records)
    if usable < needed:
        samples = sum(map(len, records))
        holes = "" if usable == samples else f", {usable} of them outside of holes,"
        raise DataError(
            f"{records[0].label}: {_extent(records)}{holes} are too few, "
            f"block_rows = {block_rows}{past} needs at least {needed}: {remedy}"
        )


def _extent(records: Sequence[Source]) -> str:
    """Return the number of samples of some records, and of what they are the leading parts."""
    samples = sum(map(len, records))
    whole = sum(record.whole_samples for record in records)
    return f"{samples} samples" if samples == whole else f"the leading {samples} of {whole} samples"


def _longer_part(records: Sequence[Source]) -> str:
    is_part = any(len(record) < record.whole_samples for record in records)
    return ", or fit a longer part (train_fraction)" if is_part else ""


def _shifts(method: str, block_rows: int) -> int:
    """Return the block rows of the Gram, for 'auto' the largest number of any method."""
    rows = METHODS.values() if method == AUTO else [METHODS[method]]
    return max(row.shifts(block_rows) for row in rows)


def _samples_a_shift(record: Source) -> int:
    return len(record.inputs) + len(record.outputs) + 1


def _check_order(records: Sequence[Source], order: int, block_rows: int, method: str) -> None:
    if 1 <= order < block_rows:
        return
    message = (
        f"order must lie between 1 and {block_rows - 1} for block_rows = {block_rows}: {order}"
    )
    if order >= block_rows:
        allowed = _largest_block_rows(records, method, order + 1)
        message += (
            f"; block_rows = {order + 1} would do"
            if order < allowed
            else f"; {records[0].label}: {_extent(records)} allow block_rows of at most {allowed}: "
            f"record longer or lower the order{_longer_part(records)}"
        )
    raise IdentificationError(message)


def _largest_block_rows(records: Sequence[Source], method: str, wanted: int) -> int:
    """Return the block rows that the records suffice for, see `_check_length`; `wanted` or more."""
    a_shift = _samples_a_shift(records[0])
    needed = wanted * _shifts(method, 1) * a_shift
    usable = sum(_usable(record, needed) for record in records)
    return min(usable // a_shift, *map(len, records)) // _shifts(method, 1)


def _usable(record: Source, needed: int) -> int:
    """Return the number of samples outside long holes; stop counting at `needed`."""
    usable = 0
    for _, y in record.chunks(_CHUNK):
        usable += sum(rows.stop - rows.start for rows in stretches(y))
        if usable >= needed:
            break
    return usable


def _constant_inputs(record: Source) -> NDArray[np.bool_]:
    """Return which inputs never change."""
    return _constant(u for u, _ in record.chunks(_CHUNK))


def _slices(signals: FloatArray) -> Iterator[FloatArray]:
    """Yield the rows of (samples, channels) in short pieces: most signals change in the first."""
    return (signals[first : first + _SLICE] for first in range(0, len(signals), _SLICE))


def _constant(chunks: Iterator[FloatArray]) -> NDArray[np.bool_]:
    """Return which columns of chunks, (samples, channels), never change; stop once all have."""
    first = next(chunks)
    start = first[0]
    constant = np.all(first == start, axis=0)
    while constant.any() and (chunk := next(chunks, None)) is not None:
        constant &= np.all(chunk == start, axis=0)
    return np.asarray(constant)
