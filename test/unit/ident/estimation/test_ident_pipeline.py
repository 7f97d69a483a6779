from __future__ import annotations

from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from scipy.signal import lfilter

from flexarm_core.errors import FlexarmError
from flexarm_ident import DataError, IdentificationError, IoData, identify, validate_dmv
from flexarm_ident.subspace.order import suggest_order
from support.exhaustive import first_of
from support.ident_systems import (
    DT_S,
    arm_model,
    named,
    pulse_responses,
    random_model,
    record,
    square_wave,
    step_by_step,
)


def arm_experiment(seed: int, samples: int = 12_000) -> IoData:
    """Return noisy outputs of the arm, in motion from the first sample."""
    rng = np.random.default_rng(seed)
    u = square_wave(samples, seed)
    y = step_by_step(arm_model(), u, 0.05 * rng.normal(size=arm_model().nstates))
    noise = np.array([0.01, 0.15, 0.10, 0.05]) * y.std(axis=0) * rng.normal(size=y.shape)
    return IoData(u, y + noise, dt_s=DT_S)


@pytest.mark.parametrize("seed", first_of(range(3)))
def test_identify___noisy_arm_under_square_wave___modes_within_a_few_percent(seed: int) -> None:
    data = arm_experiment(seed)
    found = identify(data.head(6000), method="orse")
    pairs = [mode for mode in found.modes if mode.is_pair and mode.damping_ratio < 0.2]
    for true_hz in (9.4, 24.1, 45.6):
        nearest = min(pairs, key=lambda mode: abs(mode.frequency_hz - true_hz))
        assert nearest.frequency_hz == pytest.approx(true_hz, rel=0.03)
    # The noise alone costs 0.08 in the mean.
    assert validate_dmv(found.model, data).mean < 0.1
    assert not found.warnings
    assert found.order in found.stable_orders


def test_identify___order_given___is_kept_and_described() -> None:
    data = arm_experiment(3, 3000)
    found = identify(data, order=12, method="orse")
    assert found.order == found.model.nstates == 12
    assert found.model.dt == pytest.approx(DT_S)
    assert tuple(found.model.input_labels) == data.inputs
    assert tuple(found.model.output_labels) == data.outputs
    assert not found.model.D.any()
    assert len(found.x0) == 1
    y = step_by_step(found.model, data.u, found.x0[0])
    error = np.linalg.norm(data.y - y, axis=0) / np.linalg.norm(data.y, axis=0)
    np.testing.assert_allclose(found.fit_error, error, rtol=1e-6)


def test_identify___several_records___one_model_and_an_initial_state_each() -> None:
    model = random_model(1)
    records = [record(model, 300, seed=1), record(model, 201, seed=2), record(model, 404, seed=3)]
    found = identify(records, order=5, block_rows=10, method="orse")
    expected = pulse_responses(model)
    np.testing.assert_allclose(pulse_responses(found.model), expected, atol=1e-9)
    for data, x0 in zip(records, found.x0, strict=True):
        np.testing.assert_allclose(step_by_step(found.model, data.u, x0), data.y, atol=1e-8)


def test_identify___clean_data_without_order___finds_the_true_one() -> None:
    found = identify(record(random_model(2, states=9), 1500, seed=2), block_rows=20, method="orse")
    assert found.order == 9
    assert found.suggested_order == 9


def test_suggest_order___clear_gap___is_found() -> None:
    assert suggest_order(np.array([9.0, 8.0, 7.0, 1e-3, 9e-4]), 4) == 3
    assert suggest_order(np.array([5.0, 0.0, 0.0]), 2) == 1


@pytest.mark.parametrize("order", range(1, 9))
def test_identify___threshold_between_singular_values___sets_the_order(order: int) -> None:
    data = arm_experiment(0, 3000)
    values = identify(data, block_rows=20, method="orse").singular_values
    threshold = float(np.sqrt(values[order - 1] * values[order]) / values[0])
    found = identify(data, block_rows=20, singular_value_threshold=threshold, method="orse")
    assert found.order == order


def test_identify___threshold_below_too_many_singular_values___says_what_to_do() -> None:
    with pytest.raises(IdentificationError, match="raise the threshold or block_rows"):
        identify(
            arm_experiment(0, 3000), block_rows=8, singular_value_threshold=1e-12, method="orse"
        )


def test_identify___feedthrough___is_recovered() -> None:
    model = random_model(3, feedthrough=True)
    found = identify(
        record(model, 500, seed=3), order=5, block_rows=10, feedthrough=True, method="orse"
    )
    np.testing.assert_allclose(pulse_responses(found.model), pulse_responses(model), atol=1e-9)


@pytest.mark.parametrize(
    ("seed", "note"),
    [
        (4, "2 unstable eigenvalues of order 5 were moved into the unit circle"),
        (6, "1 unstable eigenvalue of order 5 was moved into the unit circle"),
    ],
    ids=["pair", "real"],
)
def test_identify___unstable_plant___eigenvalue_is_moved_and_reported(seed: int, note: str) -> None:
    model = random_model(seed)
    A = model.A / np.abs(np.linalg.eigvals(model.A)).max() * 1.001
    data = record(named(A, model.B, model.C, model.D), 500, seed=4)
    found = identify(data, order=5, block_rows=10, method="orse")
    assert np.abs(np.linalg.eigvals(found.model.A)).max() < 1.0
    assert found.moved_eigenvalues == int(note[0])
    assert f"information: {note}" in found.warnings


def test_identify___plant_far_outside_the_circle___is_given_the_option_that_keeps_it() -> None:
    A, B, C = np.diag([1.02, 0.8]), np.ones((2, 1)), np.array([[1.0, 0.5]])
    data = record(control.ss(A, B, C, 0.0, 0.01, inputs=["u"], outputs=["y"]), 300, seed=4)
    (note,) = identify(data, order=2, block_rows=10, method="orse").notes
    assert "magnitude 1.0200" in note
    assert "stable=False (--keep-unstable)" in note
    kept = identify(data, order=2, block_rows=10, method="orse", stable=False)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(kept.model.A)), [0.8, 1.02], rtol=1e-6)


@pytest.mark.parametrize(
    ("data", "options", "message"),
    [
        ((np.ones(9), np.ones(9)), {}, "identify takes records, and no ndarray: .*from_columns"),
        ("run.csv", {}, "identify takes records, and no str"),
        ({"u": [1.0]}, {}, "identify takes records, and no dict"),
        (None, {"order": 2.5}, r"order must be an integer or None, got 2\.5"),
        (None, {"order": True}, "order must be an integer or None, got True"),
        (None, {"feedthrough": "auto"}, r"feedthrough must be True, False or None .*got 'auto'"),
        (None, {"stable": "no"}, "stable must be True or False, got 'no'"),
        (None, {"refine": None}, "refine must be True or False, got None"),
    ],
)
def test_identify___what_a_type_checker_would_refuse___is_reported(
    data: Any,  # noqa: ANN401 - what a user may give
    options: dict[str, Any],
    message: str,
) -> None:
    with pytest.raises(FlexarmError, match=message):
        identify(arm_experiment(10, 1000) if data is None else data, **options)


def test_identify___sine_as_input___warns_with_the_condition_number() -> None:
    model = random_model(5, inputs=1)
    u = np.sin(0.3 * np.arange(800))[:, np.newaxis]
    data = IoData(u, step_by_step(model, u), dt_s=DT_S, inputs=("u0",), outputs=("y0", "y1", "y2"))
    found = identify(data, order=5, block_rows=10, method="orse")
    assert "excites few frequencies" in found.warnings[0]


@pytest.mark.parametrize(
    ("method", "text"), [("orse", "a small bias remains"), ("orse_thesis", "plain ORSE is biased")]
)
def test_identify___closed_loop_record___warns(method: str, text: str) -> None:
    data = replace(arm_experiment(6, 1000), closed_loop=True)
    found = identify(data, order=9, method=method)
    assert any("closed-loop" in note and text in note for note in found.warnings)


def test_identify___offset_and_saturation___are_reported_by_channel() -> None:
    data = arm_experiment(7, 1000)
    y = data.y + np.array([0.0, 0.0, 1e5, 0.0])
    limit = 0.5 * np.abs(y[:, 3]).max()
    y[:, 3] = y[:, 3].clip(-limit, limit)
    found = identify(replace(data, y=y, source="run 7"), order=9, method="orse")
    names = {(warning.code, warning.channel) for warning in found.data_warnings}
    assert {("offset", "middle_strain_v"), ("saturation", "speed_v")} <= names
    assert all(f"{each.grade}: {each}" in found.warnings for each in found.data_warnings)


def test_identify___progress___ends_with_the_fit() -> None:
    seen: list[tuple[str, float]] = []
    identify(
        arm_experiment(8, 1500),
        progress=lambda stage, part: seen.append((stage, part)),
        method="orse",
    )
    stages = [stage for stage, _ in seen]
    assert stages[0] == "Hankel matrices"
    assert seen[-1] == ("fit", 1.0)
    assert ("order", 1.0) in seen
    assert all(0.0 <= part <= 1.0 for _, part in seen)


def test_identify___method_auto___names_what_it_chose() -> None:
    assert identify(arm_experiment(9, 1000), order=9, method="auto").method == "orse"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "pem"}, "method must be one of auto, orse, .*: 'pem'"),
        ({"block_rows": 1}, "block_rows must be 2 or more: 1"),
        ({"order": 0}, "order must lie between 1 and 39 for block_rows = 40: 0"),
        (
            {"order": 40, "block_rows": 40},
            "order must lie between 1 and 39 for block_rows = 40: 40; block_rows = 41 would do",
        ),
        (
            {"order": 200, "method": "orse"},
            "= 166: 200; .*: 1000 samples allow block_rows of at most 166: record longer",
        ),
        (
            {"block_rows": 300, "method": "orse"},
            "1000 samples are too few, block_rows = 300 needs at least 1800: ",
        ),
        (
            {"block_rows": 100, "method": "orse_iv"},
            r"1000 samples are too few, block_rows = 100 \(200 with those of the past\) needs .*$",
        ),
    ],
)
def test_identify___impossible_request___raises_one_clear_line(
    options: dict[str, Any], message: str
) -> None:
    with pytest.raises(IdentificationError, match=message) as caught:
        identify(arm_experiment(10, 1000), **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("options", [{"order": 900}, {"block_rows": 901, "method": "pbsid"}])
def test_identify___matrices_too_large___are_refused_with_what_would_do(
    options: dict[str, Any],
) -> None:
    data = arm_experiment(10, 30_000)
    with pytest.raises(IdentificationError, match="matrices of 9010 rows for 5 channels: 400 at"):
        identify(data, **options)


@pytest.mark.parametrize("samples", first_of([150, 250, 400]))
@pytest.mark.slow
def test_identify___record_too_short_for_forty_block_rows___has_fewer_of_them(samples: int) -> None:
    # 5 channels and 1 take 12 samples a block row with those of the past.
    data = record(arm_model(), samples, 3, noise=1e-4)
    found = identify(data)
    assert found.block_rows == samples // 12
    fresh = record(arm_model(), 2000, 4)
    assert validate_dmv(found.model, fresh).mean < 0.1


def test_identify___high_order___has_as_many_block_rows_as_it_needs() -> None:
    found = identify(arm_experiment(10, 1000), order=44, method="orse")
    assert (found.order, found.block_rows) == (44, 45)


@pytest.mark.parametrize("level", [0.0, 1.5])
def test_identify___constant_input___raises(level: float) -> None:
    data = arm_experiment(11, 1000)
    with pytest.raises(
        DataError, match="input command_v is constant in 1000 samples, it excites nothing"
    ):
        identify(replace(data, u=np.full_like(data.u, level)), method="orse")


def test_identify___records_do_not_match___raises() -> None:
    data = arm_experiment(12, 1000)
    with pytest.raises(DataError, match="dt_s"):
        identify([data, replace(data, dt_s=0.002)], method="orse")


@pytest.mark.parametrize("method", ["orse", "orse_iv", "pbsid", "orse_thesis"])
def test_identify___every_method___fits_the_arm(method: str) -> None:
    data = arm_experiment(21, 3000)
    found = identify(data, order=9, method=method)
    assert found.method == method
    assert np.all(found.fit_error < 0.2)
    assert found.diagram.orders
    assert len(found.mode_uncertainty) == len(found.modes)


@pytest.mark.parametrize("kind", first_of(["integrator", "free hub"]))
@pytest.mark.parametrize("seed", first_of(range(3)))
@pytest.mark.slow
def test_identify___free_motion___simulates_and_is_kept_by_the_refinement(
    seed: int, kind: str
) -> None:
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice(np.array([-1.0, 1.0]), 200), 30)
    u -= u.mean()
    drag = [1.0, -0.999] if kind == "free hub" else [1.0]
    travel = lfilter([0.0, 0.01], [1.0, -1.0], lfilter([1.0], drag, u))
    pole = 0.98 * np.exp(0.2j)
    bend = lfilter([0.0, 0.02], np.poly([pole, pole.conjugate()]).real, u)
    y = np.column_stack([travel + 0.1 * travel.std() * bend / bend.std(), bend])
    y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
    data = IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=("travel", "bend"))
    found = identify(data, method="auto")
    # The noise alone costs 0.010.
    assert found.fit_error.mean() < 0.015
    better = identify(data, method="auto", refine=True)
    assert better.fit_error.mean() < 1.001 * found.fit_error.mean()
