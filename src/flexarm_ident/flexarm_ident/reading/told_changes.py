"""Changes of the arm and of the law that a bag tells: a payload that was set, a law in force."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_bags.reader import sibling
from flexarm_core.labels import instant
from flexarm_ident.records.iodata import DataWarning, Grade

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_bags.reader import Bag, Recorded
    from flexarm_ident.reading.timetable import Timetable

LAW_IN_FORCE = "flexarm_msgs/msg/LawInForce"
PARAMETER_EVENT = "rcl_interfaces/msg/ParameterEvent"
_EVENTS = "/parameter_events"
_NS = 1_000_000_000


def told_changes(
    bag: Bag, topic: str, samples: Recorded, table: Timetable
) -> tuple[DataWarning, ...]:
    """Return the warnings of a bag of our own rig, of the kinds that `diagnostics.change` has.

    Each has the instant of the first change, ``at_s``, seconds from the first row on.

    Parameters
    ----------
    bag : Bag
        The bag.
    topic : str
        Topic of the samples.
    samples : Recorded
        All messages of the topic.
    table : Timetable
        Places of the samples.
    """
    places = _Places(samples, table)
    payloads = list(places.inside(_payloads(bag, topic), places.received_ns))
    laws = list(places.inside(_laws(bag, topic), places.stamps_ns))
    found = []
    if payloads:
        parts = _parts([row for row, _ in payloads], table)
        text = (
            f"the payload was changed in mid-record, {_listed(payloads, table)}: a model of the "
            f"whole mixes several arms; identify the parts separately ({parts})"
        )
        found.append(_warning("plant_changed", text, payloads, table, Grade.CAUTION))
    if laws:
        text = f"the law was changed in mid-record, {_listed(laws, table)}"
        found.append(_warning("law_changed", text, laws, table, Grade.INFORMATION))
    return tuple(found)


class _Places:
    """Rows of a record at the instants of its messages, rising."""

    def __init__(self, samples: Recorded, table: Timetable) -> None:
        self._rows = np.rint(table.grid.instants).astype(np.int64)
        self._count = table.rows
        self.received_ns, self.stamps_ns = (
            np.maximum.accumulate(each[table.run.messages][table.grid.kept])
            for each in (samples.log_times_ns, samples.stamps_ns())
        )

    def inside(
        self, told: Iterable[tuple[int, str]], times_ns: NDArray[np.int64]
    ) -> Iterator[tuple[int, str]]:
        """Yield the row and the text of each change within the record."""
        for time_ns, text in told:
            following = int(np.searchsorted(times_ns, time_ns))
            if 0 < following < len(self._rows) and self._rows[following] < self._count:
                yield int(self._rows[following]), text


def _payloads(bag: Bag, topic: str) -> Iterator[tuple[int, str]]:
    """Yield instant of receiving and new value of each change of the simulated arm's payload."""
    if not bag.has(_EVENTS, PARAMETER_EVENT) or not bag.count(_EVENTS):
        return
    node = sibling(topic, "daq")
    messages = zip(
        bag.grouped(_EVENTS).log_times_ns.tolist(),
        bag.messages(_EVENTS, PARAMETER_EVENT),
        strict=True,
    )
    for time_ns, event in messages:
        for each in event.changed_parameters if event.node == node else ():
            if each.name == "payload_kg":
                yield time_ns, f"to {each.value.double_value:g} kg"


def _laws(bag: Bag, topic: str) -> Iterator[tuple[int, str]]:
    """Yield instant and new value of each change of the law or of one of its parameters."""
    law = sibling(topic, "law")
    if not bag.has(law, LAW_IN_FORCE) or not bag.count(law):
        return
    messages = bag.messages(law, LAW_IN_FORCE)
    told = [(_NS * m.header.stamp.sec + m.header.stamp.nanosec, m.parameters) for m in messages]
    for (_, before), (time_ns, after) in pairwise(told):
        if before != after and (text := _difference(_values(before), _values(after))):
            yield time_ns, text


def _values(text: str) -> Mapping[str, Any]:
    try:
        values = json.loads(text)
    except ValueError:
        return {}
    return values if isinstance(values, dict) else {}


def _difference(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Return what differs of the law, in a few words; empty where it is the reference alone."""
    if "law" not in before or "law" not in after:
        return ""
    if after["law"] != before["law"]:
        return f"to {after['law']}"
    of_reference = ("reference", "trajectory", f"{after.get('reference')}.")
    names = [
        name
        for name, value in after.items()
        if not name.startswith(of_reference) and value != before.get(name)
    ]
    return f"in {', '.join(names)}" if names else ""


def _listed(changes: Sequence[tuple[int, str]], table: Timetable) -> str:
    period_s = table.grid.period_s
    return ", ".join(f"{text} at {instant(row, period_s)}" for row, text in changes)


def _parts(rows: Sequence[int], table: Timetable) -> str:
    """Return the options of each part between the rows of changes."""
    period_s = table.grid.period_s
    options = [f"--to {rows[0] * period_s:.9g}s"]
    options += [
        f"--from {first * period_s:.9g}s --to {last * period_s:.9g}s"
        for first, last in pairwise(rows)
    ]
    return ", ".join([*options, f"--from {rows[-1] * period_s:.9g}s"])


def _warning(
    name: str, text: str, changes: Sequence[tuple[int, str]], table: Timetable, grade: Grade
) -> DataWarning:
    figures = {"at_s": changes[0][0] * table.grid.period_s, "changes": float(len(changes))}
    return DataWarning(name, text, figures, grade=grade)
