from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident import IoData, identify, reduce_model
from flexarm_ident.reduction.balanced import thesis_realisation
from reproduction.framework.realisations import realisation_difference
from support.ident_systems import (
    DT_S,
    arm_model,
    named,
    random_model,
    record,
    square_wave,
    step_by_step,
)


def arm_record() -> IoData:
    u = square_wave(4000, 1)
    y = step_by_step(arm_model(), u)
    y += 0.02 * y.std(axis=0) * np.random.default_rng(2).normal(size=y.shape)
    return IoData(u, y, dt_s=DT_S)


@pytest.mark.parametrize("order", [7, 8, 11])
def test_thesis_realisation___kept_modes_of_the_arm___agree_with_the_direct_form(
    order: int,
) -> None:
    data = arm_record()
    reduced = reduce_model(
        identify(data, order=14, method="orse"), data, order=order, update="none"
    ).model
    rebuilt = thesis_realisation(reduced, data)
    assert rebuilt.nstates == reduced.nstates
    assert list(rebuilt.output_labels) == list(reduced.output_labels)
    assert np.isrealobj(rebuilt.A)
    # The two are other matrices of one model.
    assert not np.allclose(rebuilt.A, reduced.A, atol=1e-3)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(rebuilt.A)),
        np.sort_complex(np.linalg.eigvals(reduced.A)),
        atol=1e-7,
    )
    difference = realisation_difference(reduced, rebuilt, data)
    assert difference.frequency_response < 1e-7
    assert difference.simulation < 1e-7


def test_realisation_difference___model_with_another_gain___is_the_change() -> None:
    model = random_model(1)
    other = named(model.A, 1.1 * model.B, model.C, model.D)
    data = record(model, 300, seed=1)
    difference = realisation_difference(model, other, data)
    assert difference.frequency_response == pytest.approx(0.1)
    assert difference.simulation == pytest.approx(0.1)


def test_realisation_difference___another_realisation___is_rounding() -> None:
    model = random_model(2)
    T = np.linalg.qr(np.random.default_rng(3).normal(size=(5, 5)))[0]
    other = named(T @ model.A @ T.T, T @ model.B, model.C @ T.T, model.D)
    difference = realisation_difference(model, other, record(model, 300, seed=2))
    assert max(difference.frequency_response, difference.simulation) < 1e-12
