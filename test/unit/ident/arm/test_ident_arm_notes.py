"""Words on an arm with dry friction: a motion that grows and a free hub are told."""

from __future__ import annotations

from dataclasses import replace

import control
import numpy as np
import pytest

from flexarm_ident.arm.equations import FrictionModel
from flexarm_ident.arm.fit import ArmFit
from flexarm_ident.arm.notes import notes
from flexarm_ident.friction.dry_friction import DryFriction

DT_S = 0.01


def fit(*eigenvalues: float) -> ArmFit:
    """Return an arm with some eigenvalues, and nothing else to be told."""
    states = len(eigenvalues)
    ones = np.ones((states, 1))
    none = np.zeros(1)
    model = control.ss(np.diag(eigenvalues), ones, ones.T, 0.0, DT_S)
    return ArmFit(
        model=model,
        x0=(),
        friction=DryFriction(none, none, none, none, np.zeros((1, states))),
        error=np.zeros(1),
        dead_samples=np.zeros(1),
        bandwidth_hz=1.0,
        law_ranges=np.ones((1, 5, 2)),
        free_hubs=(),
        friction_model=FrictionModel.COULOMB,
        left_out={},
    )


def test_notes___eigenvalue_outside_the_unit_circle___has_its_time_constant() -> None:
    # exp(t / 10 s) sampled every 10 ms.
    (note,) = notes(fit(np.exp(DT_S / 10.0), 0.5))
    assert "time constant of 10 s" in note
    assert "simulate it no longer than its records" in note


@pytest.mark.parametrize("rounding", [-1e-12, 0.0, 1e-12])
def test_notes___integrator___does_not_grow(rounding: float) -> None:
    assert notes(fit(1.0 + rounding, 0.5)) == ()


def test_notes___free_hub___is_reported_by_the_input_that_drives_it() -> None:
    (note,) = notes(replace(fit(1.0, 0.5), free_hubs=(0,)))
    assert note == "no stiffness holds what u[0] drives: the model integrates there"


@pytest.mark.parametrize(
    ("rise", "reported"), [(0.3, ", 0.66 to 0.7 with the rise at standstill"), (0, "")]
)
def test_notes___vague_level___is_reported_with_what_holds_at_standstill(
    rise: float, reported: str
) -> None:
    ranges = np.array([[[0.35, 0.63], [0.9 * rise, rise], [0.1, 0.1], [0, 0], [0.66, 0.7]]])
    (note,) = notes(replace(fit(0.5), law_ranges=ranges))
    assert note.startswith(
        "the friction level of u[0] is not determined by the record: 0.35 to 0.63 simulate it "
        f"equally well{reported}; record slow reversals"
    )
