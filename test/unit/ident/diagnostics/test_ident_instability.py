from __future__ import annotations

import re

import numpy as np
import pytest
from scipy import linalg

from flexarm_ident import IoData
from flexarm_ident.diagnostics.instability import is_unstable
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.exhaustive import first_of

# Input held at 100 Hz: balance pole, and a first-order plant that grows.
PENDULUM = (np.array([[0.0, 1.0], [9.0, -0.1]]), np.array([30.0, 6.0]))
GROWING = (np.array([[2.0]]), np.array([6.0]))


def in_its_loop(
    plant: tuple[np.ndarray, np.ndarray], noise: float, seed: int, disturbance: float = 0.0
) -> IoData:
    """Return a record of a plant under state feedback with coloured dither."""
    (own, gain), rng, period_s = plant, np.random.default_rng(seed), 0.01
    order = len(own)
    drive = np.zeros((order + 1, order + 1))
    drive[:order, :order] = own
    drive[order - 1, order] = 1.0
    held = linalg.expm(drive * period_s)
    A, b = held[:order, :order], held[:order, order]
    x, dither = np.zeros(order), 0.0
    u, y = np.zeros(4000), np.zeros(4000)
    for k in range(len(u)):
        dither = 0.8 * dither + rng.normal()
        u[k], y[k] = dither - gain @ x, x[0]
        x = A @ x + b * u[k] + disturbance * rng.normal(size=order)
    y += noise * y.std() * rng.normal(size=len(y))
    return IoData(u, y, dt_s=period_s, inputs=("u",), outputs=("y",))


@pytest.mark.parametrize("plant", first_of([(PENDULUM,), (GROWING,)]), ids=["pendulum", "growing"])
@pytest.mark.parametrize("seed", first_of(range(2)))
@pytest.mark.slow
def test_run___unstable_plant_in_its_loop___next_step_keeps_it_unstable(
    plant: tuple[np.ndarray, np.ndarray], seed: int
) -> None:
    data = in_its_loop(plant, 0.05, seed)
    found = run(data, Request(reduction="none")).verdict
    assert found.error > 0.5
    reported = re.search(r"--keep-unstable --to ([0-9.]+)s", found.next_step)
    assert reported
    kept = run(
        data.head(round(float(reported[1]) / data.dt_s)), Request(stabilise=False)
    ).identification
    pole = float(np.abs(np.linalg.eigvals(kept.model.A)).max())
    growth = float(np.linalg.eigvals(plant[0]).real.max())
    assert np.log(pole) / data.dt_s == pytest.approx(growth, rel=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_is_unstable___disturbance_as_large_as_the_answer___is(seed: int) -> None:
    own = PENDULUM[0]
    quiet = in_its_loop(PENDULUM, 0.0, seed)
    data = in_its_loop(PENDULUM, 0.05, seed, disturbance=0.01)
    assert data.y.std() > 1.4 * quiet.y.std()
    A, C = linalg.expm(own * data.dt_s), np.array([[1.0, 0.0]])
    assert is_unstable(A, C, [data])


@pytest.mark.parametrize("seed", first_of(range(20), 7))
def test_is_unstable___stable_plant_with_an_eigenvalue_put_outside___is_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frequency, decay = rng.uniform(5.0, 30.0), rng.uniform(0.1, 2.0)
    own = np.array([[0.0, 1.0], [-(frequency**2), -decay]])
    data = in_its_loop((own, np.array([5.0, 0.5])), rng.uniform(0.05, 1.0), seed)
    rotation = linalg.expm(own * data.dt_s)
    # The estimate is wrong by noise: the pair's own modes, and 1.01 to 1.05 beside them.
    A = linalg.block_diag(rotation, np.diag([rng.uniform(1.01, 1.05)]))
    C = np.array([[1.0, 0.0, 0.3]])
    assert not is_unstable(A, C, [data])


def test_is_unstable___stable_matrix_or_one_short_record___is_not() -> None:
    data = in_its_loop(GROWING, 0.05, 1)
    A, C = np.array([[np.exp(0.02)]]), np.array([[1.0]])
    assert is_unstable(A, C, [data])
    assert not is_unstable(1.0 / A, C, [data])
    assert not is_unstable(A, C, [data.head(100)])
