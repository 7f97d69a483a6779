"""Arms that the bench of the servo draws, and the peers that stand beside it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bench.control.drawn_arms import RATE_HZ, drawn_arm, record_arm
from bench.control.peers import BookLqg, Mpc
from flexarm_control import nominal_model
from flexarm_ident.models.state_space import simulate

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("seed", [0, 2])
def test_drawn_arm___without_friction___moves_as_its_linear_model(
    seed: int, tmp_path: Path
) -> None:
    pytest.importorskip("mujoco", reason="the engine: requirements/mujoco.in")
    drawn = drawn_arm(seed)
    arm = replace(drawn, links=tuple(replace(each, friction_nm=0.0) for each in drawn.links))
    torque = np.zeros((100, len(arm.links)))
    torque[5:25] = 0.01
    rig = arm.rig(tmp_path, noise=False)
    rig.open()
    measured = []
    for u in torque:
        measured.append(rig.read().outputs)
        rig.write(u.tolist())

    found = simulate(arm.source(tmp_path).model, torque)

    # An accelerometer shows the command in force a sample before that of the model.
    places = [arm.outputs.index(name) for name in arm.outputs if name != "tip_acc"]
    missed = np.linalg.norm((found - measured)[:, places], axis=0)
    np.testing.assert_array_less(missed, 0.01 * np.linalg.norm(found[:, places], axis=0))


def test_record_arm___has_the_columns_of_its_signals(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="the engine: requirements/mujoco.in")
    arm = drawn_arm(1)

    file = record_arm(arm, tmp_path, 0.2)

    assert file.read_text().splitlines()[0].split(",") == ["time", *arm.inputs, *arm.outputs]
    assert len(np.loadtxt(file, delimiter=",", skiprows=1)) == round(0.2 * RATE_HZ)


def test_lqg_by_the_book___comes_to_the_set_point_of_its_model() -> None:
    assert _rest(BookLqg) == pytest.approx(0.5, rel=1e-3)


def test_mpc___comes_to_the_set_point_of_its_model() -> None:
    pytest.importorskip("osqp", reason="the solver: requirements/mpc.in")
    assert _rest(Mpc) == pytest.approx(0.5, rel=1e-3)


def _rest(design: type[BookLqg | Mpc]) -> float:
    """Return where the position of a model rests after a step by 0.5 V."""
    model = nominal_model(0.2)
    law, x, y = design(model), np.zeros(model.nstates), np.zeros(4)
    for _ in range(6000):
        y = np.asarray(model.C @ x)
        x = model.A @ x + model.B[:, 0] * law.step(y.tolist(), 0.5).effort_v
    return float(y[0])
