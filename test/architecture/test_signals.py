"""Signals of the thesis's arm, which only its own parts name: any other arm has other ones."""

from __future__ import annotations

import re
from typing import Final

from support.import_graph import SOURCES

# Their names, and their number.
_SIGNAL: Final = re.compile(
    r"\b(?:(?:position|base_strain|middle_strain|speed)_v\b|len\(CHANNEL(?:S|_NAMES)\))"
)
# Descriptions, messages and views of the thesis's arm, its rigs, its laws and their models.
_OF_THE_THESIS: Final = (
    "flexarm_bringup/config",
    "flexarm_bringup/flexarm_bringup/verbs/health/hardware.py",
    "flexarm_bringup/flexarm_bringup/verbs/simulated/learn.py",
    "flexarm_control/flexarm_control/design",
    "flexarm_control/flexarm_control/laws",
    "flexarm_control/flexarm_control/learning",
    "flexarm_control/flexarm_control/models",
    "flexarm_control/flexarm_control/planning",
    "flexarm_control/flexarm_control/shaping",
    "flexarm_core/flexarm_core/rigs/packaged",
    "flexarm_daq/flexarm_daq/rigs",
    "flexarm_msgs/msg/ArmState.msg",
)


def test_signals_of_the_thesis_s_arm___are_named___by_its_own_parts_alone() -> None:
    files = (
        each for each in SOURCES.rglob("*") if each.suffix in {".py", ".yaml", ".msg", ".json"}
    )
    naming = {
        str(each.relative_to(SOURCES)) for each in files if _SIGNAL.search(each.read_text("utf-8"))
    }
    assert {each for each in naming if not each.startswith(_OF_THE_THESIS)} == set()
