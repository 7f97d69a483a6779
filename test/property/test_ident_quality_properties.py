from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexarm_ident import IoData
from flexarm_ident.diagnostics.quality import assess
from flexarm_ident.subspace.gram import block_gram
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step

SEEDS = st.integers(0, 10_000)
few = settings(max_examples=25, suppress_health_check=[HealthCheck.too_slow])


def names(data: IoData, block_rows: int = 20) -> list[str]:
    return [warning.name for warning in assess([data], block_gram([data], block_rows))]


def arm_record(seed: int, noise: float) -> IoData:
    u = square_wave(3000, seed)
    y = step_by_step(arm_model(), u)
    y += noise * y.std(axis=0) * np.random.default_rng(seed).normal(size=y.shape)
    return IoData(u, y, dt_s=DT_S)


@few
@given(SEEDS, st.integers(2, 6), st.integers(1, 3), st.integers(1, 2), st.floats(1e-3, 0.5))
def test_assess___clean_white_input___says_nothing(
    seed: int, states: int, outputs: int, inputs: int, noise: float
) -> None:
    model = random_model(seed, states, outputs, inputs)
    assert names(record(model, 2000, seed, noise=noise)) == []


@few
@given(SEEDS, st.floats(1e-3, 0.3))
def test_assess___clean_square_wave_on_the_arm___says_nothing(seed: int, noise: float) -> None:
    assert names(arm_record(seed, noise)) == []


@few
@given(SEEDS, st.floats(-6.0, 6.0), st.integers(0, 3))
def test_assess___other_units___finds_the_same(seed: int, exponent: float, defect: int) -> None:
    clean = arm_record(seed, 0.02)
    y = clean.y.copy()
    y[:, 1] = [y[:, 1], y[:, 1] + 100.0, y[:, 1].clip(max=0.7 * y[:, 1].max()), y[:, 0]][defect]
    expected = [[], ["offset"], ["saturation"], ["duplicated_channel"]][defect]
    assert names(replace(clean, y=y)) == expected
    assert names(replace(clean, y=y * 10.0**exponent)) == expected
