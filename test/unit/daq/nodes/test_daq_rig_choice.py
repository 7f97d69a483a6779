from __future__ import annotations

import pytest

from flexarm_daq.nodes.rig_choice import is_virtual


@pytest.mark.parametrize(
    ("rig", "time", "virtual"),
    [
        ("simulated", "auto", True),
        ("nidaq", "auto", False),
        ("simulated", "real", False),
        ("simulated", "virtual", True),
    ],
)
def test_time___auto___is_virtual_for_the_simulated_rig_alone(
    rig: str, time: str, *, virtual: bool
) -> None:
    assert is_virtual({"rig": rig, "time": time}) == virtual
