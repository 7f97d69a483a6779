from __future__ import annotations

import os
import re
import shlex
import signal
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rcl_interfaces.srv import GetParameters
from std_msgs.msg import Float64

from flexarm_bags.check import check_bag
from flexarm_ident.models.model_parameters import write_parameter_file
from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from support.fault_campaign import MAX_AGE_PERIODS, RESTLESS
from support.recorded_samples import States
from support.system_graph import ROOT

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system


def test_up___samples_and_records_until_ctrl_c(graph: Graph, tmp_path: Path) -> None:
    bag = tmp_path / "new" / "bag"
    heard: list[ArmState] = []
    graph.node.create_subscription(ArmState, "/flexarm/state", heard.append, qos.NEWEST)
    gains = tmp_path / "gains.yaml"
    write_parameter_file(gains, {"pdp.kp": 0.75}, node="/flexarm/controller")
    others = tmp_path / "others.yaml"
    write_parameter_file(others, {"fps": 30.0}, node="/flexarm/camera")
    options = ("--rate", "100", "--payload", "0.2", "--reference", "square", "--bag", str(bag))
    control = ("--law", "pdp", "--params-file", str(gains), "--params-file", str(others))
    process = graph.run([str(ROOT / "flexarm"), "up", "--no-page", *options, *control])
    process.wait_for("/flexarm is up: pdp at 100 Hz, reference: square. Ctrl-C ends it.")
    note = f"note: {others} is also for /flexarm/camera, no node here"
    assert note in process.printed.splitlines()
    request = GetParameters.Request(names=["pdp.kp"])
    response = graph.call(GetParameters, "controller/get_parameters", request)
    assert response.values[0].double_value == 0.75
    graph.wait(lambda: any(state.command_v for state in heard), "a driven sample")
    second = graph.run([str(ROOT / "flexarm"), "up", "--no-page"])
    assert second.exit_code() == 1
    assert f"a graph runs already in ROS domain {graph.domain}: stop it" in second.printed
    again = graph.run([str(ROOT / "flexarm"), "up", "--bag", str(bag)])
    assert again.exit_code() == 1
    assert f"{bag} is there already and is not overwritten" in again.printed
    last = heard[-1].sequence

    process.send(signal.SIGINT)

    assert process.exit_code() == 0, process.printed
    assert process.printed.splitlines()[-3:] == [
        "stopping",
        f"recorded in {bag}",
        f"what the nodes printed is in {bag}.log",
    ]
    assert f"recording to {bag}" in bag.with_name("bag.log").read_text()
    states = States(bag)
    assert states.sequence[0] == 1
    assert states.sequence[-1] >= last
    assert (states.sequence[1:] - states.sequence[:-1] == 1).all()
    assert states.command_v.any()


@pytest.mark.exhaustive
def test_up___set_point_out_of_travel___is_refused_on_the_terminal(graph: Graph) -> None:
    publisher = graph.node.create_publisher(Float64, "/flexarm/reference", qos.SENT)
    process = graph.run([str(ROOT / "flexarm"), "up", "--no-page", "--rate", "50"])
    process.wait_for("/flexarm is up")
    refusal = "[flexarm.controller]: reference 9.5 V refused: the travel is"

    def is_refused() -> bool:
        publisher.publish(Float64(data=9.5))
        return refusal in process.printed

    graph.wait(is_refused, "the refusal")
    process.send(signal.SIGINT)

    assert process.exit_code() == 0, process.printed
    (*_, last) = process.printed.splitlines()
    assert last == "stopping" or last.startswith("[")
    assert "[INFO]" not in process.printed


@pytest.mark.exhaustive
def test_up___law_unknown___is_refused_without_a_bag_in_the_way(
    graph: Graph, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    process = graph.run(
        [str(ROOT / "flexarm"), "up", "--no-page", "--law", "pid", "--bag", str(bag)]
    )
    assert process.exit_code() == 1
    assert "pid" in process.printed
    assert not bag.exists()


@pytest.mark.exhaustive
def test_up___controller_killed___drive_at_zero_arm_moves_on_and_a_new_controller_takes_over(
    graph: Graph, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    heard: list[ArmState] = []
    graph.node.create_subscription(ArmState, "/flexarm/state", heard.append, qos.EVERY)
    process = graph.run(
        [
            str(ROOT / "flexarm"),
            "up",
            "--separate",
            "--no-page",
            "--reference",
            "square",
            "--law",
            "pd",
            "--bag",
            str(bag),
        ]
    )
    graph.wait(lambda: sum(bool(state.command_v) for state in heard) > 100, "a driven arm")
    setting = graph.run([str(ROOT / "flexarm"), "set", "controller", "pd.kp=1.25"])
    assert setting.exit_code() == 0, setting.printed
    (controller,) = graph.survivors("controller_node")
    os.kill(controller, signal.SIGKILL)

    process.wait_for("controller_node was ended by SIGKILL; the drive goes to zero; for another")
    graph.wait(lambda: not any(state.command_v for state in heard[-300:]), "an arm left to itself")
    # The loop and the recorder read its commands.
    process.wait_for("-p autostart:=true -p listeners:=2")
    process.wait_for("-p law:=pd -p reference:=square -p pd.kp:=1.25")
    ready = {"autostart": True, "listeners": 2}
    graph.start("controller", RESTLESS | ready, "-r", "__node:=successor")
    graph.wait(lambda: heard[-1].command_v != 0.0, "the new controller")
    process.send(signal.SIGINT)

    assert process.exit_code() == 1
    assert process.printed.splitlines()[-4:] == [
        "stopping",
        f"recorded in {bag}",
        f"what the nodes printed is in {bag}.log",
        "flexarm: controller_node was ended by SIGKILL",
    ]
    # The commands of the second controller begin anew; no sample is missing.
    assert check_bag(bag).problems == ()
    run = States(bag)
    assert run.sequence.tolist() == list(range(1, len(run.sequence) + 1))
    (undriven,) = np.nonzero(run.command_sequence == 0)
    alone = undriven[undriven > 0]
    # The last command was in force for no longer than the watchdog allows, and then none.
    last = run.command_sequence[alone[0] - 1]
    assert np.count_nonzero(run.command_sequence[: alone[0]] == last) <= MAX_AGE_PERIODS
    assert len(alone) >= 300
    assert not run.command_v[alone].any()
    assert run.command_v[alone[-1] + 1 :].any()


FAILING = """\
from flexarm_daq.rigs.rig_protocol import RigSample

class Failing:
    def open(self):
        self.count = 0

    def read(self):
        self.count += 1
        if self.count > 20:
            raise OSError("the bus is gone")
        return RigSample(0.02 * self.count, [0.0])

    def write(self, commands):
        pass

    def safe_stop(self):
        pass

    close = safe_stop
"""
FAILING_RIG = """\
name: failing
rate_hz: 50
inputs: {motor: {unit: V, limits: 5}}
outputs: {hub: {quantity: angle, unit: rad}}
joints: {hip: {input: motor, angle: hub, travel: 1}}
driver: failing.py:Failing
"""


def test_up___driver_that_fails___ends_at_once_with_the_reason(
    graph: Graph, tmp_path: Path
) -> None:
    (tmp_path / "failing.py").write_text(FAILING)
    (tmp_path / "rig.yaml").write_text(FAILING_RIG)
    rig = ("--rig", str(tmp_path / "rig.yaml"))
    process = graph.run([str(ROOT / "flexarm"), "up", "--no-page", *rig])
    assert process.exit_code() == 1
    reason = "flexarm: daq: the loop has ended: OSError: the bus is gone (failing.py:10)"
    assert process.printed.splitlines()[-1].startswith(reason)
    assert "is the DAQ node active?" not in process.printed


@pytest.mark.exhaustive
def test_up___recorder_killed___arm_goes_on_and_another_recorder_takes_its_place(
    graph: Graph, tmp_path: Path
) -> None:
    bag, second = tmp_path / "bag", tmp_path / "second"
    heard: list[ArmState] = []
    graph.node.create_subscription(ArmState, "/flexarm/state", heard.append, qos.EVERY)
    options = "--no-page", "--rate", "100", "--reference", "square", "--bag", str(bag)
    process = graph.run([str(ROOT / "flexarm"), "up", *options])
    graph.wait(lambda: sum(bool(state.command_v) for state in heard) > 100, "a driven arm")
    (recorder,) = graph.survivors("recorder_node")
    os.kill(recorder, signal.SIGKILL)

    process.wait_for("/parameter_events")
    printed = " ".join(process.printed.split())
    reported = re.search(r"the arm goes on; for another one: \S+ (.*?\]')", printed)
    assert reported is not None, printed
    before = heard[-1].sequence
    graph.wait(lambda: heard[-1].sequence > before + 300, "an arm that goes on")
    assert all(state.command_v for state in heard[-10:])
    words = shlex.split(reported[1].replace("NEW_BAG", str(second)))
    graph.run([str(ROOT / "flexarm"), *words])
    graph.wait((second / "metadata.yaml").exists, "the second record")
    process.send(signal.SIGINT)

    assert process.exit_code() == 1
    assert "flexarm: recorder_node was ended by SIGKILL" in process.printed.splitlines()[-1]
    printed = " ".join(process.printed.split())
    assert f"recorded in {bag}: its end is missing, try `" in printed
