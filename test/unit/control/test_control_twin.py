"""Twin of a model with friction: beside the simulation by which the friction was identified."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexarm_control.twin import TwinRig, twin_description
from flexarm_core.rig_description import described, load_rig
from flexarm_ident.friction.dry_friction import (
    Dependence,
    DryFriction,
    Yielding,
    friction_fields,
    simulate_with_friction,
)
from flexarm_ident.models.files import save_model
from support.servo_plants import two_joints

ENDS = {
    "input_low": [-1.0] * 2,
    "input_high": [1.0] * 2,
    "output_low": [-9.0] * 2,
    "output_high": [9.0] * 2,
}
UNKNOWN = np.zeros(2)
DEPENDENCE = Dependence(
    np.array([0.02, 0.0]), np.array([0.1, 0.0]), np.array([0.0, 0.1]), UNKNOWN, UNKNOWN
)
YIELDING = Yielding(np.array([0.6, 0.0]), np.array([0.2, 0.1]))


@pytest.mark.parametrize("dependence", [None, DEPENDENCE], ids=["coulomb", "dependence"])
@pytest.mark.parametrize("yielding", [None, YIELDING], ids=["holds", "yields"])
def test_twin___with_friction___moves_as_its_simulation(
    tmp_path: Path, dependence: Dependence | None, yielding: Yielding | None
) -> None:
    model = two_joints()
    speed = np.hstack([np.zeros((2, 2)), np.eye(2)])
    levels, offsets = np.array([0.1, 0.05]), np.array([0.01, 0.0])
    friction = DryFriction(levels, offsets, UNKNOWN, UNKNOWN, speed, dependence, yielding)
    file = tmp_path / "model.yaml"
    save_model(file, model, name="joints", provenance=ENDS | friction_fields(friction))
    rig = described(twin_description(file))
    twin = TwinRig(**rig.settings, rig=rig, folder=Path())
    # Slow enough to stand now and then.
    time_s = np.arange(1500) * float(model.dt)
    u = np.column_stack([0.2 * np.sin(3.0 * time_s), 0.1 * np.sin(5.0 * time_s)])
    twin.open()
    y = np.empty_like(u)
    for k, commands in enumerate(u):
        y[k] = twin.read().outputs
        twin.write(commands.tolist())
    wanted, _ = simulate_with_friction(model, friction, u, np.zeros(model.nstates))
    plain, _ = simulate_with_friction(
        model, DryFriction(levels, offsets, UNKNOWN, UNKNOWN, speed), u, np.zeros(model.nstates)
    )
    np.testing.assert_allclose(y, wanted, rtol=0.0, atol=1e-12)
    if dependence or yielding:
        assert np.abs(wanted - plain).max() > 1e-4


def test_twin_of_a_packaged_rig___stands_at_rest_and_turns_with_its_motor() -> None:
    rig = load_rig("quanser-2dsfl")
    twin = TwinRig(**rig.settings, rig=rig, folder=Path("nowhere"))
    twin.open()
    # Below the friction of both joints, then above that of the shoulder.
    for current1_a, moves in ((0.1, False), (0.3, True)):
        twin.write([current1_a, 0.1])
        for _ in range(100):
            outputs = twin.read().outputs
        assert bool(abs(outputs[0]) > 1.0) is moves
        assert abs(outputs[2]) < 1.0
