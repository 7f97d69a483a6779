"""From an experiment to a controller in the loop, on an arm of MuJoCo, which nobody here wrote."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from support.chain import driven_chain

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = [pytest.mark.system, pytest.mark.slow]


def test_arm_of_mujoco___is_recorded_identified_and_moved_from_the_page(
    graph: Graph, tmp_path: Path
) -> None:
    pytest.importorskip("mujoco", reason="the extra of requirements/mujoco.in is not installed")
    driven_chain(graph, "mujoco-two-link", tmp_path, "C_dat3", "--fast")
