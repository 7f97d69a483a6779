from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, RigParameters

SCALARS = [
    field.name
    for field in fields(RigParameters)
    if field.name not in {"noise_v", "hum_v", "adc_bits", "dac_bits", "disturbance_v"}
]


def test_defaults___section_of_the_beam___gives_its_stiffness_and_mass() -> None:
    rig = RigParameters()
    assert rig.bending_stiffness_nm2 == pytest.approx(7.906, abs=5e-4)
    assert rig.mass_per_length_kg_per_m == pytest.approx(0.4131, abs=5e-5)
    assert rig.payload_kg == 0.0
    assert rig.noise_v == LOW_NOISE_V


@pytest.mark.parametrize("name", SCALARS)
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_scalar___not_a_magnitude___is_refused_by_name(name: str, value: float) -> None:
    changed: dict[str, Any] = {name: value}
    with pytest.raises(SettingError, match=f"^{name} must"):
        replace(RigParameters(), **changed)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("length_m", 0.0),
        ("disturbance_v", math.nan),
        ("motor_inertia_kg_m2", 0.0),
        ("breakaway_ratio", 0.99),
        ("tacho_damping_ratio", 1.0),
        ("base_gauge_at_m", 1.01),
        ("middle_gauge_at_m", 1.01),
        ("noise_v", (0.0, 0.0, 0.0)),
        ("noise_v", (0.0, 0.0, 0.0, -0.1)),
        ("noise_v", (0.0, 0.0, 0.0, math.nan)),
        ("hum_v", (0.0, 0.0, -0.1, 0.0)),
        ("adc_bits", 0),
        ("dac_bits", 33),
        ("adc_bits", 12.5),
    ],
)
def test_parameter___out_of_range___is_refused_by_name(name: str, value: object) -> None:
    changed: dict[str, Any] = {name: value}
    with pytest.raises(SettingError, match=f"^{name} must"):
        replace(RigParameters(), **changed)


@pytest.mark.parametrize(
    "name", ["coulomb_friction_nm", "backlash_deg", "gear_damping_nm_s_per_rad"]
)
def test_effect___set_to_zero___is_left_out(name: str) -> None:
    changed: dict[str, Any] = {name: 0.0}
    assert getattr(replace(RigParameters(), **changed), name) == 0.0
