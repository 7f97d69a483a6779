"""Animated picture: shots of a screen on the instants of its frames, in a file of limited size."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from PIL.Image import Dither
from PIL.Image import new as new_picture

from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from PIL.Image import Image

_MOST_STILL_FRAMES = 2
"""A shot may stand for its frame and so many after it."""


_PALETTES = (128, 96, 64, 48, 40, 32, 24, 16)
_LOOKED_AT = 5
"""So many pictures of the film are looked at for the palette."""


class FilmError(FlexarmError):
    """The shots make no film, or none that is small enough."""


class Shot(NamedTuple):
    """Picture of the screen.

    Attributes
    ----------
    time_s : float
        Its instant in the film.
    png : bytes
        The picture.
    pointer : tuple of float
        Where the pointer was in the window.
    pressed : bool
        Whether its button was.
    """

    time_s: float
    png: bytes
    pointer: tuple[float, float]
    pressed: bool


def frames_of(shots: Sequence[Shot], length_s: float, rate_hz: float) -> list[Shot]:
    """Return the shot nearest to each frame of a film that begins at 0.

    Raises
    ------
    FilmError
        When one shot would stand for too many frames.
    """
    times_s = np.arange(round(length_s * rate_hz)) / rate_hz
    taken_s = np.array([shot.time_s for shot in shots])
    nearest = np.abs(times_s[:, None] - taken_s).argmin(axis=1)
    still = np.bincount(nearest).max()
    if still > 1 + _MOST_STILL_FRAMES:
        raise FilmError(
            f"one shot would stand for {still} frames: film more slowly, with a smaller --pace"
        )
    return [shots[number] for number in nearest]


def durations_ms(frames: int, rate_hz: float) -> list[int]:
    """Return whole milliseconds for each frame, which add up to the length of the film."""
    ends_ms = np.rint(1e3 * np.arange(frames + 1) / rate_hz).astype(int)
    return [int(each) for each in np.diff(ends_ms)]


def encoded(
    pictures: Sequence[Image],
    rate_hz: float,
    most_bytes: int,
    palettes: Iterable[int] = _PALETTES,
) -> tuple[bytes, int]:
    """Return a lossless WebP that repeats, with the first palette that makes it small enough.

    The second value is the number of colours.

    Raises
    ------
    FilmError
        When every palette makes it too large.
    """
    looked_at = pictures[:: max(1, len(pictures) // _LOOKED_AT)]
    width, height = pictures[0].size
    several = new_picture("RGB", (width, height * len(looked_at)))
    for number, picture in enumerate(looked_at):
        several.paste(picture, (0, number * height))
    sizes = []
    for colours in palettes:
        palette = several.quantize(colours, dither=Dither.NONE)
        first, *others = (
            picture.quantize(palette=palette, dither=Dither.NONE).convert("RGB")
            for picture in pictures
        )
        file = BytesIO()
        first.save(
            file,
            "WEBP",
            save_all=True,
            append_images=others,
            duration=durations_ms(len(pictures), rate_hz),
            loop=0,
            lossless=True,
            quality=100,
            method=4,
        )
        sizes.append(len(file.getvalue()))
        if sizes[-1] <= most_bytes:
            return file.getvalue(), colours
    raise FilmError(f"the film has {min(sizes)} bytes at the least, more than {most_bytes}")
