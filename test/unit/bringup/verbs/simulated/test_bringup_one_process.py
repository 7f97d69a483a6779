"""Options of demo and design that need nodes, where there are none."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.simulated.demo import demo
from flexarm_bringup.verbs.simulated.design import design

if TYPE_CHECKING:
    from pathlib import Path

    import click


@pytest.mark.parametrize("verb", [demo, design])
@pytest.mark.parametrize("option", ["--live", "--real-time"])
def test_option_of_nodes___without_ros___is_refused_by_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, verb: click.Command, option: str
) -> None:
    monkeypatch.delitem(sys.modules, "flexarm_bringup.verbs.simulated.node_run", raising=False)
    monkeypatch.setitem(sys.modules, "rclpy.parameter", None)
    refused = CliRunner().invoke(verb, [option, "--out", str(tmp_path / "out")])
    assert isinstance(refused.exception, LaunchError)
    assert str(refused.exception).startswith(f"{option} needs nodes")
    assert not (tmp_path / "out").exists()
