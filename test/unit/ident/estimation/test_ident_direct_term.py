from __future__ import annotations

import numpy as np
import pytest

from flexarm_ident import identify
from support.exhaustive import first_of
from support.ident_systems import pulse_responses, random_model, record


@pytest.mark.parametrize("method", ["orse", "auto"])
@pytest.mark.parametrize("seed", first_of(range(4)))
@pytest.mark.slow
def test_feedthrough_from_the_data___model_with_d___is_found(seed: int, method: str) -> None:
    model = random_model(seed, feedthrough=True)
    data = record(model, 3000, seed=seed, noise=0.1, closed_loop=False)
    found = identify(data, block_rows=15, method=method, feedthrough=None)
    np.testing.assert_allclose(found.model.D, model.D, atol=0.1 * np.abs(model.D).max())
    np.testing.assert_allclose(
        pulse_responses(found.model), pulse_responses(model), atol=0.15 * np.abs(model.D).max()
    )


@pytest.mark.parametrize("seed", range(6))
def test_feedthrough_from_the_data___model_without_d___stays_zero(seed: int) -> None:
    data = record(random_model(seed), 1500, seed=seed, noise=0.5)
    found = identify(data, block_rows=15, method="auto", feedthrough=None)
    assert not np.any(found.model.D)


def test_feedthrough_from_the_data___closed_loop___stays_zero() -> None:
    data = record(random_model(3, feedthrough=True), 1500, seed=3, closed_loop=True)
    assert not np.any(
        identify(data, order=5, block_rows=10, feedthrough=None, method="orse").model.D
    )
