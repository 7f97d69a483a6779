from __future__ import annotations

import pytest

from flexarm_core.nearest import nearest_node

NODES = ["/flexarm/controller", "/flexarm/daq", "/arm2/daq", "/arm2/recorder"]


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("/arm2/controler", "/arm2/recorder"),
        ("/flexarm/contoller", "/flexarm/controller"),
        ("/arm3/controller", "/flexarm/controller"),
    ],
)
def test_nearest_node___is_one_of_the_arm_that_was_named(name: str, nearest: str) -> None:
    assert nearest_node(name, NODES) == f" (nearest: {nearest})"


def test_nearest_node___of_an_empty_graph___is_none() -> None:
    assert nearest_node("/arm2/daq", []) == ""
