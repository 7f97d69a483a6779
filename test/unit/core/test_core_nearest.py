from __future__ import annotations

import pytest

from flexarm_core.errors import nearest, nearest_node

NODES = ["/flexarm/controller", "/flexarm/daq", "/arm2/daq", "/arm2/recorder"]


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("/arm2/controler", "/arm2/recorder"),
        ("/flexarm/contoller", "/flexarm/controller"),
        ("/arm3/controller", "/flexarm/controller"),
    ],
)
def test_nearest_node___is_one_of_the_arm_that_was_named(name: str, near: str) -> None:
    assert nearest_node(name, NODES) == f" (nearest: {near})"


@pytest.mark.parametrize(
    ("name", "known", "reported"),
    [
        ("kp", ["law", "pdpc.kp", "reference"], " (nearest: pdpc.kp)"),
        ("payload", ["seed", "payload_kg"], " (nearest: payload_kg)"),
        ("nonsense", ["listeners", *"abcdefghi"], ""),
        ("zzz", ["daq", "controller"], " (known: daq, controller)"),
        ("zzz", [f"gain_{number}" for number in range(9)], ""),
        ("zzz", [], ""),
    ],
)
def test_nearest___is_a_name_that_is_like_it___else_the_few_there_are(
    name: str, known: list[str], reported: str
) -> None:
    assert nearest(name, known) == reported


def test_nearest_node___of_an_empty_graph___is_none() -> None:
    assert nearest_node("/arm2/daq", []) == ""
