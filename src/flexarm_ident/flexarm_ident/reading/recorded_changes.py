"""Changes of the arm and of the controller that a bag reports: its payload, its control law."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_bags.reader import LAW_IN_FORCE, sibling
from flexarm_core.clock import NS
from flexarm_core.labels import instant
from flexarm_ident.records.data_warning import PLANT_CHANGED, Grade
from flexarm_ident.records.span import part_options

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from flexarm_bags.reader import Bag, Recorded
    from flexarm_ident.reading.timetable import Timetable
    from flexarm_ident.records.data_warning import DataWarning

PARAMETER_EVENT = "rcl_interfaces/msg/ParameterEvent"
_EVENTS = "/parameter_events"


def recorded_changes(
    bag: Bag, topic: str, samples: Recorded, table: Timetable
) -> tuple[DataWarning, ...]:
    """Return the warnings of a bag of our own rig, of the kind that `diagnostics.change` has.

    Each has the instant of its change, ``at_s``, seconds from the first row on.

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
    places, period_s = _Places(samples, table), table.grid.period_s
    found = []
    payloads = list(places.inside(_payloads(bag, topic), places.received_ns))
    at_s = [row * period_s for row, _ in payloads]
    sides = zip(payloads, [0.0, *at_s], at_s, [*at_s[1:], None], strict=False)
    for (row, text), since_s, cut_s, until_s in sides:
        before, after = part_options(since_s, cut_s), part_options(cut_s, until_s)
        said = (
            f"the payload was changed {text} at {instant(row, period_s)}: a model of both sides "
            f"mixes two arms; identify the parts separately ({before}, {after})"
        )
        found.append(PLANT_CHANGED(said, {"at_s": cut_s}))
    for row, text in places.inside(_laws(bag, topic), places.stamps_ns):
        said = f"the controller was changed {text} at {instant(row, period_s)}"
        figures = {"at_s": row * period_s}
        found.append(PLANT_CHANGED(said, figures, grade=Grade.INFORMATION))
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
        self, changes: Iterable[tuple[int, str]], times_ns: NDArray[np.int64]
    ) -> Iterator[tuple[int, str]]:
        """Yield the row and the text of each change within the record."""
        for time_ns, text in changes:
            following = int(np.searchsorted(times_ns, time_ns))
            if 0 < following < len(self._rows) and self._rows[following] < self._count:
                yield int(self._rows[following]), text


def _payloads(bag: Bag, topic: str) -> Iterator[tuple[int, str]]:
    """Yield instant of receiving and new value of each change of the simulated arm's payload."""
    if not bag.has(_EVENTS, PARAMETER_EVENT) or not bag.count(_EVENTS):
        return
    node, before_kg = sibling(topic, "daq"), None
    messages = zip(
        bag.grouped(_EVENTS).log_times_ns.tolist(),
        bag.messages(_EVENTS, PARAMETER_EVENT),
        strict=True,
    )
    for time_ns, event in messages:
        if event.node != node:
            continue
        # A node that starts declares its own.
        for each in (*event.new_parameters, *event.changed_parameters):
            if each.name != "payload_kg":
                continue
            is_new, before_kg = each.value.double_value != before_kg, each.value.double_value
            # What is set to the value that it has is in the event as well.
            if is_new and each in event.changed_parameters:
                yield time_ns, f"to {before_kg:g} kg"


def _laws(bag: Bag, topic: str) -> Iterator[tuple[int, str]]:
    """Yield instant and new value of each change of the control law or of one of its parameters."""
    law = sibling(topic, "law")
    if not bag.has(law, LAW_IN_FORCE) or not bag.count(law):
        return
    messages = bag.messages(law, LAW_IN_FORCE)
    changes = [
        (NS * each.header.stamp.sec + each.header.stamp.nanosec, values)
        for each in messages
        if "law" in (values := _values(each.parameters))
    ]
    for (_, before), (time_ns, after) in pairwise(changes):
        if text := _difference(before, after):
            yield time_ns, text


def _values(text: str) -> dict[str, Any]:
    try:
        values = json.loads(text)
    except ValueError:
        return {}
    return values if isinstance(values, dict) else {}


def _difference(before: dict[str, Any], after: dict[str, Any]) -> str:
    """Return what differs of the law, in a few words.

    It is empty where only its reference differs, or models, which are reported where they are
    chosen.
    """
    if after["law"] != before["law"]:
        return f"to {after['law']}"
    references = tuple(f"{each.get('reference')}." for each in (before, after))
    of_others = ("models.", "shaper", "reference", "trajectory", *references)
    names = [
        name
        for name in before | after
        if not name.startswith(of_others) and before.get(name) != after.get(name)
    ]
    return f"in {', '.join(names)}" if names else ""
