"""What an identification is asked for, checked against its records before any work."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.errors import DataError, IdentificationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_ident.source import Source

METHODS = ("orse", "orse_iv", "pbsid", "orse_thesis")
_SMALLEST_BLOCK_ROWS = 2
_CHUNK = 16384


def shifts(method: str, block_rows: int) -> int:
    """Return the block rows that a method needs: as many again where it looks at the past."""
    return block_rows if method in {"orse", "orse_thesis"} else 2 * block_rows


def check_request(
    records: Sequence[Source], order: int | None, block_rows: int, method: str
) -> None:
    """Check method, block rows and order, the records' lengths and that their inputs change.

    Parameters
    ----------
    records : sequence of Source
        Records of one rig.
    order : int or None
        Number of states; None: chosen later.
    block_rows : int
        Block rows q of (2-18).
    method : str
        'auto' or one of `METHODS`.

    Raises
    ------
    IdentificationError
        If the request makes no sense.
    DataError
        If a record is too short or an input excites nothing.
    """
    if method not in ("auto", *METHODS):
        raise IdentificationError(f"method must be one of auto, {', '.join(METHODS)}: {method!r}")
    if block_rows < _SMALLEST_BLOCK_ROWS:
        raise IdentificationError(f"block_rows must be 2 or more: {block_rows}")
    first = records[0]
    outputs = len(first.outputs)
    largest = min(block_rows - 1, (block_rows - 1) * outputs)
    if order is not None and not 1 <= order <= largest:
        raise IdentificationError(
            f"order must lie between 1 and {largest} for block_rows = {block_rows}: {order}"
        )
    needed = shifts(method, block_rows) * (len(first.inputs) + outputs + 1)
    for record in records:
        if len(record) < needed:
            raise DataError(
                f"{record.label}: {len(record)} samples are too few, {block_rows} block rows need "
                f"at least {needed}: record longer or lower block_rows"
            )
    constant = np.all([_constant_inputs(record) for record in records], axis=0)
    for name, is_constant in zip(first.inputs, constant, strict=True):
        if is_constant:
            raise DataError(
                f"{first.label}: input {name} is constant, it excites nothing: "
                "record with a changing input"
            )


def _constant_inputs(record: Source) -> NDArray[np.bool_]:
    """Return which inputs never change; reads no further than it must."""
    start, constant = None, np.ones(len(record.inputs), dtype=np.bool_)
    for u, _ in record.chunks(_CHUNK):
        start = u[0] if start is None else start
        constant &= ~np.any(u != start, axis=0)
        if not constant.any():
            break
    return constant
