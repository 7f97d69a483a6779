"""Pointer of a filmed hand: where it is at each instant, and how it is drawn."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from PIL import Image, ImageDraw

if TYPE_CHECKING:
    from collections.abc import Sequence

_ARROW = ((0, 0), (0, 17), (4, 13.5), (7, 20), (9.6, 18.8), (6.8, 12.5), (12, 12))
"""Outline of the pointer, in pixels right of and below its tip."""
_INK, _PAPER, _TOUCH = (20, 32, 43, 255), (255, 255, 255, 255), (11, 110, 131, 90)
_TOUCH_RADIUS = 13
# Drawn larger and made smaller, for smooth edges.
_FINER = 4


class Place(NamedTuple):
    """Place of the pointer at an instant; `pressed` from there on."""

    time_s: float
    x: float
    y: float
    pressed: bool = False


def at(path: Sequence[Place], time_s: float) -> tuple[float, float]:
    """Return where the pointer is; between two places it speeds up and slows down."""
    times_s = [place.time_s for place in path]
    number = int(np.clip(np.searchsorted(times_s, time_s, "right") - 1, 0, len(path) - 2))
    before, after = path[number], path[number + 1]
    part = np.clip((time_s - before.time_s) / (after.time_s - before.time_s), 0.0, 1.0)
    eased = part * part * (3.0 - 2.0 * part)
    return (
        float(before.x + eased * (after.x - before.x)),
        float(before.y + eased * (after.y - before.y)),
    )


def turns(path: Sequence[Place], from_s: float, to_s: float) -> list[Place]:
    """Return the places after one instant and up to another in which the button changes."""
    return [
        place
        for before, place in pairwise(path)
        if from_s < place.time_s <= to_s and place.pressed != before.pressed
    ]


def drawn(picture: Image.Image, x: float, y: float, *, pressed: bool) -> Image.Image:
    """Return the picture with the pointer; a disc around its tip tells that the button is down."""
    layer = Image.new("RGBA", (_FINER * picture.width, _FINER * picture.height))
    draw = ImageDraw.Draw(layer)
    if pressed:
        draw.circle((_FINER * x, _FINER * y), _FINER * _TOUCH_RADIUS, fill=_TOUCH)
    outline = [(_FINER * (x + right), _FINER * (y + down)) for right, down in _ARROW]
    draw.polygon(outline, fill=_INK, outline=_PAPER, width=_FINER)
    small = layer.resize(picture.size, Image.Resampling.LANCZOS)
    return Image.alpha_composite(picture.convert("RGBA"), small).convert("RGB")
