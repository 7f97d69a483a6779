"""The order of a reduction that nobody asked for."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from flexarm_ident import IoData
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import step_by_step

ANGLES = (0.3, 0.8, 1.4, 2.0)
# The last pair hardly moves the output: three pairs are enough.
SHARES = (1.0, 1.0, 1.0, 0.003)


def record_of_pairs() -> IoData:
    """Return a record of a system with four complex pairs, in noise."""
    turns = [0.95 * np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in ANGLES]
    C = np.hstack([[[share, 0.0]] for share in SHARES])
    model = control.ss(block_diag(*turns), np.ones((8, 1)), C, np.zeros((1, 1)), 0.01)
    rng = np.random.default_rng(5)
    u, noise = rng.standard_normal((2, 1500, 1))
    return IoData(u, step_by_step(model, u) + 0.3 * noise, dt_s=0.01, inputs=("u",), outputs=("y",))


@pytest.mark.parametrize(("asked", "cautions"), [(None, 0), (5, 1), (6, 0)])
def test_reduction___of_pairs_alone___is_noted_where_an_order_between_was_asked_for(
    asked: int | None, cautions: int
) -> None:
    request = Request(
        order=8, block_rows=12, method="orse", reduction="mrm", reduced_order=asked, friction=False
    )
    outcome = run(record_of_pairs(), request)
    assert outcome.model.nstates == 6
    said = [note for note in outcome.warnings if "only complex pairs are left" in note]
    assert len(said) == cautions
