"""Signals of the thesis's arm, which only its own parts name: any other arm has other ones."""

from __future__ import annotations

import re
from typing import Final

from support.import_graph import SOURCES

_SIGNAL: Final = re.compile(r"\b(position_v|base_strain_v|middle_strain_v|speed_v)\b")
# Descriptions, messages and views of the thesis's arm, its laws and their models.
_OF_THE_THESIS: Final = (
    "flexarm_bringup/config",
    "flexarm_control/flexarm_control/design",
    "flexarm_control/flexarm_control/laws",
    "flexarm_control/flexarm_control/learning",
    "flexarm_control/flexarm_control/models",
    "flexarm_control/flexarm_control/planning",
    "flexarm_control/flexarm_control/shaping",
    "flexarm_core/flexarm_core/rigs/packaged",
    "flexarm_msgs/msg/ArmState.msg",
)
# The rest, which is to go: nothing is added here, and a file that names none of them leaves.
_LEFT: Final = {
    "flexarm_bringup/flexarm_bringup/runs/loop_bag.py",
    "flexarm_bringup/flexarm_bringup/verbs/simulated/learn.py",
    "flexarm_control/flexarm_control/commissioning/programme.py",
    "flexarm_control/flexarm_control/joint_laws.py",
    "flexarm_control/flexarm_control/simulation.py",
    "flexarm_ident/flexarm_ident/fitting/validation.py",
    "flexarm_ident/flexarm_ident/records/preprocess.py",
    "flexarm_ident/flexarm_ident/report/plots/time_plots.py",
}


def test_signals_of_the_thesis_s_arm___are_named___by_its_own_parts_alone() -> None:
    files = (
        each for each in SOURCES.rglob("*") if each.suffix in {".py", ".yaml", ".msg", ".json"}
    )
    naming = {
        str(each.relative_to(SOURCES)) for each in files if _SIGNAL.search(each.read_text("utf-8"))
    }
    assert {each for each in naming if not each.startswith(_OF_THE_THESIS)} == _LEFT
