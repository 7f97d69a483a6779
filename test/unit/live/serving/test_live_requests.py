"""Requests of pages and terminals: what is let through to the last bound, and the words else."""

from __future__ import annotations

import json
import sys

import pytest

from flexarm_core.channels import TRAVEL_V
from flexarm_live.serving.requests import LONGEST_LIST, LONGEST_TEXT, Needs, RequestError, parse

LARGEST_ID = 2**53
"""Above it a browser's numbers skip some."""


def parsed(verb: str, **fields: object) -> dict[str, object]:
    return dict(parse(json.dumps({"do": verb, **fields})).fields)


def refusal(text: str | bytes) -> RequestError:
    with pytest.raises(RequestError) as caught:
        parse(text)
    return caught.value


def refused(verb: str, **fields: object) -> str:
    return str(refusal(json.dumps({"do": verb, **fields})))


RIGHTS = {
    Needs.NOTHING: "status get bags signals identify_line tune_line",
    Needs.TOKEN: "stop hold let_go record identify compare tune cancel",
    Needs.HOLD: (
        "release activate deactivate reference waveform set law payload fault experiment apply"
    ),
    Needs.OWNER: "address hello task samples",
}
FIELDS: dict[str, dict[str, object]] = {
    "record": {"on": True},
    "identify": {"bag": "b"},
    "identify_line": {"bag": "b"},
    "compare": {"bag": "b", "models": ["m"]},
    "signals": {"bag": "b"},
    "tune": {"law": "pdp", "models": ["m"]},
    "tune_line": {"law": "pdp", "models": []},
    "cancel": {"job": 1},
    "reference": {"value": 1.5},
    "waveform": {"kind": "sine"},
    "set": {"node": "daq", "name": "rate_hz", "value": 300.0},
    "law": {"name": "pdp"},
    "payload": {"kg": 0.2},
    "fault": {"name": "none"},
    "experiment": {"name": "prbs"},
    "apply": {"gains": {"kp": 1.0}},
    "task": {"text": "trial"},
    "samples": {"after": 0},
}


@pytest.mark.parametrize(
    ("needs", "verb"), [(needs, verb) for needs, verbs in RIGHTS.items() for verb in verbs.split()]
)
def test_verb___with_what_it_must_have___needs_its_right(needs: Needs, verb: str) -> None:
    fields = FIELDS.get(verb, {})
    request = parse(json.dumps({"id": 5, "do": verb, **fields}))
    assert (request.number, request.verb, request.needs) == (5, verb, needs)
    assert dict(request.fields) == fields


@pytest.mark.parametrize(
    ("verb", "name"), [(v, name) for v, each in FIELDS.items() for name in each]
)
def test_field_that_a_verb_must_have___left_out___is_named(verb: str, name: str) -> None:
    fields = {each: value for each, value in FIELDS[verb].items() if each != name}
    assert refused(verb, **fields) == f"{verb}: the field {name} is missing"


@pytest.mark.parametrize(
    ("verb", "more"),
    [
        ("get", {"node": "daq"}),
        ("activate", {"node": "daq"}),
        ("deactivate", {"node": "controller"}),
        ("identify", {"order": 0, "method": "orse", "reduced_order": 0, "known_modes_hz": [9.0]}),
        ("identify", {"order": 400, "reduced_order": 400, "known_modes_hz": []}),
        ("identify_line", {"order": 8, "method": "auto"}),
        ("tune", {"gain_margin_db": 0.0, "phase_margin_deg": 0.0}),
        ("tune", {"gain_margin_db": 60.0, "phase_margin_deg": 179.0}),
        ("tune_line", {"gain_margin_db": 6}),
        ("waveform", {"amplitude_v": -TRAVEL_V, "period_s": 0.1, "offset_v": -TRAVEL_V}),
        ("waveform", {"amplitude_v": TRAVEL_V, "period_s": 3600.0, "offset_v": TRAVEL_V}),
        ("apply", {"law": "pdp"}),
    ],
)
def test_field_that_a_verb_may_have___at_its_bounds___is_taken(
    verb: str, more: dict[str, object]
) -> None:
    fields = FIELDS.get(verb, {}) | more
    assert parsed(verb, **fields) == fields


@pytest.mark.parametrize(
    ("verb", "name", "least", "most"),
    [
        ("payload", "kg", 0.0, 1.0),
        ("waveform", "period_s", 0.1, 3600.0),
        ("tune", "gain_margin_db", 0.0, 60.0),
        ("tune", "phase_margin_deg", 0.0, 179.0),
        ("identify", "order", 0, 400),
        ("identify", "reduced_order", 0, 400),
        ("cancel", "job", 0, None),
        ("samples", "after", 0, None),
    ],
)
def test_number___at_its_bounds_is_taken___beyond_them_named(
    verb: str, name: str, least: float, most: float | None
) -> None:
    whole = isinstance(least, int)
    step = 1 if whole else 1e-3
    highest = LARGEST_ID if most is None else most
    for value in (least, highest):
        assert parsed(verb, **FIELDS[verb] | {name: value})[name] == value
    beyond = [least - step] if most is None else [least - step, most + step]
    for value in beyond:
        said = f"{name} = {value:g} is outside {least:g} to {highest:g}"
        assert refused(verb, **FIELDS[verb] | {name: value}) == said


def named(count: int) -> dict[str, object]:
    return {f"k{number}": number for number in range(count)}


VALUE = "value: must be a number, a text, true, false, or a list of them"
NUMBERS = f"known_modes_hz: must be a list of at most {LONGEST_LIST} finite numbers"
TEXTS = f"models: must be a list of at most {LONGEST_LIST} texts"
TEXT = f"name: must be a text of at most {LONGEST_TEXT} characters in one line"
GAINS = f"gains: must be an object of 1 to {LONGEST_LIST} values by their names"


@pytest.mark.parametrize(
    ("verb", "name", "right", "wrong", "said"),
    [
        ("record", "on", [True, False], [0, 1, "on", None, []], "on: must be true or false"),
        (
            *("payload", "kg", [0, 1, 0.5]),
            *(
                [True, False, "1", None, [1]],
                "kg: must be a finite number",
            ),
        ),
        (
            *("cancel", "job", [0, LARGEST_ID]),
            *(
                [True, 1.0, "1", None, LARGEST_ID + 1, -LARGEST_ID - 1],
                "job: must be a whole number",
            ),
        ),
        (
            "law",
            "name",
            ["", "x" * LONGEST_TEXT],
            ["x" * (LONGEST_TEXT + 1), "a\nb", 1, None],
            TEXT,
        ),
        (
            *("set", "value", [1, 1.5, True, "x", [], [1, "x", False], [0] * LONGEST_LIST]),
            *([None, {}, [[1]], [None], [0] * (LONGEST_LIST + 1), "x" * (LONGEST_TEXT + 1)], VALUE),
        ),
        (
            *("identify", "known_modes_hz", [[], [9, 24.5], [1.0] * LONGEST_LIST]),
            *([1.0, ["9"], [True], [None], [1.0] * (LONGEST_LIST + 1), {}], NUMBERS),
        ),
        (
            *("tune", "models", [[], ["a"], ["a"] * LONGEST_LIST]),
            *(["a", [1], ["a\nb"], ["a"] * (LONGEST_LIST + 1), {"a": 1}], TEXTS),
        ),
        (
            *(
                "apply",
                "gains",
                [{"kp": 1}, {"kp": [1, "x"]}, {f"k{n}": n for n in range(LONGEST_LIST)}],
            ),
            *(
                [
                    {},
                    [],
                    1,
                    {"kp": None},
                    {"a\nb": 1},
                    {f"k{n}": n for n in range(LONGEST_LIST + 1)},
                ],
                GAINS,
            ),
        ),
    ],
)
def test_kind_of_a_field___is_taken_as_it_should_be___and_named_else(
    verb: str, name: str, right: list[object], wrong: list[object], said: str
) -> None:
    for value in right:
        taken = parsed(verb, **FIELDS[verb] | {name: value})[name]
        assert taken == value
        assert type(taken) is type(value)
    for value in wrong:
        assert refused(verb, **FIELDS[verb] | {name: value}) == said


def test_largest_float___is_a_number___and_a_larger_whole_one_is_none() -> None:
    assert parsed("set", **FIELDS["set"] | {"value": sys.float_info.max})
    assert parsed("set", **FIELDS["set"] | {"value": -sys.float_info.max})
    huge = 10**400
    assert refused("set", **FIELDS["set"] | {"value": huge}) == VALUE
    assert refused("set", **FIELDS["set"] | {"value": -huge}) == VALUE


@pytest.mark.parametrize(
    ("verb", "name", "choices"),
    [
        ("activate", "node", "daq, controller"),
        ("deactivate", "node", "daq, controller"),
        ("waveform", "kind", "none, sine, square, triangle"),
    ],
)
def test_word_that_is_none_of_the_choices___is_refused_with_them(
    verb: str, name: str, choices: str
) -> None:
    for word in choices.split(", "):
        assert parsed(verb, **{name: word}) == {name: word}
    assert refused(verb, **{name: "other"}) == f"{name} = 'other': must be one of {choices}"
    shown = "y" * 50
    assert refused(verb, **{name: "y" * 60}) == f"{name} = {shown!r}: must be one of {choices}"


def test_unknown_verb_and_field___are_named___with_what_there_is() -> None:
    assert refused("stopp") == "do = 'stopp' is not a verb (nearest: stop)"
    shown = "v" * 50
    assert refused("v" * 60) == f"do = {shown!r} is not a verb"
    assert refused("status", what=1) == "status has no field 'what'; it has none"
    assert refused("cancel", job=1, jobs=2) == "cancel has no field 'jobs'; it has job"
    assert (
        refused("set", **{"n" * 60: 1})
        == f"set has no field {'n' * 50!r}; it has node, name, value"
    )
    for verb in (None, 1, ["stop"]):
        assert str(refusal(json.dumps({"do": verb}))).startswith(
            f"do = {str(verb)!r} is not a verb"
        )
    assert str(refusal("{}")).startswith("do = 'None' is not a verb")


@pytest.mark.parametrize(
    "text", ["", "stop", "[]", "1", "null", '{"do": "payload", "kg": NaN}', "[" * 100_000, b"\xff"]
)
def test_message_that_is_no_object___is_refused_with_an_example(text: str | bytes) -> None:
    found = refusal(text)
    assert str(found) == 'not a JSON object such as {"id": 1, "do": "status"}'
    assert found.number == 0


@pytest.mark.parametrize("number", [0, 1, -1, LARGEST_ID, -LARGEST_ID])
def test_number_of_a_request___comes_back___with_its_refusal_too(number: int) -> None:
    assert parse(json.dumps({"id": number, "do": "status"})).number == number
    assert refusal(json.dumps({"id": number, "do": "stopp"})).number == number
    assert refusal(json.dumps({"id": number, "do": "cancel", "job": "x"})).number == number


@pytest.mark.parametrize("number", [True, 1.0, "1", None, LARGEST_ID + 1, -LARGEST_ID - 1])
def test_number_of_a_request___that_is_no_whole_number___is_refused(number: object) -> None:
    assert refused("status", id=number) == "id: must be a whole number"


def test_request_without_a_number___has_zero() -> None:
    assert parse('{"do": "status"}').number == 0
