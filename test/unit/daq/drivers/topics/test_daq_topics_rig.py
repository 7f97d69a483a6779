from __future__ import annotations

import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import described
from flexarm_daq.drivers.registry import driven
from flexarm_daq.drivers.topics.inbox import Inbox, Source, TopicsSettings
from flexarm_daq.drivers.topics.rig import TopicsRig
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

OUTPUTS = ("position:elbow", "velocity:shoulder", "imu:/tip:angular_velocity.z", "float:/strain")
SETTINGS = TopicsSettings("/effort/commands", OUTPUTS, stale_s=1.0)


def states(inbox: Inbox, stamp_s: float, *, names: Sequence[str] = ("shoulder", "elbow")) -> None:
    values = {"position": [1.0, 2.0], "velocity": [3.0, 4.0], "effort": []}
    inbox.joints(stamp_s, names, values)


def others(inbox: Inbox) -> None:
    inbox.reading("imu", "/tip", {"angular_velocity.z": 5.0, "angular_velocity.x": 6.0})
    inbox.reading("float", "/strain", {"data": 7.0})
    inbox.reading("float", "/else", {"data": 8.0})


def test_settings___sources___are_read() -> None:
    assert SETTINGS.sources == (
        Source("position", "elbow"),
        Source("velocity", "shoulder"),
        Source("imu", "/tip", "angular_velocity.z"),
        Source("float", "/strain", "data"),
    )


@pytest.mark.parametrize("topic", ["/effort controller/commands", "/2nd", "/a//b", "/a/", ""])
def test_settings___topic_that_is_none___is_refused(topic: str) -> None:
    with pytest.raises(SettingError, match=r"settings.commands: .* is not the name of a topic"):
        TopicsSettings(topic, OUTPUTS)
    with pytest.raises(SettingError, match=r"settings.joint_states: .* is not the name of a topic"):
        TopicsSettings("commands", OUTPUTS, joint_states=topic)


@pytest.mark.parametrize(
    ("outputs", "said"),
    [
        (("positon:elbow",), r"'positon:elbow' is not a source \(nearest: position\)"),
        (("position:",), "'position:' is not a source"),
        (("imu:/tip",), r"'imu:/tip' has no field.*: name one of angular_velocity.x"),
        (("wrench:/ft:force.w",), r"has no field \(nearest: force.[xyz]\)"),
        (("float:/strain",), "has no joint"),
        (("position:elbow", "float:/a b"), r"settings.outputs: '/a b' is not the name of a topic"),
    ],
)
def test_settings___that_name_no_source___are_refused(outputs: tuple[str, ...], said: str) -> None:
    with pytest.raises(SettingError, match=said):
        TopicsSettings("/effort/commands", outputs)


def test_sample___of_all_sources___has_their_order_and_the_stamps_time() -> None:
    inbox = Inbox(SETTINGS)
    others(inbox)
    states(inbox, 100.0)
    first = inbox.sample(1.0)
    assert first.time_s == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(first[1], [2.0, 3.0, 5.0, 7.0])
    states(inbox, 100.005)
    states(inbox, 100.010)
    assert inbox.sample(1.0).time_s == pytest.approx(0.010)
    with pytest.raises(RigError, match=r"no joint states on /joint_states within 0.01 s"):
        inbox.sample(0.01)


def test_sample___waits___for_states_of_another_thread() -> None:
    inbox = Inbox(SETTINGS)
    others(inbox)
    begun_s = time.monotonic()
    threading.Timer(0.03, states, (inbox, 1.0)).start()
    inbox.sample(10.0)
    assert 0.02 < time.monotonic() - begun_s < 5.0


def test_sample___states_that_lack_a_joint___are_left_out_and_reported() -> None:
    inbox = Inbox(SETTINGS)
    others(inbox)
    states(inbox, 1.0)
    inbox.sample(1.0)
    states(inbox, 2.0, names=("shoulder", "elbo"))
    with pytest.raises(RigError, match=r"lack the joint elbow \(nearest: elbo\): they have should"):
        inbox.sample(0.01)


def test_sample___kind_that_the_states_do_not_have___is_reported() -> None:
    inbox = Inbox(TopicsSettings("/c", ("effort:elbow",)))
    states(inbox, 1.0)
    with pytest.raises(RigError, match="they have no effort, which an output needs"):
        inbox.sample(0.01)


@pytest.mark.parametrize("stamp_s", [1.0, 0.5])
def test_sample___stamps_that_stand_or_go_back___are_reported(stamp_s: float) -> None:
    inbox = Inbox(SETTINGS)
    others(inbox)
    states(inbox, 1.0)
    inbox.sample(1.0)
    states(inbox, stamp_s)
    with pytest.raises(RigError, match="their stamps do not go on"):
        inbox.sample(0.01)


def test_sample___sensor_that_is_silent___is_reported_by_its_topic() -> None:
    inbox = Inbox(SETTINGS)
    states(inbox, 1.0)
    inbox.reading("float", "/strain", {"data": 7.0})
    with pytest.raises(RigError, match=r"nothing came on /tip within 0.01 s"):
        inbox.sample(0.01)


def test_sample___sensor_whose_newest_reading_is_old___is_reported() -> None:
    inbox = Inbox(replace(SETTINGS, stale_s=0.05))
    others(inbox)
    time.sleep(0.1)
    states(inbox, 2.0)
    with pytest.raises(RigError, match=r"newest reading of /tip is 0.* s old, for stale_s = 0.05"):
        inbox.sample(1.0)


class Robot:
    """Robot that keeps its commands, in place of the node."""

    def __init__(self, rig: TopicsRig) -> None:
        self.rig = rig
        self.heard: list[list[float]] = []
        self.listens, self.is_left = True, False

    def await_listener(self, _: float) -> bool:
        inbox = self.rig._inbox
        others(inbox)
        states(inbox, 1.0)
        return self.listens

    def has_listener(self) -> bool:
        return self.listens

    def other_reader(self) -> str:
        return ""

    def command(self, values: Sequence[float]) -> None:
        if self.is_left:
            raise RuntimeError("the context has ended")
        self.heard.append(list(values))

    def close(self) -> None:
        self.is_left = True


@pytest.fixture
def robot(monkeypatch: pytest.MonkeyPatch) -> Robot:
    rig = TopicsRig(SETTINGS, 2)
    made = Robot(rig)
    monkeypatch.setattr(rig, "_joined", lambda: made)
    return made


def test_rig___opened_and_closed___commands_zero_first_and_last(robot: Robot) -> None:
    rig = robot.rig
    rig.open()
    assert robot.heard == [[0.0, 0.0]]
    states(rig._inbox, 2.0)
    assert rig.read()[1].shape == (4,)
    rig.write([0.5, -0.5])
    rig.close()
    np.testing.assert_allclose(robot.heard, [[0.0, 0.0], [0.5, -0.5], [0.0, 0.0]])
    assert robot.is_left
    rig.safe_stop()
    with pytest.raises(RigError, match="not open"):
        rig.read()


def test_rig___without_a_reader_of_its_commands___does_not_open(robot: Robot) -> None:
    robot.listens = False
    with pytest.raises(RigError, match="nobody reads /effort/commands: is the robot's effort"):
        robot.rig.open()
    assert robot.is_left


def test_rig___whose_reader_goes___ends_the_run(robot: Robot) -> None:
    robot.rig.open()
    robot.listens = False
    with pytest.raises(RigError, match="nobody reads /effort/commands any more"):
        robot.rig.write([0.1, 0.1])


def test_rig___whose_states_end___commands_zero(robot: Robot) -> None:
    robot.rig.open()
    robot.rig.write([0.1, 0.1])
    with pytest.raises(RigError, match="no joint states"):
        robot.rig.read()
    np.testing.assert_allclose(robot.heard[-1], [0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("commands", [[0.1], [0.1, np.nan], [0.1, 0.2, 0.3]])
def test_rig___command_that_is_none___is_refused_with_zero(
    robot: Robot, commands: list[float]
) -> None:
    robot.rig.open()
    robot.rig.write([0.1, 0.1])
    with pytest.raises(RigError, match="commands must be 2 finite numbers"):
        robot.rig.write(commands)
    np.testing.assert_allclose(robot.heard[-1], [0.0, 0.0], atol=1e-12)


def test_description___of_a_robot___makes_its_driver(tmp_path: Path) -> None:
    text = (
        "name: robot\nrate_hz: 200\ninputs: {u: {unit: N m, quantity: torque, limits: 2}}\n"
        "outputs: {a: {unit: rad, quantity: angle}}\ndriver: topics\n"
        "settings: {commands: /c, outputs: ['position:elbow']}\n"
    )
    made = driven(described(text), tmp_path)
    assert isinstance(made, TopicsRig)
    assert made.settings == TopicsSettings("/c", ("position:elbow",))
    with pytest.raises(SettingError, match=r"settings.outputs has 2 entries"):
        driven(described(text.replace("elbow']", "elbow', 'velocity:elbow']")), tmp_path)
