from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import Identification, identify, reduce_model
from flexarm_ident.reduction.costs import cost_over_orders, rankings, step_costs
from support.ident_systems import random_model, record


@pytest.fixture(scope="module")
def found() -> Identification:
    data = record(random_model(4, states=6, outputs=2), 1200, 3, noise=0.02)
    return identify(data, order=6, block_rows=10, method="orse")


def test_step_costs___one_record___are_errors_of_a_free_simulation(found: Identification) -> None:
    costs = step_costs(found, found.records, order=4)
    assert [(cost.ranking, cost.update) for cost in costs] == [
        (None, "none"),
        *((ranking, update) for ranking in ("mrm", "msv") for update in ("none", "b", "c")),
    ]
    (data,) = found.records
    models = [(found.model, found.order)]
    for cost in costs[1:]:
        reduced = reduce_model(
            found,
            data,
            ranking=cost.ranking,  # type: ignore[arg-type]
            order=4,
            update=cost.update,  # type: ignore[arg-type]
        )
        assert cost.kept == reduced.kept
        models.append((reduced.model, reduced.order))
    for cost, (model, order) in zip(costs, models, strict=True):
        assert cost.order == order
        assert cost.sfv is None
        assert cost.mean == pytest.approx(cost.errors.mean())
        # The initial state is free: what it adds to the run from rest is fitted. Here all outputs
        # count alike in it, which moves the errors a little.
        _, forced, _ = signal.dlsim((model.A, model.B, model.C, model.D, model.dt), data.u)
        powers = [model.C @ np.linalg.matrix_power(model.A, k) for k in range(len(data))]
        free = np.vstack(powers)
        missed = (data.y - forced).ravel()
        x0 = np.linalg.lstsq(free, missed, rcond=None)[0]
        residual = (missed - free @ x0).reshape(data.y.shape)
        expected = np.sqrt((residual**2).sum(axis=0) / (data.y**2).sum(axis=0))
        np.testing.assert_allclose(cost.errors, expected, rtol=1e-2)


def test_step_costs___record_twice___are_those_of_one(found: Identification) -> None:
    once, twice = (step_costs(found, found.records * times, order=4) for times in (1, 2))
    for one, two in zip(once, twice, strict=True):
        np.testing.assert_allclose(one.errors, two.errors, rtol=1e-9)


def test_step_costs___reference_that_no_law_follows___leaves_following_out(
    found: Identification,
) -> None:
    (data,) = found.records
    law = replace(data, reference=np.zeros(len(data)))
    assert all(cost.sfv is None for cost in step_costs(found, [law], order=4))


def test_cost_over_orders___full_order___has_no_cost(found: Identification) -> None:
    full = step_costs(found, found.records, order=6)[0].mean
    costs = cost_over_orders(found, found.records, [2, 4, 6], ranking="mrm", update="none")
    orders = [order for order, _ in costs]
    assert orders == sorted(set(orders))
    assert dict(costs)[6] == pytest.approx(full)


def test_rankings___known_modes___need_two_states_each() -> None:
    assert rankings(6, (1.0, 2.0, 3.0), 9) == ("mrm", "msv", "mrmc")
    assert rankings(5, (1.0, 2.0, 3.0), 9) == rankings(9, (), 9) == ("mrm", "msv")
    # A whole model of fewer states is kept by any ranking.
    assert rankings(5, (1.0, 2.0, 3.0), 5) == ("mrm", "msv", "mrmc")
