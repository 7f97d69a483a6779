"""Numbers in messages of any type: their paths, their values, and a list of what there is."""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING

import numpy as np

from flexarm_bags.schema import foreign_topics
from flexarm_core.errors import BagError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from flexarm_bags.reader import Bag, Grouped
    from flexarm_bags.records.columns import Column
    from flexarm_core.arrays import FloatArray

_FIELD = re.compile(r"(?:(?P<name>\w+)=)?(?P<topic>/?[^.=\[\]]+)\.(?P<path>.+)")
_TOPIC = re.compile(r"(?:(?P<name>\w+)=)?(?P<topic>/[^.=\[\]]+)(?P<path>)")
_ELEMENT = re.compile(r"(?P<array>.+)\[(?P<key>[^\[\]]+)\]")
# Instants, which nobody wants as a signal.
_STAMP = "header."
# So many fields of a topic are shown.
_SHOWN = 24
# So many elements of an array are offered for one that it has not.
_NEAR = 3


@dataclass(frozen=True)
class Field:
    """One number of a topic's messages.

    Attributes
    ----------
    topic : str
        Topic, ``/joint_states``.
    path : str
        Place in the message: ``wrench.force.x``, ``data[2]``, ``transforms[0].header.stamp.sec``,
        or ``effort[elbow]`` where a list of texts in the message, such as the joints' names of
        ``JointState``, gives the place of ``elbow``. Empty where none was named.
    name : str
        Name of the channel.
    """

    topic: str
    path: str
    name: str

    def __str__(self) -> str:
        return f"{self.topic}.{self.path}"


def parse_field(text: str) -> Field:
    """Return the field of ``TOPIC.FIELD`` or ``NAME=TOPIC.FIELD``.

    Without a name the channel is called as its field, with underscores: ``joint_states_effort_0``.
    A topic without a field, ``/joint_states``, is refused where its bag lists the fields it has.

    Raises
    ------
    BagError
        If the text has another form.
    """
    match = _FIELD.fullmatch(text.strip()) or _TOPIC.fullmatch(text.strip())
    if match is None:
        raise BagError(
            f"{text!r} is not a TOPIC.FIELD, such as /joint_states.position[0], and no "
            "NAME=TOPIC.FIELD, such as angle_rad=/joint_states.position[0]"
        )
    plain = re.sub(r"\W+", "_", f"{match['topic']}.{match['path']}").strip("_")
    return Field(match["topic"], match["path"], match["name"] or plain)


def values_of(messages: Grouped, path: str) -> FloatArray | None:
    """Return a number of each message, (messages,); NaN in a message that lacks it.

    The result is None when all of them lack it.
    """
    values = np.full(len(messages), np.nan)
    is_there = False
    path = _named_path(messages, path)
    for numbers, columns in messages.groups:
        found = _column(columns, path)
        if found is not None:
            values[numbers] = found
            is_there = True
    return values if is_there else None


def _named_path(messages: Grouped, path: str) -> str:
    """Return a path with the name in the place of a number, where each message names its values.

    Two publishers may have the joints of `JointState` in other orders, and one may change its own:
    the number is that of the first message.
    """
    match = _ELEMENT.fullmatch(path)
    if match is None or not match["key"].isdecimal():
        return path
    numbers, columns = min(messages.groups, key=lambda group: group[0][0])
    array, place = columns.get(match["array"]), int(match["key"])
    if array is None or array.ndim == 1 or place >= array.shape[1]:
        return path
    first = int(np.argmin(numbers))
    for texts in _text_lists(columns, array.shape[1]):
        names = [bytes(text[first]).decode("utf-8", "replace") for text in texts]
        if names.count(names[place]) == 1 and not names[place].isdecimal():
            return f"{match['array']}[{names[place]}]"
    return path


def _column(columns: Mapping[str, Column], path: str) -> FloatArray | None:
    """Return a number of messages that are alike; None when they lack it."""
    column = columns.get(path)
    if column is not None and column.ndim == 1 and column.dtype.kind != "S":
        return column.astype(np.float64)
    match = _ELEMENT.fullmatch(path)
    array = columns.get(match["array"]) if match else None
    if match is None or array is None or array.ndim == 1:
        return None
    key = match["key"]
    if key.isdecimal():
        return array[:, int(key)].astype(np.float64) if int(key) < array.shape[1] else None
    return _by_text(columns, array, key)


def _by_text(columns: Mapping[str, Column], array: Column, key: str) -> FloatArray | None:
    """Return the element of an array at the place that a text has in a list of texts."""
    found = np.full(len(array), np.nan)
    is_there = np.zeros(len(array), dtype=np.bool_)
    for texts in _text_lists(columns, array.shape[1]):
        for place, text in enumerate(texts):
            here = text == key.encode()
            found[here] = array[here, place]
            is_there |= here
    return found if is_there.any() else None


def _text_lists(columns: Mapping[str, Column], length: int) -> Iterator[list[Column]]:
    """Yield the message's own lists of so many texts, as columns."""
    lists: dict[str, list[Column]] = {}
    for name, column in columns.items():
        if column.dtype.kind == "S" and name.endswith("]") and "." not in name:
            lists.setdefault(name.partition("[")[0], []).append(column)
    return (texts for texts in lists.values() if len(texts) == length)


def wrong_topic(bag: Bag, field: Field) -> BagError:
    """Return the error for a topic that a bag has not, with what it has."""
    near = _nearest(field.topic, list(bag.types))
    if encoding := foreign_topics(bag.path).get(field.topic):
        return BagError(
            f"{bag.path}: {field.topic} is {encoding} and no topic of ROS 2: record it with `ros2 "
            "bag record`, or export all numbers as CSV and identify that file; there are: "
            f"{numbers_in(bag)}"
        )
    return BagError(f"{bag.path}: no topic {field.topic}{near}; there are: {numbers_in(bag)}")


def wrong_path(bag: Bag, field: Field) -> BagError:
    """Return the error for a field that a topic has not, with those that it has."""
    there = list(_numbers(bag.first(field.topic)))
    if not field.path:
        # The last is the likeliest: a layout or a state of the message comes first.
        one = re.sub(r"\.\.\d+", "", there[-1]) if there else ""
        such = f", such as {field.topic}.{one}" if one else ""
        return BagError(
            f"{bag.path}: {field.topic} ({bag.types[field.topic]}) is a topic: name one of its "
            f"numbers{such}; there are: {_shortened(there)}"
        )
    near = _nearest(field.path, there)
    return BagError(
        f"{bag.path}: {field.topic} ({bag.types[field.topic]}) has no number {field.path}{near}; "
        f"there are: {_shortened(there)}"
    )


def numbers_in(bag: Bag) -> str:
    """Return topics, types and numbers of a bag, in one line."""
    return (
        "; ".join(
            f"{topic} ({bag.types[topic]}): {_numbers_of_topic(bag, topic)}"
            for topic in sorted(bag.types)
        )
        or "none"
    )


def number_fields(bag: Bag) -> list[str]:
    """Return every number of a bag as `parse_field` takes it, the elements of an array each."""
    found = []
    for topic in sorted(filter(bag.count, bag.types)):
        with suppress(BagError):
            for path in _numbers(bag.first(topic)):
                array, dots, last = path.removesuffix("]").partition("[0..")
                places = [f"{array}[{k}]" for k in range(int(last) + 1)] if dots else [path]
                found += [f"{topic}.{place}" for place in places]
    return found


def _numbers_of_topic(bag: Bag, topic: str) -> str:
    if not bag.count(topic):
        return "no messages"
    try:
        return _shortened(list(_numbers(bag.first(topic))))
    except BagError as error:
        return str(error).removeprefix(f"{bag.path}: {topic}: ")


def _numbers(first: Grouped) -> Iterator[str]:
    """Yield the paths of the numbers in a message, an array without names as a range."""
    columns = first.groups[0][1]
    for path, column in columns.items():
        if column.dtype.kind == "S" or path.startswith(_STAMP):
            continue
        if column.ndim == 1:
            yield path
            continue
        length = column.shape[1]
        lists = _text_lists(columns, length)
        keys = [str(text[0], "utf-8", "replace") for texts in lists for text in texts]
        if keys:
            yield from (f"{path}[{key}]" for key in keys)
        elif length:
            yield f"{path}[0..{length - 1}]" if length > 1 else f"{path}[0]"


def _shortened(paths: list[str]) -> str:
    if not paths:
        return "no numbers"
    more = f" and {len(paths) - _SHOWN} more" if len(paths) > _SHOWN else ""
    return ", ".join(paths[:_SHOWN]) + more


def _nearest(wanted: str, there: list[str]) -> str:
    within = [each for each in there if each.startswith((f"{wanted}[", f"{wanted}."))]
    near = within[:1] or _elements(wanted, there) or get_close_matches(wanted, there, n=1)
    return f" (did you mean {' or '.join(near)}?)" if near else ""


def _elements(wanted: str, there: list[str]) -> list[str]:
    """Return the elements of an array for a number that none of them has."""
    match = _ELEMENT.fullmatch(wanted)
    if match is None or not match["key"].isdecimal():
        return []
    return [each for each in there if each.startswith(f"{match['array']}[")][:_NEAR]
