"""Bound of a truncation by the modal response magnitudes of what it drops (docs/mrm.md)."""

from __future__ import annotations

from itertools import combinations
from typing import TypeAlias

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from flexarm_ident.models.modes import modal_form, modal_response_magnitudes
from flexarm_ident.reduction.modal import truncate
from support.ident_systems import random_model, record, step_by_step

SEEDS = st.integers(0, 10_000)
SAMPLES = 200
Reductions: TypeAlias = tuple[NDArray[np.float64], dict[tuple[int, ...], float]]


@st.composite
def reductions(draw: st.DrawFn) -> Reductions:
    """Return the MRM of each mode, and the error of every set of dropped modes."""
    seed = draw(SEEDS)
    model = random_model(seed, draw(st.integers(3, 6)), draw(st.integers(1, 3)))
    data = record(model, SAMPLES, seed)
    scale = np.random.default_rng(seed).uniform(0.1, 10.0, model.noutputs)
    form = modal_form(model)
    groups = form.groups
    full = step_by_step(model, data.u)
    errors = {}
    for count in range(1, len(groups)):
        for dropped in combinations(range(len(groups)), count):
            kept = [s for i, group in enumerate(groups) if i not in dropped for s in group]
            rest = step_by_step(truncate(model, kept), data.u)
            errors[dropped] = float(np.max(scale * np.abs(full - rest).mean(axis=0)))
    return modal_response_magnitudes(form, [data], scale), errors


@settings(max_examples=25)
@given(reductions())
def test_truncation___any_modes_dropped___errs_between_the_bounds_of_their_mrm(
    reduction: Reductions,
) -> None:
    mrm, errors = reduction
    slack = 1e-9 * mrm.sum()
    for dropped, error in errors.items():
        total = mrm[list(dropped)].sum()
        assert 2.0 * mrm[list(dropped)].max() - total - slack <= error <= total + slack
        # By rising MRM the bound is the least of all sets of that size.
        assert np.sort(mrm)[: len(dropped)].sum() <= total + slack


@settings(max_examples=25)
@given(reductions())
def test_truncation___one_mode_dropped___errs_by_its_mrm(
    reduction: Reductions,
) -> None:
    mrm, errors = reduction
    alone = {dropped[0]: error for dropped, error in errors.items() if len(dropped) == 1}
    for mode, error in alone.items():
        np.testing.assert_allclose(error, mrm[mode], rtol=1e-7, atol=1e-9 * mrm.sum())
