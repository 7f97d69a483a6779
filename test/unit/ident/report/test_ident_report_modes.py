"""Time constants in the report's tables of modes."""

from __future__ import annotations

import control
import numpy as np

from flexarm_ident import IoData
from flexarm_ident.models.model_parameters import model_parameters
from flexarm_ident.provenance import model_provenance
from flexarm_ident.report.content.blocks import Subject
from flexarm_ident.report.page import render_report
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import step_by_step


def test_render_report___mode_that_does_not_oscillate___has_its_time_constant() -> None:
    u = np.random.default_rng(1).standard_normal((600, 1))
    # They fall to 1/e in 62 and in 9 samples of 10 ms.
    model = control.ss(np.diag(np.exp([-1 / 62, -1 / 9])), np.ones((2, 1)), [[1.0, 2.0]], 0, 0.01)
    data = IoData(u, step_by_step(model, u), dt_s=0.01, inputs=("u",), outputs=("y",))
    request = Request(order=2, block_rows=5, method="orse", reduction="mrm", friction=False)
    outcome = run(data, request)
    provenance = model_provenance(outcome, outcome.records)
    parameters = model_parameters("arm", outcome.model, provenance=provenance)
    text = render_report(Subject(outcome, "arm", parameters, ()), title="An arm")
    for title in ("Modes", "Reduction"):
        section = text.split(f"<h2>{title}</h2>")[1].split("</section>")[0]
        assert [f"<td>{told} s</td>" in section for told in ("0.62", "0.09")] == [True, True]
