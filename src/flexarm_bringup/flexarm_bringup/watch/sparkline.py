"""Sparkline of bands in Braille dots: two columns and four levels a character."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexarm_bringup.watch.history import Band

if TYPE_CHECKING:
    from collections.abc import Sequence

COLUMNS_A_CHARACTER = 2
_LEVELS = 4
_BLANK = 0x2800
# The bits of a character, by its column and from the top.
_DOTS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))


def span(bands: Sequence[Band], least: float) -> Band:
    """Return the range of bands, at least so wide about its middle; around 0 without any."""
    known = [band for band in bands if not math.isnan(band.low)]
    low = min((band.low for band in known), default=0.0)
    high = max((band.high for band in known), default=0.0)
    lacking = max(0.0, least - (high - low)) / 2.0
    return Band(low - lacking, high + lacking)


def sparkline(bands: Sequence[Band], scale: Band, rows: int) -> list[str]:
    """Return lines of text, the upper one first, with every level dotted that a band passes.

    Parameters
    ----------
    bands : sequence of Band
        Two a character, oldest first.
    scale : Band
        Values of the lowest and of the highest level.
    rows : int
        How many lines.
    """
    top = _LEVELS * rows - 1

    def depth(value: float) -> int:
        """Return the level of a value, counted from the top."""
        part = (value - scale.low) / (scale.high - scale.low)
        return round(top * (1.0 - min(1.0, max(0.0, part))))

    width = -(-len(bands) // COLUMNS_A_CHARACTER)
    cells = [[_BLANK] * width for _ in range(rows)]
    for column, band in enumerate(bands):
        if math.isnan(band.low):
            continue
        place, side = divmod(column, COLUMNS_A_CHARACTER)
        for level in range(depth(band.high), depth(band.low) + 1):
            cells[level // _LEVELS][place] |= _DOTS[side][level % _LEVELS]
    return ["".join(map(chr, row)) for row in cells]
