from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_daq.nodes.joint_view import bend_angles
from flexarm_daq.rigs.beam import arm_modes
from flexarm_daq.rigs.equations import ARM, POSITION
from flexarm_daq.rigs.plant import Plant
from flexarm_daq.rigs.rig_parameters import RigParameters
from support.rig_physics import arm_angle_rad, bends_at_m

if TYPE_CHECKING:
    from numpy.typing import NDArray

RIG = RigParameters()


def volts(base_curvature: float, middle_curvature: float) -> NDArray[np.float64]:
    """Return what the gauges read, by their wiring (docs/units.md)."""
    moments_nm = RIG.bending_stiffness_nm2 * np.array([base_curvature, middle_curvature])
    gains_v_per_nm = np.array([-RIG.base_gauge_v_per_nm, RIG.middle_gauge_v_per_nm])
    readings_v: NDArray[np.float64] = moments_nm * gains_v_per_nm
    return readings_v


def test_bend_angles___force_at_the_tip___are_those_of_a_cantilever() -> None:
    force_n, length_m, stiffness_nm2 = 0.8, RIG.length_m, RIG.bending_stiffness_nm2

    def curvature(at_m: float) -> float:
        return force_n * (length_m - at_m) / stiffness_nm2

    angles_rad = bend_angles(RIG) @ volts(
        curvature(RIG.base_gauge_at_m), curvature(RIG.middle_gauge_at_m)
    )

    slope_rad = force_n * length_m**2 / (2.0 * stiffness_nm2)
    deflection_m = force_n * length_m**3 / (3.0 * stiffness_nm2)
    assert angles_rad.sum() == pytest.approx(slope_rad, rel=1e-3)
    assert angles_rad @ (length_m - bends_at_m(RIG)) == pytest.approx(deflection_m, rel=0.02)


def test_bend_angles___arm_that_swings___have_its_tip_where_the_beam_has_it() -> None:
    plant, modes = Plant(RIG), arm_modes(RIG)
    found_m, true_m = [], []
    for k in range(300):
        plant.advance(3.0 if k < 60 else -3.0 * (k < 120), 1.0 / 300.0)
        angles_rad = bend_angles(RIG) @ plant.outputs_v()[1:3]
        found_m.append(angles_rad @ (RIG.length_m - bends_at_m(RIG)))
        nodes = modes.shapes @ plant.state[POSITION, ARM:]
        true_m.append(nodes[-2] - arm_angle_rad(plant) * RIG.length_m)

    # The first mode carries nearly all of it; the linear curvature is what is not exact.
    assert np.std(np.subtract(found_m, true_m)) < 0.2 * np.std(true_m)
    assert np.corrcoef(found_m, true_m)[0, 1] > 0.98
