"""A robot of ROS 2 in a process of its own, driven by the driver `topics`."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections import deque
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest
import rclpy
from std_msgs.msg import Float64

from flexarm_daq.drivers.topics.inbox import TopicsSettings
from flexarm_daq.drivers.topics.rig import TopicsRig
from flexarm_daq.rigs.rig_protocol import RigError
from support.chain import driven_chain
from support.robot import DRAG, INERTIA
from support.system_graph import claim_domain

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = [pytest.mark.system, pytest.mark.slow]

# In open loop the joints go round.
RIG = """\
name: robot
rate_hz: 200
inputs:
  shoulder_nm: {quantity: torque, unit: N m, limits: 1}
  elbow_nm: {quantity: torque, unit: N m, limits: 1}
outputs:
  shoulder_rad: {quantity: angle, unit: rad}
  elbow_rad: {quantity: angle, unit: rad}
joints:
  shoulder: {input: shoulder_nm, angle: shoulder_rad, travel: 12}
  elbow: {input: elbow_nm, angle: elbow_rad, travel: 12}
driver: topics
settings:
  commands: /effort_controller/commands
  outputs: ["position:shoulder", "position:elbow"]
  stale_s: 60
"""
# A busy machine holds the robot back.
SETTINGS = TopicsSettings(
    "/effort_controller/commands",
    ("position:shoulder", "velocity:shoulder", "position:elbow", "imu:/tip/imu:angular_velocity.z"),
    stale_s=5.0,
)


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    number, claim = claim_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    yield
    os.close(claim)


@contextmanager
def running_robot(environment: Mapping[str, str]) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-m", "support.robot"],
        env={**environment, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert reported(process) == "ready"
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def robot(domain: None) -> Iterator[subprocess.Popen[str]]:
    del domain
    with running_robot(os.environ) as process:
        yield process


def reported(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


@contextmanager
def opened() -> Iterator[TopicsRig]:
    rig = TopicsRig(SETTINGS, 2)
    rig.open()
    try:
        yield rig
    finally:
        rig.close()


def test_robot___controlled_by_its_topics___turns_to_the_goal(
    robot: subprocess.Popen[str],
) -> None:
    with opened() as rig:
        readings = np.zeros(4)
        time_s = 0.0
        while time_s < 3.0:
            time_s, readings, _ = rig.read()
            rig.write([2.0 * (0.5 - readings[0]) - 0.5 * readings[1], 0.0])
            # The elbow is not commanded, so that the tip turns with the shoulder.
            assert readings[2] == pytest.approx(0.0, abs=1e-9)
        assert readings[0] == pytest.approx(0.5, abs=0.02)
        assert reported(robot) == "driven"
    assert reported(robot) == "zero"


def test_robot___stopped___ends_the_run_with_zero_on_its_way(
    robot: subprocess.Popen[str],
) -> None:
    with opened() as rig:
        rig.read()
        rig.write([0.1, 0.1])
        assert reported(robot) == "driven"
        os.kill(robot.pid, signal.SIGSTOP)
        with pytest.raises(RigError, match=r"no joint states on /joint_states within 5 s"):
            deque(iter(rig.read, None), maxlen=0)
        os.kill(robot.pid, signal.SIGCONT)
        assert reported(robot) == "zero"


def test_robot___that_is_not_there___is_reported(domain: None) -> None:
    del domain
    with pytest.raises(RigError, match="nobody reads /effort_controller/commands"):
        TopicsRig(SETTINGS, 2).open()


def test_robot___whose_controller_wants_something_else___is_reported_with_that(
    domain: None,
) -> None:
    del domain
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        controller = rclpy.create_node("single_joint", context=context)
        controller.create_subscription(Float64, SETTINGS.commands, lambda _: None, 1)
        with pytest.raises(RigError, match=r"single_joint wants std_msgs/msg/Float64 \(volatile\)"):
            TopicsRig(SETTINGS, 2).open()
    finally:
        rclpy.shutdown(context=context)


@pytest.mark.exhaustive
def test_robot___is_recorded_identified_and_moved_from_the_page(
    graph: Graph, tmp_path: Path
) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(RIG)
    with running_robot(graph.environment):
        model = driven_chain(graph, str(file), tmp_path, "O_dat8")
    # From torque to angle: rate over torque is 1 / (J s + d).
    coasting_s = [-model.dt / np.log(abs(pole)) for pole in model.poles() if abs(pole) < 0.999]
    assert min(abs(each - INERTIA / DRAG) for each in coasting_s) < 0.05
