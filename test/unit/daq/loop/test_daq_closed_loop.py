"""The rig under the thesis's own controllers, written out here as equations (4-6) to (4-8)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.rigs.rig_parameters import THESIS_NOISE_V
from support.driven_rig import driven
from support.exhaustive import first_of

Law = Callable[[NDArray[np.float64]], float]


@dataclass(frozen=True)
class Trial:
    """Figures of one step response."""

    overshoot: float
    settling_s: float
    mean_error_v: float
    base_gauge_rms_v: float


def pd(reference_v: float, compensation_v: float) -> Law:
    def law(volts: NDArray[np.float64]) -> float:
        effort_v = 1.0 * (reference_v - volts[0]) - 2.8 * volts[3]
        return float(effort_v + np.copysign(compensation_v, effort_v))

    return law


def pdpc(reference_v: float, compensation_v: float = 0.7, *, conditional: bool = True) -> Law:
    def law(volts: NDArray[np.float64]) -> float:
        error_v = reference_v - volts[0]
        effort_v = 0.5935 * error_v - 4.2664 * volts[3] - 0.2538 * volts[2]
        if conditional and abs(error_v) < 0.05 and abs(volts[3]) < 0.05:
            return float(effort_v)
        return float(effort_v + (compensation_v if effort_v >= 0.0 else -compensation_v))

    return law


def step(
    law: Law,
    reference_v: float,
    parameters: RigParameters,
    *,
    seed: int = 0,
) -> Trial:
    """Follow a set-point for 15 s at 300 Hz and judge the last 5 s.

    The gauge is judged over 8 to 10 s, as the arm bends and not as its noisy sensor reads.
    """
    run = driven(SimulatedRig(parameters, seed=seed), lambda _, volts: law(volts), 4500)
    position_v = run.y[:, 0]
    outside = np.flatnonzero(np.abs(position_v - reference_v) > 0.05 * reference_v)
    return Trial(
        overshoot=float(position_v.max() / reference_v - 1.0),
        settling_s=float(outside[-1] + 1) / 300.0,
        mean_error_v=float(position_v[3000:].mean() - reference_v),
        base_gauge_rms_v=float(run.true_y[2400:3000, 1].std()),
    )


@pytest.mark.parametrize("seed", first_of([0, 1, 2]))
def test_pd___with_compensation___overshoots_and_settles_at_the_reference(seed: int) -> None:
    trial = step(pd(3.0, 0.8), 3.0, RigParameters(), seed=seed)
    assert 0.09 <= trial.overshoot <= 0.19
    assert 0.8 <= trial.settling_s <= 1.7
    assert abs(trial.mean_error_v) < 0.01


def test_pd___without_compensation___stops_off_the_reference() -> None:
    trial = step(pd(3.0, 0.0), 3.0, RigParameters())
    assert abs(trial.mean_error_v) == pytest.approx(0.11, abs=0.02)


@pytest.mark.parametrize(
    ("payload_kg", "reference_v", "max_overshoot", "uncompensated_error_v"),
    first_of([(0.0, 1.0, 0.03, 0.88), (0.2, 3.0, 0.02, 0.71), (0.4, 5.0, 0.06, 0.19)]),
)
@pytest.mark.slow
def test_pdpc___over_the_payloads___reaches_its_set_point(
    payload_kg: float, reference_v: float, max_overshoot: float, uncompensated_error_v: float
) -> None:
    rig = RigParameters(payload_kg=payload_kg)
    trials = [step(pdpc(reference_v), reference_v, rig, seed=seed) for seed in (0, 1, 2)]
    # Within the band of (4-8) there is no compensation, so friction may hold the arm in it.
    assert max(abs(trial.mean_error_v) for trial in trials) < 0.05
    assert abs(np.mean([trial.mean_error_v for trial in trials])) < 0.03
    assert max(trial.overshoot for trial in trials) < max_overshoot
    without = step(pdpc(reference_v, 0.0), reference_v, rig)
    assert -without.mean_error_v == pytest.approx(uncompensated_error_v, abs=0.04)


@pytest.mark.parametrize(
    ("payload_kg", "reference_v"), first_of([(0.0, 1.0), (0.2, 3.0), (0.4, 5.0)])
)
@pytest.mark.slow
def test_pdpc___with_the_noise_of_the_thesis___has_no_tracking_error(
    payload_kg: float, reference_v: float
) -> None:
    rig = RigParameters(payload_kg=payload_kg, noise_v=THESIS_NOISE_V)
    errors_v = [
        step(pdpc(reference_v), reference_v, rig, seed=seed).mean_error_v for seed in (0, 1, 2)
    ]
    assert abs(np.mean(errors_v)) <= 0.02


@pytest.mark.parametrize(("payload_kg", "reference_v"), [(0.2, 3.0), (0.4, 5.0)])
def test_pdpc___on_heavier_payloads___settles_in_little_more_than_a_second(
    payload_kg: float, reference_v: float
) -> None:
    trial = step(pdpc(reference_v), reference_v, RigParameters(payload_kg=payload_kg))
    assert 1.0 <= trial.settling_s <= 1.4


def test_pdpc___a_whole_period_late___is_unstable() -> None:
    rig = RigParameters()
    prompt = step(pdpc(1.0), 1.0, rig)
    late = step(pdpc(1.0), 1.0, replace(rig, loop_delay_s=0.99 / 300.0))
    assert late.base_gauge_rms_v > 20.0 * prompt.base_gauge_rms_v


@pytest.mark.parametrize(
    ("payload_kg", "reference_v"), first_of([(0.2, 3.0), (0.0, 1.0), (0.4, 5.0)])
)
@pytest.mark.slow
def test_compensation___kept_on_at_the_set_point___makes_the_gear_hit(
    payload_kg: float, reference_v: float
) -> None:
    # Figure 4-10.
    rig = RigParameters(payload_kg=payload_kg)
    kept_v, dropped_v = (
        np.mean(
            [
                step(
                    pdpc(reference_v, conditional=condition), reference_v, rig, seed=seed
                ).base_gauge_rms_v
                for seed in (0, 1, 2)
            ],
        )
        for condition in (False, True)
    )
    assert kept_v > 1.5 * dropped_v
