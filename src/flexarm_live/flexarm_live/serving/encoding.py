"""Encoding of what is sent: JSON without NaN, and samples in binary frames."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

MAGIC = 0x464C5831
"""First four bytes of a frame of samples, "FLX1"."""
HEAD = struct.Struct("<IIIId")
"""Magic, rows, columns, a reserved word, and the instant that the times count from, s."""


def as_json(message: Mapping[str, Any]) -> str:
    """Return a message as JSON; a figure that is none, such as NaN, becomes null."""
    return json.dumps(_plain(message), separators=(",", ":"), allow_nan=False)


def frame_of(times_s: FloatArray, rows: FloatArray) -> bytes:
    """Return samples as one frame: times after the first one, then the channels, as float32.

    Parameters
    ----------
    times_s : ndarray, (samples,)
        Instants of the samples; one or more.
    rows : ndarray, (samples, channels)
        Values in the order of the channels.
    """
    content = np.column_stack([times_s - times_s[0], rows]).astype("<f4")
    return HEAD.pack(MAGIC, *content.shape, 0, times_s[0]) + content.tobytes()


def _plain(value: Any) -> Any:  # noqa: ANN401 - any value of a message
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, np.integer):
        return int(value)
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(each) for each in value]
    return value
