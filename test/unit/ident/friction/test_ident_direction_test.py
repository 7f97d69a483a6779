"""Dry friction in a model's noise: told by the direction of simulated motion, and modelled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_ident import IdentificationError, identify, reduce_model
from flexarm_ident.estimation import simulation_fit
from flexarm_ident.estimation.simulation_fit import ARM
from flexarm_ident.friction.direction_test import recurs_with_direction
from flexarm_ident.friction.layout import Drive
from flexarm_ident.models.state_space import with_matrices
from support.exhaustive import first_of
from support.rubbing_arms import driven_arm, rubbing_arm

DRIVE = Drive("drive1_a", "joint1_rad")
SEEDS = range(4)


@pytest.mark.parametrize("seed", SEEDS)
def test_direction___arm_without_friction___says_nothing(seed: int) -> None:
    found = identify(driven_arm(0.0, noise=0.05, seed=seed))
    assert found.likelihood is not None
    assert not recurs_with_direction(found.likelihood, found.records, [DRIVE])


def test_direction___loop_around_an_arm_without_friction___says_nothing() -> None:
    found = identify(rubbing_arm((1e-9,), seed=1))
    assert found.likelihood is not None
    assert not recurs_with_direction(found.likelihood, found.records, [DRIVE])


@pytest.mark.parametrize(("level", "rise"), first_of([(0.6, 0.3), (0.1, 0.0)]))
@pytest.mark.slow
def test_direction___friction_that_passes_for_noise___recurs(level: float, rise: float) -> None:
    found = [identify(driven_arm(level, rise=rise, noise=0.05, seed=seed)) for seed in SEEDS]
    reported = [
        recurs_with_direction(each.likelihood, each.records, [DRIVE])
        for each in found
        if each.likelihood is not None
    ]
    assert reported
    assert all(reported)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_identification___friction_that_passes_for_noise___takes_an_arm() -> None:
    record = driven_arm(0.6, rise=0.3, noise=0.05, seed=1)
    linear = identify(record)
    assert linear.likelihood is not None
    found = identify(record, friction=True)
    assert found.method == ARM
    assert found.friction is not None
    level, rise = found.friction.laws[0, :2]
    # The input of a square wave tells the sum better than its parts.
    assert level <= 1.1 * 0.6 * 1.3
    assert level + rise >= 0.9 * 0.6
    assert (found.fit_error < 0.5 * linear.fit_error).all()
    assert (found.fit_error < 1.5 * 0.05).all()


def test_identification___no_arm_for_friction_that_passes_for_noise___notes_that_it_recurs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def failing(*_arguments: object, **_options: object) -> None:
        raise IdentificationError("no arm")

    monkeypatch.setattr(simulation_fit, "fit_arm", failing)
    record = driven_arm(0.1, noise=0.05, seed=1)
    assert identify(record).choice.endswith("is noise")
    found = identify(record, friction=True)
    assert found.likelihood is not None
    assert found.notes[-1].startswith("the errors recur with the direction of motion")
    assert found.notes[-1].endswith("is not in the model: no arm")
    assert not found.choice.endswith("is noise")


@pytest.mark.slow
@pytest.mark.exhaustive
def test_reduction___arm_whose_hub_grows_slowly___keeps_its_integrator() -> None:
    found = identify(rubbing_arm((0.3,), samples=1200), friction=True)
    assert found.friction is not None
    eigenvalues, vectors = np.linalg.eig(found.model.A)
    hub = int(np.argmin(np.abs(eigenvalues - 1.0)))
    # A time constant of some minutes, as fits of arms have it.
    eigenvalues[hub] = 1.000007
    A = (vectors @ np.diag(eigenvalues) @ np.linalg.inv(vectors)).real
    grown = replace(found, model=with_matrices(found.model, A=A))
    reduced = reduce_model(grown, grown.linear_records, order=3).model
    assert 1.0 - 1e-5 < np.abs(np.linalg.eigvals(reduced.A)).max() < 1.0
