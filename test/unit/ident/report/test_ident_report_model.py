"""Words of the report about a model that the likelihood has made of its start."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
import scipy

from flexarm_ident import IoData
from flexarm_ident.report.content.blocks import Facts, Subject, Words
from flexarm_ident.report.sections import model, residuals
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from flexarm_ident.workflow.outcome import Outcome

DT_S, SAMPLES = 0.01, 4000
MODE_RAD_S, DAMPING = 2.0 * np.pi * 3.1, 0.03


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    """Return the identification of a free hub with drag that carries one mode."""
    A = np.zeros((4, 4))
    A[0, 1], A[1, 1], A[2, 3] = 1.0, -1.0, 1.0
    A[3, 2:] = -(MODE_RAD_S**2), -2.0 * DAMPING * MODE_RAD_S
    B = np.array([[0.0], [3.0], [0.0], [40.0]])
    C = np.array([[1.0, 0.0, 0.02, 0.0], [0.0, 0.0, 1.0, 0.0]])
    A, B, C, *_ = scipy.signal.cont2discrete((A, B, C, np.zeros((2, 1))), DT_S)
    rng = np.random.default_rng(1)
    phase = 2.0 * np.pi * 0.4 * DT_S * np.arange(SAMPLES)
    u = np.sign(np.sin(phase + 0.05 * rng.normal(size=SAMPLES).cumsum()))[:, None]
    x, y = np.zeros(4), np.zeros((SAMPLES, 2))
    for k in range(SAMPLES):
        y[k] = C @ x
        x = A @ x + B @ u[k]
    y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
    data = IoData(u, y, dt_s=DT_S, inputs=("torque",), outputs=("angle", "strain"))
    return run(data, Request(bias="none"))


def test_model_section___likelihood_took_the_place_of_the_start___is_what_the_words_say(
    outcome: Outcome,
) -> None:
    assert outcome.identification.likelihood is not None
    assert outcome.model.nstates == 4
    # The subspace model before had more states and an eigenvalue outside the unit circle.
    assert not any("moved into the unit circle" in each for each in outcome.warnings)
    assert any("the model integrates" in each for each in outcome.warnings)
    facts = next(iter(model.SECTION.build(Subject(outcome, "hub", {}))))
    assert isinstance(facts, Facts)
    reported = dict(facts.facts)
    assert reported["eigenvalues moved into the unit circle"] == "0"
    assert "fitted by maximum likelihood" in reported
    assert "fitted by simulation" not in reported


def test_residuals_section___coherent_output___is_explained(outcome: Outcome) -> None:
    words = [
        each.text
        for each in residuals.SECTION.build(Subject(outcome, "hub", {}))
        if isinstance(each, Words)
    ]
    assert any("The coherent output is the share of an output's power" in each for each in words)
