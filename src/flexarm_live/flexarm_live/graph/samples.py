"""Samples as rows of numbers, and bodies, as the topics of an arm have them."""

from __future__ import annotations

import json
import math
import time
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from std_msgs.msg import Float32MultiArray, String

from flexarm_live.graph.about import SEQUENCE_SPAN, columns_of
from flexarm_node import qos
from flexarm_node.codecs import codec_of
from flexarm_node.topics.waiting import content_of, message_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.node import Node

    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import RigDescription
    from flexarm_live.serving.laboratory import Outlet
    from flexarm_node.topics.waiting import RawMessage

SAMPLES, REFERENCE, STREAMED_REFERENCE = range(3)
"""Topics of the messages, in the order in which they are waited for; the last one is that of the
second reader of set-points."""
_KEPT_LOOKS = 128
_NS_PER_S = 1e9
_LEAST_S = 0.03
"""Between two messages to the pages: an arm as fast as it goes has many more poses."""
_NUMBERS, _DIGITS = 7, 5
"""Of a pose."""


class Samples(NamedTuple):
    """Samples of one look.

    Attributes
    ----------
    times_s : ndarray, (samples,)
        Their stamps, s.
    rows : ndarray, (samples, columns)
        Their values, see `columns_of`.
    """

    times_s: FloatArray
    rows: FloatArray


class SampleReader:
    """Reader of messages in the order of their publication.

    Parameters
    ----------
    rig : RigDescription
        Rig of the samples.
    frame : str
        Usual frame of the messages; those of another one take longer to read.

    Attributes
    ----------
    codec : Codec
        Topics of the messages.
    references : tuple of float
        Set-points in force, in the order of the tracked outputs; NaN until they are known.
    outputs : tuple of float
        Readings of the newest sample, in the order and the units of the rig's description.
    newest : int
        Number of the newest sample; 0 before the first.
    """

    def __init__(self, rig: RigDescription, frame: str) -> None:
        self.codec = codec_of(rig, frame)
        self._columns = columns_of(rig)
        self._taken = 0
        self._looks: deque[tuple[int, Samples]] = deque(maxlen=_KEPT_LOOKS)
        self.references = (math.nan,) * len(rig.tracked)
        self.outputs = (math.nan,) * len(rig.outputs)
        self.newest = 0

    def read(self, messages: Sequence[RawMessage]) -> Samples | None:
        """Return the samples among messages; None when there is none."""
        times_s, rows = [], []
        for message in sorted(messages, key=lambda each: each.source_ns):
            if message.topic != SAMPLES:
                self._hear_references(message.raw)
                continue
            # One of another rig has none.
            sample = content_of(message.raw, self.codec.samples)
            if sample is None:
                continue
            self.newest, self.outputs = sample.sequence, sample.outputs
            times_s.append(sample.taken_ns / _NS_PER_S)
            rows.append(
                (
                    *sample.outputs,
                    *sample.commands,
                    *sample.compensations,
                    *self.references,
                    sample.sequence % SEQUENCE_SPAN,
                )
            )
        if not rows:
            return None
        samples = Samples(np.array(times_s), np.array(rows, dtype=np.float64))
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
        rows = np.vstack([np.empty((0, len(self._columns))), *(each for _, each in parts)])
        return {
            "taken": newest,
            "t_s": np.concatenate([np.empty(0), *(each for each, _ in parts)]),
            "values": dict(zip(self._columns, rows.T, strict=True)),
        }

    def _hear_references(self, raw: bytes) -> None:
        message = message_of(raw, self.codec.reference_type)
        if message is None:
            return
        references = self.codec.references(message)
        if len(references) == len(self.references):
            self.references = references


class ShownBodies:
    """Reader of the bodies, which sends them to the pages.

    Parameters
    ----------
    node : Node
        Node for the readers.
    outlet : callable
        Returns what sends messages to the pages.

    Attributes
    ----------
    solids : list of dict
        What the bodies are made of; empty for an arm without bodies.
    """

    def __init__(self, node: Node, outlet: Callable[[], Outlet]) -> None:
        self.solids: list[dict[str, Any]] = []
        self._outlet = outlet
        self._sent_s = 0.0
        node.create_subscription(String, "bodies", self._on_solids, qos.STATUS)
        node.create_subscription(Float32MultiArray, "body_poses", self._on_poses, qos.SEEN)

    def _on_solids(self, message: String) -> None:
        self.solids = json.loads(message.data)
        self._outlet().send({"type": "bodies", "solids": self.solids})

    def _on_poses(self, message: Float32MultiArray) -> None:
        now_s = time.monotonic()
        if self._outlet().pages and now_s - self._sent_s > _LEAST_S:
            self._sent_s = now_s
            poses = np.array(message.data, dtype=float).reshape(-1, _NUMBERS)
            self._outlet().send({"type": "poses", "poses": poses.round(_DIGITS)})
