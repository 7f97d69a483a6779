"""Nodes on rigs that are not the thesis's arm: twins of known models with one and two motors."""

from __future__ import annotations

import signal
from typing import TYPE_CHECKING, Any

import control
import numpy as np
import pytest
from std_msgs.msg import String
from std_srvs.srv import Trigger
from websockets.sync.client import connect

from flexarm_control.replaying.comparison import read_loop, replay
from flexarm_control.servo.files import save_controller
from flexarm_control.servo.job import ServoRequest, design_servo
from flexarm_control.twin import twin_description
from flexarm_core.rig_description import described, load_rig
from flexarm_ident import identify, read_bag
from flexarm_ident.models.files import save_model
from flexarm_live.graph.about import columns_of
from flexarm_msgs.msg import IoSample
from flexarm_node import qos
from support.live_server import ask, frame_after
from support.servo_plants import DT_S, bending_arm, measured_arm, two_joints
from support.system_graph import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_core.rig_description import RigDescription
    from support.system_graph import Graph, Process

pytestmark = pytest.mark.system

# Twin whose last reading is not a number as soon as a file is there.
BREAKING = """
import math
from pathlib import Path

from flexarm_control.twin import TwinRig

class Breaking(TwinRig):
    def read(self):
        sample = super().read()
        if Path(__file__).with_name("broken").exists():
            sample.outputs[-1] = math.nan
        return sample
"""
TOPICS = ["commander", "law", "rig_description", "io", "io_channels", "io_command", "io_reference"]


def one_motor() -> control.StateSpace:
    """Return a hub with a vibration: one input, two outputs."""
    return bending_arm()


def two_motors(dt_s: float = DT_S) -> control.StateSpace:
    """Return two joints with angles, rates and a sum: two inputs, five outputs."""
    model = two_joints(dt_s)
    states = np.eye(4)
    rows = np.vstack([states, states[0] + states[1]])
    names = ["hub1", "hub2", "rate1", "rate2", "sum"]
    return control.StateSpace(
        *(model.A, model.B, rows, 0.0, model.dt), inputs=model.input_labels, outputs=names
    )


def rig_of(folder: Path, model: control.StateSpace) -> tuple[Path, RigDescription]:
    """Write a model and the description of its twin."""
    ends = {
        "input_low": [-1.0] * model.ninputs,
        "input_high": [1.0] * model.ninputs,
        "output_low": [-1.0] * model.noutputs,
        "output_high": [1.0] * model.noutputs,
        "noise_sd": [1e-4] * model.noutputs,
    }
    save_model(folder / "model.yaml", model, name="arm", provenance=ends)
    file = folder / "rig.yaml"
    file.write_text(twin_description(folder / "model.yaml"))
    return file, described(file.read_text())


def start(graph: Graph, rig: Path, daq: dict[str, Any], **controller: object) -> Process:
    """Start the loop on a rig, up to the sampling; return the process of the controller."""
    graph.start("recorder", {"topics": TOPICS})
    process = graph.start("controller", {"rig": str(rig), "law": "pd", **controller})
    graph.start("daq", {"rig": str(rig), **daq})
    graph.activate_loop()
    return process


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(one_motor(), marks=pytest.mark.exhaustive, id="one motor"),
        pytest.param(two_motors(), id="two motors"),
    ],
)
def test_rig___is_moved_recorded_and_replayed(
    graph: Graph, tmp_path: Path, model: control.StateSpace
) -> None:
    file, rig = rig_of(tmp_path, model)
    start(graph, file, {"real_time_factor": 0.0}, **{"reference": "step", "step.amplitude_v": 2.0})
    bag = tmp_path / "bag"
    graph.operator.record(str(bag))
    graph.operator.sample(5000, lambda _: None)
    graph.operator.record(None)

    data = read_bag(bag)
    assert (data.inputs, data.outputs) == (rig.input_names, rig.output_names)
    assert (len(data.u), data.dt_s, data.closed_loop) == (4999, 0.002, True)
    # 2 V of 6.857 V, of a travel of 1.5.
    angles = [data.outputs.index(joint.angle) for joint in rig.joints]
    np.testing.assert_allclose(data.y[-1, angles], 2.0 / 6.857142857 * 1.5, atol=0.02)
    # The input that acts from a sample on gives the next one.
    free = (
        model.A @ np.linalg.lstsq(model.C, data.y[:-1].T, rcond=None)[0] + model.B @ data.u[:-1].T
    )
    if model.noutputs > model.nstates:
        np.testing.assert_allclose((model.C @ free).T, data.y[1:], atol=2e-3)
    found = replay(read_loop(bag))
    assert (found.compared, found.differences) == (5000, ())


@pytest.mark.exhaustive
def test_up___its_page___moves_each_joint_stops_and_releases(graph: Graph, tmp_path: Path) -> None:
    file, rig = rig_of(tmp_path, two_motors())
    bag = tmp_path / "bag"
    reported: list[str] = []
    graph.node.create_subscription(
        String, "rig_description", lambda message: reported.append(message.data), qos.STATUS
    )
    words = ["up", "--rig", str(file), "--bag", str(bag), "--port", "0"]
    process = graph.run([str(ROOT / "flexarm"), *words])
    process.wait_for("#token=")
    (address,) = (line for line in process.printed.splitlines() if line.startswith("http"))
    places = {name: place for place, name in enumerate(columns_of(rig), start=1)}
    angles, inputs = (
        [places[name] for name in each] for each in (("hub1", "hub2"), rig.input_names)
    )
    live = address.replace("http", "ws", 1).replace("/#", "/live?")
    with connect(live, compression=None, ping_interval=None) as page:

        def done(**request: object) -> None:
            reply = ask(page, **request)
            assert reply["ok"], reply

        # A controller that has seen where the joints are.
        frame_after(page, lambda frame: frame[-1, inputs].all())
        done(do="reference", joint="joint_1", value=0.5)
        done(do="reference", joint="hub2", value=-0.25)
        for joint, value, said in (
            ("joint_3", 0.1, "no joint 'joint_3'"),
            ("", 0.1, "name one"),
            ("joint_1", 1.6, "the travel of joint_1 is -1.5 to 1.5"),
        ):
            assert said in ask(page, do="reference", joint=joint, value=value)["message"]
        frame_after(page, lambda frame: np.allclose(frame[-1, angles], (0.5, -0.25), atol=0.02))
        done(do="reference", joint="joint_1", value=-0.5)
        frame_after(page, lambda frame: frame[-1, inputs].all())
        done(do="stop")
        frame_after(page, lambda frame: not frame[:, inputs].any())
        done(do="release")
        frame_after(page, lambda frame: frame[-1, inputs].all())
    graph.wait(lambda: bool(reported), "the description")
    assert reported == [file.read_text()]
    process.send(signal.SIGINT)
    assert process.exit_code() == 0, process.printed
    found = replay(read_loop(bag))
    assert found.compared > 100
    assert found.differences == ()


@pytest.mark.exhaustive
def test_up___twin_of_a_measured_arm_under_its_servo___both_joints_go_where_they_are_put(
    graph: Graph, tmp_path: Path
) -> None:
    request = ServoRequest(("hub1_deg", "hub2_deg"), {}, bandwidth_hz=0.65)
    save_controller(tmp_path / "controller.yaml", design_servo([measured_arm()], request).gains)
    bag = tmp_path / "bag"
    words = ["up", "--rig", "quanser-2dsfl", "--port", "0", "--bag", str(bag)]
    process = graph.run(
        [str(ROOT / "flexarm"), *words, "--controller", str(tmp_path / "controller.yaml")]
    )
    process.wait_for("#token=")
    (address,) = (line for line in process.printed.splitlines() if line.startswith("http"))
    columns = ["time", *columns_of(load_rig("quanser-2dsfl"))]
    angles = [columns.index(name) for name in ("hub1_deg", "hub2_deg")]
    live = address.replace("http", "ws", 1).replace("/#", "/live?")
    with connect(live, compression=None, ping_interval=None) as page:
        frame_after(page, lambda frame: len(frame) > 0)
        reply = ask(page, do="reference", joint="shoulder", value=10.0)
        assert reply["ok"], reply
        put = graph.run([str(ROOT / "flexarm"), "reference", "elbow", "5deg"])
        assert put.exit_code() == 0, put.printed
        # A twentieth of each step.
        frame_after(
            page, lambda frame: (np.abs(frame[:, angles] - (10.0, 5.0)) < (0.5, 0.25)).all()
        )
    process.send(signal.SIGINT)
    assert process.exit_code() == 0, process.printed
    found = replay(read_loop(bag))
    assert found.compared > 100
    assert found.differences == ()


@pytest.mark.exhaustive
def test_experiment_in_closed_loop___of_two_motors___is_recorded_and_identified(
    graph: Graph, tmp_path: Path
) -> None:
    model = two_motors(0.008)
    file, _ = rig_of(tmp_path, model)
    words = ["experiment", "C_dat3", "--fast", "--rig", str(file), "-o", str(tmp_path / "out")]
    process = graph.run([str(ROOT / "flexarm"), *words])
    assert process.exit_code() == 0, process.printed
    bag = tmp_path / "out" / "C_dat3"
    record = read_bag(bag)
    assert (len(record.u), record.closed_loop) == (4999, True)
    assert np.abs(record.u).max() <= 1.0
    assert np.abs(record.y[:, :2]).max() < 1.5
    assert sorted(each.name for each in bag.parent.iterdir()) == [
        "C_dat3",
        "experiments.json",
        "nodes.log",
    ]
    at = np.exp(2j * np.pi * record.dt_s)
    gains = np.abs(model(at)[:2])
    found = identify(record, order=4, block_rows=20)
    assert np.abs(np.abs(found.model(at)[:2]) - gains).max() < 0.02 * gains.max()
    assert replay(read_loop(bag)).differences == ()


@pytest.mark.parametrize(
    ("end", "model"),
    [
        # The watchdog that ends a hang ends this as well.
        pytest.param("kill", one_motor(), marks=pytest.mark.exhaustive, id="kill"),
        pytest.param("hang", two_motors(), marks=pytest.mark.exhaustive, id="hang"),
        pytest.param("emergency stop", two_motors(), id="emergency stop"),
        pytest.param("sensor fault", one_motor(), marks=pytest.mark.exhaustive, id="sensor fault"),
    ],
)
def test_drives___of_all_inputs___go_to_zero(
    graph: Graph, tmp_path: Path, end: str, model: control.StateSpace
) -> None:
    file, _ = rig_of(tmp_path, model)
    if end == "sensor fault":
        (tmp_path / "breaking.py").write_text(BREAKING)
        text = file.read_text()
        assert "driver: twin" in text
        file.write_text(text.replace("driver: twin", "driver: breaking.py:Breaking"))
    samples: list[IoSample] = []
    graph.node.create_subscription(IoSample, "io", samples.append, qos.EVERY)
    wave = {"reference": "square", "square.period_s": 0.4}
    controller = start(graph, file, {"time": "real"}, **wave)
    assert graph.transition("daq", "activate")
    graph.wait(lambda: any(np.abs(each.inputs).min() > 0.1 for each in samples), "all drives")
    if end == "kill":
        graph.stop(controller, signal.SIGKILL)
    elif end == "hang":
        controller.send(signal.SIGSTOP)
    elif end == "emergency stop":
        assert graph.call(Trigger, "emergency_stop", Trigger.Request()).success
    else:
        (tmp_path / "broken").touch()
        graph.wait(lambda: bool(np.isnan(samples[-1].outputs[-1])), "the sensor's fault")
    samples.clear()
    graph.wait(lambda: len(samples) > 100, "samples behind the end")
    # Three periods, and what was on its way.
    assert all(not np.any(each.inputs) for each in samples[50:])
    if end == "hang":
        # A process that is stopped takes no other signal.
        graph.stop(controller, signal.SIGKILL)
