from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_daq.drivers.mujoco.rig import MujocoRig, MujocoSettings
from flexarm_daq.rigs.rig_protocol import RigError

if TYPE_CHECKING:
    from pathlib import Path

pytest.importorskip("mujoco", reason="the engine: pip install mujoco")

# A door of 0.4 m whose hinge is at (1, 2, 0), and all that may stand around it.
DOOR = """\
<mujoco>
  <compiler angle="radian"/>
  <option gravity="0 0 0"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <asset>
    <material name="steel" rgba=".2 .3 .4 1"/>
    <mesh name="brick" vertex="1 2 3  1.2 2 3  1 2.4 3  1.2 2.4 3
                               1 2 3.6  1.2 2 3.6  1 2.4 3.6  1.2 2.4 3.6"/>
  </asset>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <geom type="mesh" mesh="brick"/>
    <geom type="sphere" size=".1" group="3"/>
    <geom type="sphere" size=".1" rgba="0 0 0 0"/>
    <body name="door" pos="1 2 0">
      <joint name="hinge" axis="0 0 1" damping="1"/>
      <geom type="box" size=".2 .01 .5" pos=".2 0 0" rgba="1 0 0 .5"/>
      <geom type="capsule" size=".02" fromto="0 0 -.5 0 0 .5" material="steel"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="hinge"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/></sensor>
</mujoco>
"""


@pytest.fixture
def rig(tmp_path: Path) -> MujocoRig:
    (tmp_path / "door.xml").write_text(DOOR)
    settings = MujocoSettings(
        model="door.xml", actuators=("motor",), sensors=("angle",), rate_hz=500.0
    )
    made = MujocoRig(settings, tmp_path)
    made.open()
    return made


def corners(solid: dict[str, Any]) -> np.ndarray:
    """Return the corners of a box in its body's frame, (8, 3), by the quaternion's matrix."""
    w, x, y, z = solid["turn"]
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    return np.asarray(solid["place_m"] + (signs * solid["size_m"]) @ matrix.T)


def test_solids___are_those_that_are_seen___with_size_place_and_colour(rig: MujocoRig) -> None:
    plane, brick, door, bar = json.loads(json.dumps(rig.bodies.solids()))
    assert [each["kind"] for each in (plane, brick, door, bar)] == ["box", "box", "box", "capsule"]
    assert [each["body"] for each in (plane, brick, door, bar)] == [0, 0, 1, 1]
    assert plane["size_m"][0] > 1.0
    assert door["size_m"] == pytest.approx([0.2, 0.01, 0.5])
    assert door["place_m"] == pytest.approx([0.2, 0.0, 0.0])
    assert door["rgba"] == pytest.approx([1.0, 0.0, 0.0, 0.5])
    assert bar["size_m"][:2] == pytest.approx([0.02, 0.5])
    assert bar["rgba"] == pytest.approx([0.2, 0.3, 0.4, 1.0])
    # A mesh is shown as the box about it, and this one is a box.
    found = corners(brick)
    np.testing.assert_allclose(found.min(axis=0), [1.0, 2.0, 3.0], atol=1e-6)
    np.testing.assert_allclose(found.max(axis=0), [1.2, 2.4, 3.6], atol=1e-6)


def test_poses___follow_the_joint(rig: MujocoRig) -> None:
    angle_rad = 0.0
    for _ in range(500):
        angle_rad = float(rig.read().outputs[0])
        rig.write([1.0])
    assert angle_rad > 0.1
    world, door = rig.bodies.poses()
    np.testing.assert_allclose(world, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    turn = [math.cos(angle_rad / 2.0), 0.0, 0.0, math.sin(angle_rad / 2.0)]
    np.testing.assert_allclose(door, [1.0, 2.0, 0.0, *turn], atol=1e-9)


class _Window:
    """Double of the engine's passive viewer."""

    def __init__(self) -> None:
        self.shown, self.is_open = 0, True

    def launch_passive(self, *_: object, **__: object) -> _Window:
        return self

    def is_running(self) -> bool:
        return self.is_open

    def sync(self) -> None:
        self.shown += 1

    def close(self) -> None:
        self.is_open = False


def test_viewer___arm_of_500_hz___shows_sixty_frames_a_second_until_its_window_is_closed(
    rig: MujocoRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = _Window()
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setitem(sys.modules, "mujoco.viewer", window)
    seen = MujocoRig(replace(rig.settings, viewer=True), rig._folder)
    seen.open()

    for _ in range(500):
        seen.read()

    assert window.shown == pytest.approx(60, abs=5)
    window.is_open = False
    seen.read()
    seen.close()


def test_viewer___without_a_display___is_refused(
    rig: MujocoRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)

    with pytest.raises(RigError, match="the viewer needs a display"):
        MujocoRig(replace(rig.settings, viewer=True), rig._folder).open()
