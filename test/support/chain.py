"""From an experiment to a controller that is moved from the page: the chain on any rig."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING

import numpy as np
from websockets.sync.client import connect

from flexarm_core.rig_description import load_rig
from flexarm_ident import read_bag
from flexarm_ident.models.files import load_model
from flexarm_live.graph.about import columns_of
from support.live_server import ask, frame_after
from support.system_graph import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    import control

    from support.system_graph import Graph, Process

GOAL_RAD = 0.3


def driven_chain(
    graph: Graph, rig: str, folder: Path, experiment: str, *pace: str
) -> control.StateSpace:
    """Record, identify, design, and turn each joint to a set-point of the page.

    Parameters
    ----------
    graph : Graph
        ROS domain of the verbs.
    rig : str
        Name or file of the rig, whose tracked outputs are the angles of its joints.
    folder : Path
        Place of what is written.
    experiment : str
        Name of the experiment.
    *pace : str
        Options of the experiment.

    Returns
    -------
    control.StateSpace
        The model that was identified.
    """
    description = load_rig(rig)
    carry_out(graph, "experiment", experiment, "--rig", rig, "-o", str(folder), *pace)
    record = read_bag(folder / experiment)
    assert (record.inputs, record.outputs) == (description.input_names, description.output_names)
    largest = np.array([each.high for each in description.inputs])
    assert (np.abs(record.u).max(axis=0) <= largest * (1.0 + 1e-9)).all()

    carry_out(graph, "identify", str(folder / experiment), "-o", str(folder / "model"))
    model = folder / "model" / "model.yaml"
    tracked = [word for name in description.tracked for word in ("--track", name)]
    carry_out(graph, "design", str(model), *tracked, "-o", str(folder / "servo"))

    controller = str(folder / "servo" / "controller.yaml")
    words = ["up", "--port", "0", "--rig", rig, "--controller", controller]
    running = graph.run([str(ROOT / "flexarm"), *words])
    running.wait_for("is up: servo at")
    running.wait_for("#token=")
    (address,) = (line for line in running.printed.splitlines() if line.startswith("http"))
    columns = columns_of(description)
    # The first column of a frame is the time.
    angles = [1 + columns.index(joint.angle) for joint in description.joints]
    live = address.replace("http", "ws", 1).replace("/#", "/live?")
    with connect(live, compression=None, ping_interval=None) as page:
        frame_after(page, lambda frame: np.isfinite(frame[-1, angles]).all())
        for joint in description.joints:
            reply = ask(page, do="reference", joint=joint.name, value=GOAL_RAD)
            assert reply["ok"], reply
        frame_after(page, lambda frame: (np.abs(frame[-1, angles] - GOAL_RAD) < 0.015).all())
    running.send(signal.SIGINT)
    assert running.exit_code() == 0, running.printed
    return load_model(model)


def carry_out(graph: Graph, *words: str) -> Process:
    """Run a verb to its end, which must be a success."""
    process = graph.run([str(ROOT / "flexarm"), *words])
    assert process.exit_code() == 0, process.printed
    return process
