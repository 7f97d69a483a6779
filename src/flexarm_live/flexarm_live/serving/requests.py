"""Requests of a client: one JSON object each, checked before anything acts on it."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import dataclass, field
from enum import IntEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexarm_core.errors import FlexarmError, nearest
from flexarm_node.parameter_files import LOOP

if TYPE_CHECKING:
    from collections.abc import Mapping

LONGEST_TEXT = 500
LONGEST_LIST = 64
_LARGEST_ID = 2**53


class RequestError(FlexarmError):
    """A request that is not carried out; the text says why.

    Attributes
    ----------
    number : int
        Number of the request, where its message has one.
    """

    number = 0


class Needs(IntEnum):
    """Right that a verb needs; each includes the ones before."""

    NOTHING = 0
    TOKEN = 1
    HOLD = 2
    """Control of the set-point, which one page has at a time."""
    OWNER = 3


@dataclass(frozen=True)
class Field:
    """One field of a request: its kind, and for a number its range."""

    kind: str
    required: bool = True
    least: float = -math.inf
    most: float = math.inf
    choices: tuple[str, ...] = ()

    def checked(self, name: str, value: object) -> object:
        """Return the value as its kind; raise a `RequestError` that says what is allowed."""
        if not _KINDS[self.kind](value):
            raise RequestError(f"{name}: must be {_WORDS[self.kind]}")
        if self.choices and value not in self.choices:
            raise RequestError(
                f"{name} = {str(value)[:50]!r}: must be one of {', '.join(self.choices)}"
            )
        if isinstance(value, int | float) and not self.least <= value <= self.most:
            raise RequestError(f"{name} = {value:g} is outside {self.least:g} to {self.most:g}")
        return value


def _is_number(value: object) -> bool:
    # False for NaN, and for a whole number with more digits than a float has.
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max
    )


def _is_integer(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) <= _LARGEST_ID


def _is_text(value: object) -> bool:
    return isinstance(value, str) and len(value) <= LONGEST_TEXT and value.isprintable()


def _is_scalar(value: object) -> bool:
    return isinstance(value, bool) or _is_number(value) or _is_text(value)


def _is_value(value: object) -> bool:
    return _is_scalar(value) or (
        isinstance(value, list) and len(value) <= LONGEST_LIST and all(map(_is_scalar, value))
    )


def _is_numbers(value: object) -> bool:
    return isinstance(value, list) and len(value) <= LONGEST_LIST and all(map(_is_number, value))


def _is_texts(value: object) -> bool:
    return isinstance(value, list) and len(value) <= LONGEST_LIST and all(map(_is_text, value))


def _is_values(value: object) -> bool:
    return (
        isinstance(value, dict)
        and 0 < len(value) <= LONGEST_LIST
        and all(map(_is_text, value))
        and all(map(_is_value, value.values()))
    )


_KINDS = {
    "number": _is_number,
    "integer": _is_integer,
    "boolean": lambda value: isinstance(value, bool),
    "text": _is_text,
    "value": _is_value,
    "numbers": _is_numbers,
    "texts": _is_texts,
    "values": _is_values,
}
_WORDS = {
    "number": "a finite number",
    "integer": "a whole number",
    "boolean": "true or false",
    "text": f"a text of at most {LONGEST_TEXT} characters in one line",
    "value": "a number, a text, true, false, or a list of them",
    "numbers": f"a list of at most {LONGEST_LIST} finite numbers",
    "texts": f"a list of at most {LONGEST_LIST} texts",
    "values": f"an object of 1 to {LONGEST_LIST} values by their names",
}


@dataclass(frozen=True)
class Verb:
    """What can be asked for: the right that it needs and its fields."""

    needs: Needs
    fields: Mapping[str, Field] = field(default_factory=dict)


_LOOP_NODE = Field("text", required=False, choices=LOOP)
_OPTIONAL_COUNT = Field("integer", required=False, least=0, most=400)
_IDENTIFICATION = {
    "bag": Field("text"),
    "order": _OPTIONAL_COUNT,
    "method": Field("text", required=False),
    "reduced_order": _OPTIONAL_COUNT,
    "known_modes_hz": Field("numbers", required=False),
    # Of a record that was dropped on the page.
    "inputs": Field("texts", required=False),
    "outputs": Field("texts", required=False),
    "times": Field("texts", required=False),
}
_TUNING = {
    "law": Field("text"),
    "models": Field("texts"),
    "gain_margin_db": Field("number", required=False, least=0.0, most=60.0),
    "phase_margin_deg": Field("number", required=False, least=0.0, most=179.0),
}

VERBS: Mapping[str, Verb] = MappingProxyType(
    {
        "status": Verb(Needs.NOTHING),
        "get": Verb(Needs.NOTHING, {"node": Field("text", required=False)}),
        "bags": Verb(Needs.NOTHING),
        "signals": Verb(Needs.NOTHING, {"bag": Field("text")}),
        "stop": Verb(Needs.TOKEN),
        "hold": Verb(Needs.TOKEN),
        "let_go": Verb(Needs.TOKEN),
        "record": Verb(Needs.TOKEN, {"on": Field("boolean")}),
        "identify": Verb(Needs.TOKEN, _IDENTIFICATION),
        "compare": Verb(Needs.TOKEN, _IDENTIFICATION | {"models": Field("texts")}),
        "tune": Verb(Needs.TOKEN, _TUNING),
        "identify_line": Verb(Needs.NOTHING, _IDENTIFICATION),
        "tune_line": Verb(Needs.NOTHING, _TUNING),
        "cancel": Verb(Needs.TOKEN, {"job": Field("integer", least=0, most=_LARGEST_ID)}),
        "release": Verb(Needs.HOLD),
        "activate": Verb(Needs.HOLD, {"node": _LOOP_NODE}),
        "deactivate": Verb(Needs.HOLD, {"node": _LOOP_NODE}),
        # The controller knows the travel of the arm.
        "reference": Verb(
            Needs.HOLD, {"value": Field("number"), "joint": Field("text", required=False)}
        ),
        "waveform": Verb(
            Needs.HOLD,
            {
                "kind": Field("text", choices=("none", "sine", "square", "triangle")),
                "amplitude_v": Field("number", required=False),
                "period_s": Field("number", required=False, least=0.1, most=3600.0),
                "offset_v": Field("number", required=False),
            },
        ),
        "set": Verb(
            Needs.HOLD, {"node": Field("text"), "name": Field("text"), "value": Field("value")}
        ),
        "law": Verb(Needs.HOLD, {"name": Field("text")}),
        "payload": Verb(Needs.HOLD, {"kg": Field("number", least=0.0, most=1.0)}),
        "fault": Verb(Needs.HOLD, {"name": Field("text")}),
        "experiment": Verb(Needs.HOLD, {"name": Field("text")}),
        "apply": Verb(Needs.HOLD, {"gains": Field("values"), "law": Field("text", required=False)}),
        "address": Verb(Needs.OWNER),
        "hello": Verb(Needs.OWNER),
        "task": Verb(Needs.OWNER, {"text": Field("text")}),
        "samples": Verb(Needs.OWNER, {"after": Field("integer", least=0, most=_LARGEST_ID)}),
    }
)
"""Every verb, by its name."""


@dataclass(frozen=True)
class Request:
    """Checked request: its number, its verb and the fields that were given."""

    number: int
    verb: str
    fields: Mapping[str, Any]

    @property
    def needs(self) -> Needs:
        """Right that the request needs."""
        return VERBS[self.verb].needs


def parse(text: str | bytes) -> Request:
    """Return the request that a message says.

    Raises
    ------
    RequestError
        When it is not a JSON object, or a verb or field is unknown, missing or out of its range.
    """
    try:
        message = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError):
        message = None
    if not isinstance(message, dict):
        raise RequestError('not a JSON object such as {"id": 1, "do": "status"}')
    number, verb = message.pop("id", 0), message.pop("do", None)
    if not _is_integer(number):
        raise RequestError("id: must be a whole number")
    try:
        return Request(number, *_checked(verb, message))
    except RequestError as error:
        error.number = number
        raise


def _checked(verb: object, given: Mapping[str, object]) -> tuple[str, Mapping[str, Any]]:
    if not isinstance(verb, str) or verb not in VERBS:
        shown = str(verb)[:50]
        raise RequestError(f"do = {shown!r} is not a verb{nearest(shown, VERBS)}")
    fields = VERBS[verb].fields
    for name in given:
        if name not in fields:
            allowed = ", ".join(fields) or "none"
            raise RequestError(f"{verb} has no field {name[:50]!r}; it has {allowed}")
    for name, each in fields.items():
        if each.required and name not in given:
            raise RequestError(f"{verb}: the field {name} is missing")
    return verb, {name: fields[name].checked(name, value) for name, value in given.items()}


def _no_constant(name: str) -> float:
    raise ValueError(name)
