"""From an experiment to a controller in the loop, on an arm of MuJoCo, which nobody here wrote."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.rig_description import load_rig
from flexarm_ident import read_bag
from flexarm_msgs.msg import IoSample
from flexarm_msgs.srv import SetReference
from flexarm_node import qos
from support.system_graph import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = [pytest.mark.system, pytest.mark.slow]
RIG = "mujoco-two-link"


def test_arm_of_mujoco___is_recorded_identified_and_controlled(
    graph: Graph, tmp_path: Path
) -> None:
    pytest.importorskip("mujoco", reason="the extra of requirements/mujoco.in is not installed")
    rig, flexarm = load_rig(RIG), str(ROOT / "flexarm")
    experiment = ["experiment", "O_dat8", "--fast", "--rig", RIG, "-o", str(tmp_path)]
    recording = graph.run([flexarm, *experiment])
    assert recording.exit_code() == 0, recording.printed
    record = read_bag(tmp_path / "O_dat8")
    assert (record.inputs, record.outputs) == (rig.input_names, rig.output_names)
    assert len(record.u) == 4999
    # Of 10 V, for which the limits stand, 2 V.
    largest = [0.2 * each.high for each in rig.inputs]
    np.testing.assert_array_less(np.abs(record.u).max(axis=0), np.multiply(largest, 1.0 + 1e-9))

    tracked = [word for name in rig.tracked for word in ("--track", name)]
    design = ["design", str(tmp_path / "O_dat8"), *tracked, "-o", str(tmp_path / "servo")]
    designing = graph.run([flexarm, *design])
    assert designing.exit_code() == 0, designing.printed

    heard: list[IoSample] = []
    graph.node.create_subscription(IoSample, "io", heard.append, qos.NEWEST)
    controller = str(tmp_path / "servo" / "controller.yaml")
    running = graph.run([flexarm, "up", "--no-page", "--rig", RIG, "--controller", controller])
    running.wait_for("is up: servo at")
    for joint in rig.joints:
        request = SetReference.Request(reference_v=0.3, joint=joint.name)
        assert graph.call(SetReference, "set_reference", request).success
    graph.wait(lambda: bool(heard), "a sample")
    places = [rig.output_names.index(joint.angle) for joint in rig.joints]
    graph.wait(
        lambda: all(abs(heard[-1].outputs[place] - 0.3) < 0.015 for place in places),
        "the set-points",
    )
    running.send(signal.SIGINT)
    assert running.exit_code() == 0, running.printed
