"""Samples as rows of numbers, from the bytes of `state` and of `reference`."""

from __future__ import annotations

import math
import struct
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexarm_node.topics.layout import end_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_node.topics.waiting import RawMessage

STATE, REFERENCE, STREAMED_REFERENCE = range(3)
"""Topics that are waited on; the last one is that of the second reader of set-points."""
"""Topics of the messages, in the order in which they are waited for."""
COLUMNS = (
    "position_v",
    "base_strain_v",
    "middle_strain_v",
    "speed_v",
    "command_v",
    "compensation_v",
    "reference_v",
    "sequence_low",
)
"""Columns of a frame behind the times."""
SEQUENCE_SPAN = 2**20
"""The number of a sample is sent less whole spans of this: float32 has 24 bits."""
_MEASURED = COLUMNS[:6]
_STAMP = struct.Struct("<4xiI")
_DOUBLE = struct.Struct("<4xd")
_LITTLE_ENDIAN = 1
_KEPT_LOOKS = 128


class Samples(NamedTuple):
    """Samples of one look.

    Attributes
    ----------
    times_s : ndarray, (samples,)
        Their stamps, s.
    rows : ndarray, (samples, 8)
        Their values, see `COLUMNS`.
    """

    times_s: FloatArray
    rows: FloatArray


class SampleReader:
    """Reader of messages in the order of their publication.

    Parameters
    ----------
    state_type : type
        Class of the messages with the samples, ArmState.

    Attributes
    ----------
    reference_v : float
        Set-point in force; NaN until it is known.
    newest : int
        Number of the newest sample; 0 before the first.
    position_v : float
        Position of the newest sample, V.
    """

    def __init__(self, state_type: type) -> None:
        # The text of its frame may have any length.
        self._end = end_of(state_type)
        self._taken = 0
        self._looks: deque[tuple[int, Samples]] = deque(maxlen=_KEPT_LOOKS)
        self.reference_v = math.nan
        self.newest = 0
        self.position_v = math.nan

    def read(self, messages: Sequence[RawMessage]) -> Samples | None:
        """Return the samples among messages; None when there is none."""
        ends, times_s, references_v = [], [], []
        for message in sorted(messages, key=lambda each: each.source_ns):
            if message.raw[1] != _LITTLE_ENDIAN:
                continue
            if message.topic != STATE:
                self.reference_v = _DOUBLE.unpack_from(message.raw)[0]
                continue
            second, nanosecond = _STAMP.unpack_from(message.raw)
            times_s.append(second + 1e-9 * nanosecond)
            ends.append(message.raw[-self._end.itemsize :])
            references_v.append(self.reference_v)
        if not ends:
            return None
        found = np.frombuffer(b"".join(ends), self._end)
        self.newest, self.position_v = int(found["sequence"][-1]), float(found["position_v"][-1])
        rows = np.column_stack(
            [
                *(found[name] for name in _MEASURED),
                references_v,
                found["sequence"] % SEQUENCE_SPAN,
            ]
        )
        samples = Samples(np.array(times_s), rows)
        self._taken += len(rows)
        self._looks.append((self._taken, samples))
        return samples

    def after(self, taken: int) -> dict[str, Any]:
        """Return the samples of the last looks, but for those up to a count of all samples taken.

        Any thread may call. The count begins anew with this process: a larger one is of another.
        """
        looks = tuple(self._looks)
        newest = looks[-1][0] if looks else 0
        known = taken if taken <= newest else 0
        parts = [
            (samples.times_s[skipped:], samples.rows[skipped:])
            for end, samples in looks
            if end > known
            for skipped in [max(0, known - (end - len(samples.rows)))]
        ]
        rows = np.vstack([np.empty((0, len(COLUMNS))), *(each for _, each in parts)])
        return {
            "taken": newest,
            "t_s": np.concatenate([np.empty(0), *(each for each, _ in parts)]),
            "values": dict(zip(COLUMNS, rows.T, strict=True)),
        }
