"""Are all samples there? Counts the gaps in the sequence numbers of recorded topics."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_bags.stamped import COMMANDS, SEQUENCED, sequence_of

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass
class Losses:
    """What is missing on one topic.

    Attributes
    ----------
    missing
        Numbers that were left out.
    gaps
        Places where numbers were left out.
    restarts
        Places where the numbering did not go up: its source started again.
    """

    missing: int = 0
    gaps: int = 0
    restarts: int = 0


class SequenceCheck:
    """Watches the sequence numbers of messages as they are recorded.

    Parameters
    ----------
    types
        Topic -> message type. Topics without a sequence number are let pass.
    """

    def __init__(self, types: Mapping[str, str]) -> None:
        self.losses = {topic: Losses() for topic, name in types.items() if name in SEQUENCED}
        self._what = {
            topic: "commands missing" if name in COMMANDS else "periods without a sample"
            for topic, name in types.items()
        }
        self._last: dict[str, int] = {}

    def add(self, topic: str, raw: bytes) -> None:
        """Look at the next message of a topic; one that cannot be read is somebody else's case."""
        losses = self.losses.get(topic)
        if losses is None:
            return
        try:
            sequence = sequence_of(raw)
        except struct.error:
            return
        step = sequence - self._last.get(topic, sequence - 1)
        if step > 1:
            losses.missing += step - 1
            losses.gaps += 1
        elif step < 1:
            losses.restarts += 1
        self._last[topic] = sequence

    def complaints(self) -> list[str]:
        """Return one sentence per topic with missing messages.

        The numbers of samples count periods: one that was skipped is missing like one that was
        lost.
        """
        return [
            f"{topic}: {losses.missing} {self._what[topic]} at {losses.gaps} places"
            for topic, losses in self.losses.items()
            if losses.missing
        ]
