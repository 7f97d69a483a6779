"""The beam beside an independent engine: a chain of stiff hinges in MuJoCo."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from support.project import PROJECT

if TYPE_CHECKING:
    from numpy.typing import NDArray

STORED = json.loads((PROJECT / "test" / "data" / "beam_mujoco.json").read_text("utf-8"))
PAYLOADS_KG = tuple(map(float, STORED["frequencies_hz"]))


def chain(rig: RigParameters, springs: int) -> str:
    """Return the arm as MJCF: a hinge on the axis, rigid segments, and springs between them.

    Every spring stands in the middle of the piece of beam whose bending it has, so the first and
    the last segment have half the length.
    """
    size_m = rig.length_m / springs
    spring_nm_per_rad = rig.bending_stiffness_nm2 / size_m
    hub_kg_m2 = rig.motor_inertia_kg_m2 + rig.load_inertia_kg_m2
    lengths_m = [size_m / 2.0, *([size_m] * (springs - 1)), size_m / 2.0]
    text, at_m = "", 0.0
    for number, length_m in enumerate(lengths_m):
        spring = f'stiffness="{spring_nm_per_rad!r}"' if number else f'armature="{hub_kg_m2!r}"'
        mass_kg = rig.mass_per_length_kg_per_m * length_m
        # A rod: that a beam also turns by its thickness is left out in the theory of slender ones.
        inertia = mass_kg * length_m**2 / 12.0
        text += (
            f'<body pos="{at_m!r} 0 0"><joint type="hinge" axis="0 0 1" {spring}/>'
            f'<inertial pos="{length_m / 2.0!r} 0 0" mass="{mass_kg!r}"'
            f' diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>'
        )
        at_m = length_m
    tip_kg = rig.tip_mass_kg + rig.payload_kg
    text += (
        f'<body pos="{at_m!r} 0 0"><inertial pos="0 0 0" mass="{tip_kg!r}"'
        ' diaginertia="1e-9 1e-9 1e-9"/>'
    )
    return (
        '<mujoco><compiler angle="radian"/><option gravity="0 0 0"><flag contact="disable"/>'
        f"</option><worldbody>{text}{'</body>' * (springs + 2)}</worldbody></mujoco>"
    )


def engine_frequencies_hz(mujoco: Any, rig: RigParameters, springs: int) -> NDArray[np.float64]:  # noqa: ANN401 - an optional module
    """Return the first three modes out of the accelerations that the engine computes."""
    model = mujoco.MjModel.from_xml_string(chain(rig, springs))
    data = mujoco.MjData(model)
    joints = springs + 1
    acceleration = np.empty((joints, joints))
    step_rad = 1e-5
    for joint in range(joints):
        sides = []
        for side in (step_rad, -step_rad):
            data.qpos[:] = 0.0
            data.qpos[joint] = side
            mujoco.mj_forward(model, data)
            sides.append(data.qacc.copy())
        acceleration[:, joint] = (sides[0] - sides[1]) / (2.0 * step_rad)
    squares = np.sort(np.linalg.eigvals(-acceleration).real)
    frequencies_hz: NDArray[np.float64] = np.sqrt(squares[1:4]) / (2.0 * np.pi)
    return frequencies_hz


@pytest.mark.parametrize("payload_kg", PAYLOADS_KG)
def test_frequencies___beside_the_stored_engine___agree_within_three_per_mille(
    payload_kg: float,
) -> None:
    stored_hz = STORED["frequencies_hz"][str(payload_kg)]
    frequencies_hz = natural_frequencies_hz(RigParameters(payload_kg=payload_kg))
    np.testing.assert_allclose(frequencies_hz, stored_hz, rtol=3e-3)


@pytest.mark.parametrize("payload_kg", PAYLOADS_KG)
def test_engine___run_again___gives_what_is_stored(payload_kg: float) -> None:
    mujoco = pytest.importorskip("mujoco", reason="the independent engine: pip install mujoco")
    frequencies_hz = engine_frequencies_hz(
        mujoco, RigParameters(payload_kg=payload_kg), STORED["springs"]
    )
    np.testing.assert_allclose(frequencies_hz, STORED["frequencies_hz"][str(payload_kg)], rtol=1e-4)


def test_frequencies___of_the_bare_arm___are_those_of_the_thesis() -> None:
    # Section 2.3: 9, 25 and 48 Hz by analysis.
    frequencies_hz = natural_frequencies_hz(RigParameters())
    np.testing.assert_allclose(frequencies_hz, (9.0, 25.0, 48.0), rtol=0.06)
