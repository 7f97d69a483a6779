"""Time constants in the report's tables of modes."""

from __future__ import annotations

from typing import Literal

import control
import numpy as np
import pytest

from flexarm_ident import IoData
from flexarm_ident.models.model_parameters import model_parameters
from flexarm_ident.provenance import model_provenance
from flexarm_ident.report.content.blocks import Subject
from flexarm_ident.report.page import render_report
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import step_by_step


def rendered(data: IoData, request: Request) -> str:
    outcome = run(data, request)
    provenance = model_provenance(outcome, outcome.records)
    parameters = model_parameters("arm", outcome.model, provenance=provenance)
    return render_report(Subject(outcome, "arm", parameters, ()), title="An arm")


def section(text: str, title: str) -> str:
    return text.split(f"<h2>{title}</h2>")[1].split("</section>", maxsplit=1)[0]


def answer(eigenvalues: np.ndarray) -> IoData:
    """Return what modes that do not oscillate answer to noise."""
    u = np.random.default_rng(1).standard_normal((600, 1))
    states = len(eigenvalues)
    model = control.ss(np.diag(eigenvalues), np.ones((states, 1)), [np.arange(1.0, states + 1)], 0)
    model.dt = 0.01
    return IoData(u, step_by_step(model, u), dt_s=0.01, inputs=("u",), outputs=("y",))


def test_render_report___mode_that_does_not_oscillate___has_its_time_constant() -> None:
    # They fall to 1/e in 62 and in 9 samples of 10 ms.
    data = answer(np.exp([-1 / 62, -1 / 9]))
    request = Request(order=2, block_rows=5, method="orse", reduction="mrm", friction=False)
    text = rendered(data, request)
    for title in ("Modes", "Reduction"):
        found = section(text, title)
        assert [f"<td>{reported} s</td>" in found for reported in ("0.62", "0.09")] == [True, True]


@pytest.mark.parametrize(
    ("ranking", "known_hz", "reduced"), [("mrm", (), None), ("mrmc", (9.0,), None), ("msv", (), 1)]
)
def test_render_report___reduction_of_one_mode___says_that_there_is_nothing_to_reduce(
    ranking: Literal["mrm", "mrmc", "msv"], known_hz: tuple[float, ...], reduced: int | None
) -> None:
    request = Request(
        order=1,
        block_rows=5,
        method="orse",
        reduction=ranking,
        reduced_order=reduced,
        known_modes_hz=known_hz,
        friction=False,
    )
    found = section(rendered(answer(np.exp([-1 / 20])), request), "Reduction")
    assert "The model has one mode alone: there is nothing to reduce." in found
    assert "Errors of the full, the reduced" not in found


def test_render_report___whole_model_with_known_modes_beyond_its_states___is_shown() -> None:
    request = Request(
        order=2,
        block_rows=5,
        method="orse",
        reduction="mrmc",
        known_modes_hz=(9.0, 20.0),
        friction=False,
    )
    text = rendered(answer(np.exp([-1 / 62, -1 / 9])), request)
    assert "MRMC, cut" in section(text, "Reduction")
