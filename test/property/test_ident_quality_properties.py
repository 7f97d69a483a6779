from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy import signal

from flexarm_ident import IoData
from flexarm_ident.diagnostics.quality import assess
from flexarm_ident.subspace.gram import block_gram
from support.exhaustive import wide
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step

SEEDS = st.integers(0, 10_000)
few = settings(max_examples=wide(6, 25), suppress_health_check=[HealthCheck.too_slow])


def names(data: IoData, block_rows: int = 20) -> list[str]:
    return [warning.code for warning in assess([data], block_gram([data], block_rows))]


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


@few
@given(SEEDS, st.integers(5, 80), st.floats(1e-3, 0.2))
def test_assess___delayed_input___names_the_delay(seed: int, delay: int, noise: float) -> None:
    u = square_wave(6000, seed)
    y = step_by_step(arm_model(), np.vstack([np.zeros((delay, 1)), u[:-delay]]))
    y += noise * y.std(axis=0) * np.random.default_rng(seed).normal(size=y.shape)
    data = IoData(u, y, dt_s=DT_S)
    (found,) = assess([data], block_gram([data], 20))
    assert (found.code, found.figures["samples"]) == ("delay", delay)


@few
@given(SEEDS, st.integers(1, 10), st.floats(10.0, 1e3))
def test_assess___outliers___are_counted(seed: int, count: int, size: float) -> None:
    clean = arm_record(seed, 0.02)
    y, rng = clean.y.copy(), np.random.default_rng(seed)
    # Far enough apart, and away from the ends, that each stands alone.
    rows = 100 + 250 * rng.permutation(11)[:count] + rng.integers(0, 200, count)
    y[rows, 2] += size * y[:, 2].std() * rng.choice([-1.0, 1.0], count)
    (found,) = assess([replace(clean, y=y)], block_gram([clean], 20))
    assert (found.code, found.figures["count"]) == ("outliers", count)


@few
@given(SEEDS, st.floats(0.4, 1.5))
def test_assess___coarse_converter___is_named_with_its_step(seed: int, part: float) -> None:
    clean = arm_record(seed, 0.02)
    y, step = clean.y.copy(), part * clean.y[:, 3].std()
    y[:, 3] = np.round(y[:, 3] / step) * step
    found = {each.code: each for each in assess([replace(clean, y=y)], block_gram([clean], 20))}
    assert abs(found["quantisation"].figures["step"] / step - 1.0) < 1e-6


@few
@given(SEEDS, st.sampled_from(["coloured", "coloured noise", "multisine"]), st.floats(1e-3, 0.5))
def test_assess___clean_records_of_other_kinds___say_nothing(
    seed: int, kind: str, noise: float
) -> None:
    rng, samples = np.random.default_rng(seed), 3000
    u = rng.normal(size=(samples, 1))
    v = rng.normal(size=(samples, 4))
    if kind == "multisine":
        lines = np.arange(1, samples // 8) / (samples // 4)
        phases = rng.uniform(0.0, 2.0 * np.pi, len(lines))
        turns = 2.0 * np.pi * np.outer(np.arange(samples), lines) + phases
        u = np.cos(turns).sum(axis=1, keepdims=True)
    elif kind == "coloured":
        u = signal.lfilter([1.0], [1.0, -0.9], u, axis=0)
    else:
        v = signal.lfilter([0.44], [1.0, -0.9], v, axis=0)
    y = step_by_step(arm_model(), u)
    data = IoData(u, y + noise * y.std(axis=0) * v, dt_s=DT_S)
    # The bands of a filtered input and the feedback of coloured noise are facts.
    found = assess([data], block_gram([data], 20))
    assert not [str(each) for each in found if each.code not in {"excitation", "feedback"}]
