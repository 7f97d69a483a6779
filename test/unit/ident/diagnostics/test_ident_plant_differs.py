"""Records of one rig, and one among them of another."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest

from flexarm_ident import IoData
from flexarm_ident.diagnostics.change import differences
from support.ident_systems import DT_S, arm_model, step_by_step

SAMPLES = 6000


def loaded(seed: int, factor: float) -> IoData:
    """Return an answer to white noise of an arm whose modes are a factor higher."""
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(SAMPLES, 1))
    model = arm_model()
    A = np.array(model.A)
    for i in (3, 5, 7):
        pole = np.exp(factor * np.log(complex(A[i, i], A[i + 1, i])))
        A[i : i + 2, i : i + 2] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
    other = control.ss(A, model.B, model.C, model.D, DT_S)
    y = step_by_step(other, u)
    return IoData(
        u, y + 0.02 * y.std(axis=0) * rng.normal(size=y.shape), dt_s=DT_S, source=f"record{seed}"
    )


def test_plant_differs___one_record_of_three_from_another_arm___is_named() -> None:
    records = [loaded(0, 1.0), loaded(1, 0.8), loaded(2, 1.0)]
    (found,) = differences(records)
    assert found.text.startswith("the plant of record1 is not that of the other records: ")
    assert found.figures["loss"] > 0.3


@pytest.mark.parametrize("count", [1, 2, 4])
def test_plant_differs___records_of_one_arm___are_not_called_so(count: int) -> None:
    assert not list(differences([loaded(seed, 1.0) for seed in range(count)]))


@pytest.mark.parametrize("offset", [0.1, 1.0, 3.0])
def test_plant_differs___other_offset_of_a_sensor___is_no_other_plant(offset: float) -> None:
    first, second = loaded(0, 1.0), loaded(1, 1.0)
    shifted = replace(second, y=second.y + offset * second.y.std(axis=0))
    assert not list(differences([first, shifted]))


def test_plant_differs___records_without_names___are_distinguished() -> None:
    records = [replace(loaded(seed, factor), source="") for seed, factor in ((0, 1.0), (1, 0.8))]
    assert [each.code for each in differences(records)] == ["plant_changed"]


@pytest.mark.parametrize("samples", [2000, SAMPLES])
def test_plant_differs___weak_drive_or_few_samples___are_not_compared(samples: int) -> None:
    strong, other = loaded(0, 1.0), loaded(1, 0.8)
    scale = 1.0 if samples < SAMPLES else 0.2
    weak = replace(other, u=scale * other.u, y=scale * other.y).head(samples)
    assert not list(differences([strong, weak]))
