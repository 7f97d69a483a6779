from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.nodes.joint_view import BEND_JOINTS, HUB
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_live.serving.arm_frames import FRAMES_TYPE, TEXT_TYPE, ArmFrames
from support.bag_samples import START_NS, header, serialised, typestore
from support.project import PROJECT
from support.rig_physics import bends_at_m

URDF = (PROJECT / "src/flexarm_bringup/urdf/flexarm.urdf").read_text("utf-8")
RIG = RigParameters()
NOTHING = np.zeros(0)


def joint_state(angles_rad: dict[str, float]) -> bytes:
    return serialised(
        "sensor_msgs/msg/JointState",
        header=header(START_NS, "flexarm/base_link"),
        name=list(angles_rad),
        position=np.array(list(angles_rad.values())),
        velocity=NOTHING,
        effort=NOTHING,
    )


def decoded(raw: bytes, type_name: str) -> Any:  # noqa: ANN401 - a type made of a text
    return typestore().deserialize_cdr(raw, type_name)


def turned(angle_rad: float, along_m: float) -> complex:
    return complex(along_m * np.exp(1j * angle_rad))


def test_frames___composed___put_the_payload_where_the_pieces_end() -> None:
    angles_rad = dict(zip((HUB, *BEND_JOINTS), (0.5, 0.04, -0.03, 0.02, 0.01), strict=True))
    frames = ArmFrames(URDF, "flexarm/")

    message = decoded(frames.transforms(joint_state(angles_rad)), FRAMES_TYPE)

    place, heading = 0.0 + 0.0j, 1.0 + 0.0j
    for each in message.transforms:
        step, turn = each.transform.translation, each.transform.rotation
        assert (step.y, step.z, turn.x, turn.y) == (0.0, 0.0, 0.0, 0.0)
        place += heading * step.x
        heading *= complex(turn.w, turn.z) ** 2
    ends_m = [0.0, *bends_at_m(RIG), RIG.length_m]
    pieces = zip(np.cumsum(list(angles_rad.values())), np.diff(ends_m), strict=True)
    assert place == pytest.approx(sum(turned(*piece) for piece in pieces), abs=1e-9)
    assert np.angle(heading) == pytest.approx(sum(angles_rad.values()))


def test_frames___have___the_names_of_the_layout_and_the_stamp_of_the_sample() -> None:
    transforms = decoded(ArmFrames(URDF, "arm2/").transforms(joint_state({})), FRAMES_TYPE)
    parents = [each.header.frame_id for each in transforms.transforms]
    children = [each.child_frame_id for each in transforms.transforms]
    assert (parents[0], children[-1]) == ("arm2/base_link", "arm2/payload")
    assert parents[1:] == children[:-1]
    stamps = {(t.header.stamp.sec, t.header.stamp.nanosec) for t in transforms.transforms}
    assert stamps == {divmod(START_NS, 10**9)}


def test_description___is_the_file() -> None:
    text = decoded(ArmFrames(URDF, "").description(), TEXT_TYPE).data
    assert text == URDF


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("no XML", "syntax error"),
        ('<robot><joint name="ball" type="floating"/></robot>', "joint ball is neither fixed nor"),
        (
            '<robot><joint name="a" type="fixed"><origin rpy="0 0 1"/></joint></robot>',
            "joint a is neither .* or its frame is turned",
        ),
        ('<robot><joint name="a" type="fixed"/></robot>', "joint a has no parent"),
        (
            '<robot><joint name="a" type="fixed"><origin rpy="0 0"/></joint></robot>',
            "not enough values",
        ),
    ],
)
def test_text___that_describes_no_arm___is_refused(text: str, complaint: str) -> None:
    with pytest.raises(SettingError, match=f"urdf: no description of an arm: .*{complaint}"):
        ArmFrames(text, "")
