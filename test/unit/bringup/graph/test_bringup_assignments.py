"""Values that a user types, as the kinds of a node's parameters."""

from __future__ import annotations

from typing import Any

import pytest

from flexarm_bringup.graph.assignments import assigned, parsed
from flexarm_bringup.graph.processes import LaunchError

PRESENT = {
    "pdpc.kp": 1.5,
    "law": "pd",
    "samples": 0,
    "autostart": False,
    "topics": ["state"],
    "payload_kg": 0.0,
    "rate_hz": 300.0,
    "answer_timeout_s": 0.5,
    "max_command_v": 10.0,
    "self_test": "auto",
    "ilqr.states": [0.0],
}


@pytest.mark.parametrize(
    ("assignment", "value"),
    [
        ("pdpc.kp=2", 2.0),
        ("pdpc.kp=2e0", 2.0),
        ("pdpc.kp=.inf", float("inf")),
        ("law=pdpc", "pdpc"),
        ("samples=300", 300),
        ("payload_kg=200g", 0.2),
        ("payload_kg=0.2 kg", 0.2),
        ("rate_hz=1kHz", 1000.0),
        ("answer_timeout_s=50ms", 0.05),
        ("max_command_v=500mV", 0.5),
        ("autostart=true", True),
        ("autostart=on", True),
        ("autostart=off", False),
        # As a node's choice, where YAML has a boolean.
        ("self_test=off", "off"),
        ("self_test=on", "on"),
        ("topics=[state, io]", ["state", "io"]),
        ("ilqr.states=[2, .4, 1e-4]", [2.0, 0.4, 1e-4]),
        ("ilqr.states=1e-4", [1e-4]),
    ],
)
def test_assigned___value_of_the_kind___is_taken(assignment: str, value: object) -> None:
    name, typed = parsed(assignment)
    found = assigned("controller", {name: typed}, PRESENT)
    assert found == {name: value}
    assert type(found[name]) is type(value)


@pytest.mark.parametrize(
    ("assignment", "kind"),
    [
        ("pdpc.kp=abc", "a number"),
        ("pdpc.kp=2V", "a number"),
        ("pdpc.kp=.nan", "a number"),
        ("pdpc.kp=nan", "a number"),
        ("payload_kg=heavy", r"a number, or one with its unit \(kg, g\)"),
        ("payload_kg=2lb", r"a number, or one with its unit \(kg, g\)"),
        ("pdpc.kp=true", "a number"),
        ("pdpc.kp=[1, 2]", "a number"),
        ("pdpc.kp=", "a number"),
        ("law=3", "a text"),
        ("samples=3.5", "a whole number"),
        ("samples=true", "a whole number"),
        ("autostart=1", "true or false"),
        ("ilqr.states=[1, many]", r"numbers, such as \[1.0, 2.0\]"),
        ("ilqr.states=true", r"numbers, such as \[1.0, 2.0\]"),
    ],
)
def test_assigned___value_of_another_kind___is_named_with_what_it_must_be(
    assignment: str, kind: str
) -> None:
    name, typed = parsed(assignment)
    values: dict[str, Any] = {name: typed}
    with pytest.raises(LaunchError, match=rf"^controller {name} = .*: must be {kind}$") as refusal:
        assigned("controller", values, PRESENT)
    assert len(str(refusal.value)) < 200


def test_assigned___unknown_name___comes_with_the_nearest() -> None:
    with pytest.raises(LaunchError, match=r"no parameter pdpc.kq \(nearest: pdpc.kp\)"):
        assigned("controller", {"pdpc.kq": 1.0}, PRESENT)
