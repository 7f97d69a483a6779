"""Requests that the records cannot meet: what a run refuses, or does in their place."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flexarm_ident import IdentificationError, IoData
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import random_model, step_by_step


def white_noise_record(samples: int) -> IoData:
    """Return a record of a system with 1 input and 2 outputs, 100 Hz."""
    u = np.random.default_rng(3).standard_normal((samples, 1))
    y = step_by_step(random_model(1, states=4, outputs=2, inputs=1), u)
    return IoData(u, y, dt_s=0.01, inputs=("u",), outputs=("y", "z"))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"block_rows": 80, "method": "orse"},
            "the leading 300 of 600 samples are too few, block_rows = 80 needs at least 320: ",
        ),
        (
            {"block_rows": 40},
            r"300 of 600 samples are too few, block_rows = 40 \(80 with those of the past\) needs",
        ),
        (
            {"order": 500},
            "= 37: 500; record: the leading 300 of 600 samples allow block_rows of at most 37: ",
        ),
    ],
)
def test_run___fitted_part_too_short___every_refusal_names_it_and_the_way_out(
    fields: dict[str, Any], message: str
) -> None:
    with pytest.raises(IdentificationError, match=message) as caught:
        run(white_noise_record(600), Request(train_fraction=0.5, **fields))
    assert str(caught.value).endswith(", or fit a longer part (train_fraction)")


def test_run___known_mode_above_half_the_rate___is_refused_before_the_fit() -> None:
    request = Request(reduction="mrmc", known_modes_hz=(9.4, 50.0))
    reported: list[str] = []
    with pytest.raises(IdentificationError, match=r"known mode of 50 Hz .* samples at 100 Hz: "):
        run(white_noise_record(600), request, progress=lambda stage, _: reported.append(stage))
    assert not reported


def test_run___input_of_no_linear_law___note_asks_for_nothing_that_cannot_be_given() -> None:
    u = np.random.default_rng(3).standard_normal((600, 1))
    y = step_by_step(random_model(1, states=4, outputs=3, inputs=1), u)
    outputs = ("position_v", "middle_strain_v", "speed_v")
    record = IoData(u, y, dt_s=0.01, outputs=outputs, reference=np.ones(600))
    outcome = run(record, Request(order=4, block_rows=10, method="orse"))
    assert outcome.sfv is None
    assert outcome.warnings[-1] == (
        "information: no set-point following validation: no linear law of position, speed and "
        "middle strain made the recorded effort"
    )


def test_run___filter_on_the_outputs_alone___is_why_the_law_is_not_found() -> None:
    a = np.array([[1.0, 0.01, 0.0], [0.0, 0.95, 0.0], [0.0, 0.3, 0.5]])
    x, noise = np.zeros(3), 0.01 * np.random.default_rng(2).standard_normal((1200, 3))
    reference = np.where(np.arange(1200) // 200 % 2, -1.0, 1.0)
    u, y = np.empty((1200, 1)), np.empty((1200, 3))
    for k in range(1200):
        y[k] = x + noise[k]
        u[k] = 2.0 * (reference[k] - y[k, 0]) - 0.1 * y[k, 1]
        x = a @ x + np.array([0.0, 0.1, 1.0]) * u[k]
    outputs = ("position_v", "speed_v", "middle_strain_v")
    record = IoData(u, y, dt_s=0.01, outputs=outputs, reference=reference)
    request = Request(
        method="orse", order=3, block_rows=10, feedthrough="no", cutoff_hz=20.0, friction=False
    )
    found = run(record, request).sfv
    assert found is not None
    assert (found.gains.kp, found.gains.kd) == pytest.approx((2.0, 0.1))
    outputs_alone = run(record, replace(request, filter_input=False))
    assert outputs_alone.sfv is None
    assert outputs_alone.warnings[-1] == (
        "information: no set-point following validation: the controller used the unfiltered "
        "outputs; --cutoff 0 takes these"
    )


@pytest.mark.parametrize("known_modes_hz", [(), (5.0, 9.0, 14.0, 20.0, 26.0, 33.0)])
def test_run___reduced_order_above_the_chosen_one___keeps_the_whole_model_with_a_note(
    known_modes_hz: tuple[float, ...],
) -> None:
    record = white_noise_record(600)
    request = Request(
        block_rows=10,
        method="orse",
        reduction="mrmc" if known_modes_hz else "mrm",
        reduced_order=12,
        known_modes_hz=known_modes_hz,
        friction=False,
    )
    outcome = run(record, request)
    full = outcome.identification.order
    assert full < 12
    assert outcome.model.nstates == full
    assert all(mode.kept for mode in outcome.modes)
    note = f"caution: the whole model was kept: the data gave {full} states, 12 were to be kept"
    assert any(warning.startswith(note) for warning in outcome.warnings)


def test_run___more_known_modes_than_the_chosen_order_holds___keeps_the_whole_model() -> None:
    record = white_noise_record(600)
    request = Request(
        block_rows=8, method="orse", reduction="mrmc", known_modes_hz=(5.0, 9.0, 14.0, 20.0, 26.0)
    )
    outcome = run(record, request)
    assert outcome.model.nstates == outcome.identification.order < 10


@pytest.mark.parametrize("late", [[1], [0, 1]])
def test_run___sensor_that_begins_late___result_is_that_of_the_rest(late: list[int]) -> None:
    whole = white_noise_record(900)
    y = whole.y + 0.01 * np.random.default_rng(5).standard_normal(whole.y.shape)
    holed = y.copy()
    holed[:300, late] = np.nan

    found = run(IoData(whole.u, holed, dt_s=0.01, inputs=("u",), outputs=("y", "z")), Request())

    rest = IoData(whole.u[300:], y[300:], dt_s=0.01, inputs=("u",), outputs=("y", "z"))
    expected = run(rest, Request())
    np.testing.assert_array_equal(found.model.A, expected.model.A)
    np.testing.assert_array_equal(found.dmv_errors, expected.dmv_errors)
    (reported,) = set(found.warnings) - set(expected.warnings)
    assert reported == (
        f"information: record: {'yz'[late[0]]} was not measured before 3 s (row 300): the record "
        "is used from there on"
    )
