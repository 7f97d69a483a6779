"""Invariants of the bags: what the recorder took is in them, however the recording ended."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from bench.schedules.messages import COMMANDER, TOPICS
from bench.schedules.oracle import Violation
from flexarm_bags.check import check_bag
from flexarm_bags.repair import repair_bag
from flexarm_bags.writer import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

    from bench.schedules.messages import Raw
    from bench.schedules.recorder import Ledger

    Content = list[tuple[str, bytes]]

_FLUSH_S: Final = 0.9
# What the recorder knows of the clocks is from so many messages of a topic.
_RECENT: Final = 200
_CLOCK_S: Final = 1e-6
_KEPT: Final = TOPICS[COMMANDER]


def check(ledger: Ledger, *, every_bit: bool) -> bytes:
    """Check a bag, and return the bytes of its file; none if it is rightly not there.

    Parameters
    ----------
    ledger : Ledger
        What must be in it.
    every_bit : bool
        Whether `bag check` examines it too, if it was closed.
    """
    file = next(ledger.path.glob("*.mcap"), None)
    if file is None:
        # The recorder removes a bag into which nothing came.
        _require(ledger.end == "closed", "the bag is not there")
        _require_closed(ledger, [])
        return b""
    _CHECKS[ledger.end](ledger, file)
    if every_bit and ledger.end == "closed":
        problems = [each for each in check_bag(ledger.path).problems if not _is_of_the_run(each)]
        _require(not problems, f"the bag is not good: {'; '.join(problems)}")
    return file.read_bytes()


def _closed(ledger: Ledger, file: Path) -> None:
    _require_closed(ledger, salvaged(file))


def _require_closed(ledger: Ledger, content: Content) -> None:
    _require(
        len(content) == _first_number(ledger.claim),
        f"the recorder says {ledger.claim}, the bag has {len(content)} messages",
    )
    received = [message for message, _ in ledger.handed]
    samples = _without_kept(content)
    before = _stored(received[: ledger.before])
    _require(samples[: len(before)] == before, "the bag lacks messages that the recorder had")
    if ledger.wall_clock_holds:
        lost = len(set(_stored(_on_their_way(ledger))) - set(samples))
        _require(not lost, f"{lost} messages that were on their way are not in the bag")
    lost = _lost(samples, TOPICS[1])
    said = re.search(rf"{TOPICS[1]}: (\d+) period", ledger.claim)
    _require(lost == (int(said[1]) if said else 0), f"{lost} samples are missing: {ledger.claim}")


def _on_their_way(ledger: Ledger) -> list[Raw]:
    """Return what came after the end and was surely sent before it.

    The clocks of two machines tell that up to the time of the quickest message since one of them
    was set.
    """
    found = []
    for topic in range(len(TOPICS)):
        before = [each for each in ledger.heard if each[0].topic == topic][-_RECENT:]
        for raw, _ in ledger.handed[ledger.before :]:
            if raw.topic != topic:
                continue
            ahead_s = _ahead_s(raw)
            ways_s = [at_s - each.sent_s for each, at_s in before if _ahead_s(each) == ahead_s]
            if raw.sent_s <= ledger.asked_s - min(ways_s, default=0.0) - _CLOCK_S:
                found.append(raw)
    return found


def _ahead_s(message: Raw) -> int:
    """Return by how many seconds the sender's clock was ahead."""
    return round(message.source_ns * 1e-9 - message.sent_s)


def _failed(ledger: Ledger, file: Path) -> None:
    claimed = re.search(r"the first (\d+) messages", ledger.claim)
    _require(claimed is not None, f"the recorder does not say what is kept: {ledger.claim}")
    assert claimed is not None  # noqa: S101 - checked
    content = _recovered(ledger, file)
    _require(
        len(content) == int(claimed[1]),
        f"the recorder says that {claimed[1]} messages are kept, the bag has {len(content)}",
    )
    _require_prefix(ledger, content)


def _killed(ledger: Ledger, file: Path) -> None:
    content = _recovered(ledger, file)
    _require_prefix(ledger, content)
    safe = _stored([message for message, at_s in ledger.handed if at_s < ledger.awake_s - _FLUSH_S])
    kept = len(_without_kept(content))
    _require(
        kept >= len(safe),
        f"{len(safe)} messages were older than a flush period at the kill, {kept} are there",
    )


_CHECKS: Final = {"closed": _closed, "failed": _failed, "killed": _killed}


def salvaged(file: Path) -> Content:
    """Return topic and bytes of the messages in all whole chunks of a file that may be cut."""
    found: Content = []
    topics: dict[int, str] = {}
    with file.open("rb") as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                if isinstance(record, Message):
                    found.append((topics[record.channel_id], record.data))
        except Exception:  # noqa: BLE001 - any error is the end of what is whole
            return found
    return found


def _recovered(ledger: Ledger, file: Path) -> Content:
    """Return the messages of a bag that was not closed, which `bag repair` must find too."""
    content = salvaged(file)
    repaired = ledger.path.with_name(f"{ledger.path.name}_repaired")
    try:
        repair_bag(ledger.path, repaired)
    except RecordingError as error:
        _require(not content, f"no repair: {error}")
        return content
    (file,) = repaired.glob("*.mcap")
    _require(salvaged(file) == content, "the repaired bag has other messages")
    return content


def _require_prefix(ledger: Ledger, content: Content) -> None:
    samples = _without_kept(content)
    received = _stored([message for message, _ in ledger.handed])
    _require(samples == received[: len(samples)], "the bag is not what the recorder received")


def _stored(messages: list[Raw]) -> Content:
    return [(TOPICS[each.topic], each.raw) for each in messages if each.topic != COMMANDER]


def _without_kept(content: Content) -> Content:
    return [each for each in content if each[0] != _KEPT]


def _lost(content: Content, topic: str) -> int:
    """Return how many numbers of a topic are left out, read from the bytes behind the header."""
    numbers = [int.from_bytes(raw[28:36], "little") for name, raw in content if name == topic]
    steps = [after - before for before, after in pairwise(numbers)]
    return sum(step - 1 for step in steps if step > 1)


def _is_of_the_run(problem: str) -> bool:
    """Return whether a check rightly complains about the run, and not about the bag."""
    return problem.startswith(TOPICS) and "metadata.yaml" not in problem


def _first_number(text: str) -> int:
    return int(text.split(maxsplit=1)[0])


def _require(holds: bool, what: str) -> None:  # noqa: FBT001 - a condition
    if not holds:
        raise Violation(what)
