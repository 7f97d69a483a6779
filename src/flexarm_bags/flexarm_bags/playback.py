"""Bag playback: a plan of which raw message is due when.

A message is due at its log time, counted from the start offset and divided by the rate factor. A
looped bag starts again when its last message is due. Messages of one instant keep their order.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag2

from flexarm_bags.bounds import bounded, require_bounded_messages
from flexarm_bags.metadata import TopicQos, repair_advice, require_bag
from flexarm_core.bounds import BoundError
from flexarm_core.errors import BagError, FlexarmError, one_line

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rosbags.interfaces import Connection

_NS = 1_000_000_000


class PlaybackError(FlexarmError):
    """The bag cannot be played."""


class DueMessage(NamedTuple):
    """One serialised message, when it is due after the start of play, and its time in the bag."""

    due_s: float
    topic: str
    raw: bytes
    time_ns: int


@dataclass(frozen=True)
class PlayedTopic:
    """One topic of the bag: its type, the QoS to offer, and how many messages there are."""

    name: str
    type_name: str
    qos: TopicQos
    messages: int


@dataclass(frozen=True)
class PlaybackPlan:
    """Plan of a bag's playback.

    Attributes
    ----------
    bag : Path
        rosbag2 folder of any storage, or a single ``.mcap`` or ``.db3`` file.
    rate : float
        Speed factor; 2 plays twice as fast.
    start_s : float
        Skipped at the beginning, s of the bag's time.
    duration_s : float or None
        Played from there, s of the bag's time; None: to the end.
    loop : bool
        Start again at the end, without end.

    Raises
    ------
    PlaybackError
        If a number is out of range, or there is no bag.
    """

    bag: Path
    rate: float = 1.0
    start_s: float = 0.0
    duration_s: float | None = None
    loop: bool = False

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise PlaybackError(f"rate {self.rate} must be a positive number")
        if not (np.isfinite(self.start_s) and self.start_s >= 0):
            raise PlaybackError(f"start {self.start_s} s must not be negative")
        if self.duration_s is not None and not (
            np.isfinite(self.duration_s) and self.duration_s > 0
        ):
            raise PlaybackError(f"duration {self.duration_s} s must be positive")
        try:
            require_bag(self.bag)
        except BagError as error:
            raise PlaybackError(str(error)) from error

    def topics(self) -> tuple[PlayedTopic, ...]:
        """Return the topics that the player has to advertise, in the order of the bag.

        Raises
        ------
        PlaybackError
            If the bag cannot be read or a topic has two types.
        """
        topics: dict[str, PlayedTopic] = {}
        with _opened(self.bag) as reader:
            for connection in reader.connections:
                known = topics.get(connection.topic)
                if known is not None and known.type_name != connection.msgtype:
                    raise PlaybackError(
                        f"{self.bag}: {connection.topic} is {known.type_name} and"
                        f" {connection.msgtype}; only one type can be played"
                    )
                topics[connection.topic] = PlayedTopic(
                    connection.topic,
                    connection.msgtype,
                    _qos(connection),
                    connection.msgcount + (known.messages if known else 0),
                )
        return tuple(topics.values())

    def messages(self) -> Iterator[DueMessage]:
        """Yield the messages in the order in which they are due, also across the end of a loop.

        Raises
        ------
        PlaybackError
            If the bag cannot be read to its end or has no message in the chosen part.
        """
        with _opened(self.bag) as reader:
            first_ns = reader.start_time + round(self.start_s * _NS)
            stop_ns = reader.end_time
            if self.duration_s is not None:
                stop_ns = min(stop_ns, first_ns + round(self.duration_s * _NS))
            if reader.message_count == 0 or first_ns >= stop_ns:
                raise PlaybackError(f"{self.bag}: no message from {self.start_s} s on")
            length_s = (stop_ns - first_ns) / _NS / self.rate
            cycle_start_s = 0.0
            while True:
                played = 0
                for connection, log_time_ns, raw in reader.messages(start=first_ns, stop=stop_ns):
                    played += 1
                    due_s = cycle_start_s + (log_time_ns - first_ns) / _NS / self.rate
                    yield DueMessage(due_s, connection.topic, bytes(raw), log_time_ns)
                if played == 0:
                    raise PlaybackError(f"{self.bag}: no message from {self.start_s} s on")
                if not self.loop:
                    return
                cycle_start_s += length_s


@contextmanager
def _opened(bag: Path) -> Iterator[AnyReader]:
    """Open a bag; whatever its parsers raise on a damaged file becomes one line."""
    try:
        with bounded(bag, unpacks=True) as plain, AnyReader([plain]) as reader:
            require_bounded_messages(reader)
            yield reader
    except (PlaybackError, GeneratorExit):
        raise
    except BoundError as error:
        raise PlaybackError(f"{bag}: {str(error).removeprefix(f'{bag}: ')}") from error
    except Exception as error:
        raise PlaybackError(f"{bag}: cannot read: {one_line(error)}{repair_advice(bag)}") from error


def _qos(connection: Connection) -> TopicQos:
    """Return the QoS as recorded."""
    if isinstance(connection.ext, ConnectionExtRosbag2):
        return TopicQos.of(connection.ext.offered_qos_profiles)
    return TopicQos()
