from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IoData
from flexarm_ident.diagnostics.spectra import spectra
from flexarm_ident.fitting.validation import frequency_response
from support.ident_systems import DT_S, random_model, record


def test_spectra___random_plant_of_two_inputs___response_is_the_models() -> None:
    model = random_model(1)
    found = spectra([record(model, 60_000, 1, noise=0.01)])
    assert found is not None
    true = frequency_response(model, found.frequencies_hz)
    deviation = np.abs(found.response - true) / np.abs(true).max(axis=0)
    assert np.median(deviation) < 0.01
    assert np.all(found.explained > 0.99)


@pytest.mark.parametrize("noise", [0.5, 1.0, 3.0])
def test_spectra___white_output_with_noise___coherence_is_the_share_of_the_signal(
    noise: float,
) -> None:
    rng = np.random.default_rng(2)
    u = rng.normal(size=(30_000, 1))
    y = np.roll(u, 1) + noise * rng.normal(size=u.shape)
    found = spectra([IoData(u, y, dt_s=DT_S, outputs=("y",))])
    assert found is not None
    assert found.explained[0] == pytest.approx(1.0 / (1.0 + noise**2), abs=0.02)


def test_spectra___unrelated_signals___exceed_the_chance_as_often_as_it_says() -> None:
    rng, exceeded = np.random.default_rng(3), []
    for _ in range(40):
        u = rng.normal(size=(4000, 2))
        y = signal.lfilter([1.0], [1.0, -0.7], rng.normal(size=(4000, 1)), axis=0)
        found = spectra([IoData(u, y, dt_s=DT_S, inputs=("a", "b"), outputs=("y",))])
        assert found is not None
        exceeded.append(np.mean(found.coherence[:, 0] > found.chance(0.05)))
    # Neighbouring frequencies share the window: some 120 of them count for 80.
    assert np.mean(exceeded) == pytest.approx(0.05, abs=0.02)


def test_spectra___several_records_with_holes___average_all_stretches() -> None:
    model = random_model(4)
    data = record(model, 20_000, 4)
    y = data.y.copy()
    y[7000:7100] = np.nan
    whole = IoData(data.u, y, dt_s=DT_S, inputs=data.inputs, outputs=data.outputs)
    found = spectra([whole, record(model, 5000, 5)])
    assert found is not None
    assert np.all(found.explained > 0.98)


def test_spectra___few_samples___are_none() -> None:
    assert spectra([record(random_model(6), 300, 6)]) is None
