"""What every estimator of the family must do, whatever the data."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from flexarm_ident import identify, reduce_model
from flexarm_ident.subspace.feedback import reaches_inputs
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.methods import METHODS
from support.exhaustive import wide
from support.ident_systems import named, pulse_responses, random_model, record, step_by_step

if TYPE_CHECKING:
    import control
    from numpy.typing import NDArray

    from flexarm_ident import Identification, IoData

    Array = NDArray[np.float64]

SEEDS = st.integers(0, 10_000)
STATES, BLOCK_ROWS = 5, 8
few = settings(max_examples=wide(4, 12), suppress_health_check=[HealthCheck.too_slow])
every_method = pytest.mark.parametrize("method", list(METHODS))


def found(data: IoData | list[IoData], method: str, order: int = STATES) -> Identification:
    return identify(data, order=order, block_rows=BLOCK_ROWS, method=method)


def agree(one: control.StateSpace, other: control.StateSpace, tolerance: float) -> None:
    expected = pulse_responses(one)
    np.testing.assert_allclose(
        pulse_responses(other), expected, rtol=0.0, atol=tolerance * np.abs(expected).max()
    )


def transformed(model: control.StateSpace, seed: int) -> control.StateSpace:
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(model.nstates, model.nstates)))[0]
    T = Q @ np.diag(rng.uniform(0.5, 2.0, model.nstates))
    inverse = np.linalg.inv(T)
    other = named(T @ model.A @ inverse, T @ model.B, model.C @ inverse, model.D)
    other.set_inputs(list(model.input_labels))
    other.set_outputs(list(model.output_labels))
    return other


@every_method
@few
@given(SEEDS)
def test_identify___noise_free_data___the_system_itself(method: str, seed: int) -> None:
    model = random_model(seed)
    # The method of the thesis takes records that start from rest.
    data = record(model, 800, seed, at_rest=method == "orse_thesis")
    answer = found(data, method)
    # The weakest mode limits the digits that one record holds.
    weakest = answer.singular_values[STATES - 1] / answer.singular_values[0]
    agree(model, answer.model, 1e-8 + 1e-12 / weakest)
    simulated = step_by_step(answer.model, data.u, answer.x0[0])
    np.testing.assert_allclose(
        simulated, data.y, rtol=0.0, atol=(1e-8 + 1e-12 / weakest) * np.abs(data.y).max()
    )


@every_method
@few
@given(SEEDS)
def test_identify___another_realisation_of_the_plant___same_model(method: str, seed: int) -> None:
    model = random_model(seed)
    here = record(model, 700, seed, noise=0.05, at_rest=True)
    there = record(transformed(model, seed), 700, seed, noise=0.05, at_rest=True)
    np.testing.assert_allclose(there.y, here.y, rtol=0.0, atol=1e-9 * np.abs(here.y).max())
    agree(found(here, method).model, found(there, method).model, 1e-6)


@every_method
@few
@given(SEEDS, st.integers(1, 4))
def test_reduce_model___identified_model_in_other_coordinates___same_reduced_model(
    method: str, seed: int, order: int
) -> None:
    data = record(random_model(seed), 700, seed, noise=0.05)
    here = found(data, method)
    there = replace(here, model=transformed(here.model, seed))
    reduced = [
        reduce_model(each, data, order=order, ranking=ranking, update=update)
        for each in (here, there)
        for ranking in ("mrm", "msv")
        for update in ("none", "b")
    ]
    for one, other in zip(reduced[:4], reduced[4:], strict=True):
        assert one.kept == other.kept
        agree(one.model, other.model, 1e-6)


@every_method
@few
@given(SEEDS)
def test_identify___records_in_another_order___same_model(method: str, seed: int) -> None:
    model = random_model(seed)
    first, second = record(model, 400, seed, noise=0.05), record(model, 500, seed + 1, noise=0.05)
    one, other = found([first, second], method), found([second, first], method)
    agree(one.model, other.model, 1e-6)
    np.testing.assert_allclose(other.fit_error, one.fit_error, rtol=1e-6)


@few
@given(SEEDS, st.integers(2, 10))
def test_block_gram___several_records___sum_of_theirs(seed: int, block_rows: int) -> None:
    model = random_model(seed)
    records = [record(model, 100 + 50 * i, seed + i, noise=0.1) for i in range(3)]
    apart = sum(block_gram([each], block_rows).matrix for each in records)
    together = block_gram(records, block_rows)
    np.testing.assert_allclose(
        together.matrix, apart, rtol=0.0, atol=1e-12 * np.abs(together.matrix).max()
    )
    assert together.columns == sum(len(each) - block_rows + 1 for each in records)


@every_method
@few
@given(SEEDS)
def test_identify___one_record_given_twice___same_model(method: str, seed: int) -> None:
    data = record(random_model(seed), 700, seed, noise=0.05)
    # Twice the record is twice the evidence of feedback, on which the instruments' weight depends.
    both = (block_gram(records, 2 * BLOCK_ROWS) for records in ([data], [data, data]))
    once, twice = (gram.leading(BLOCK_ROWS) for gram in both)
    assume(reaches_inputs(once) == reaches_inputs(twice))
    agree(found(data, method).model, found([data, data], method).model, 1e-6)


# As it is printed, (2-17) weighs an output by its unit: the thesis divides by maxima before.
@pytest.mark.parametrize("method", [each for each in METHODS if each != "orse_thesis"])
@few
@given(
    SEEDS,
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    st.floats(-3.0, 3.0),
)
def test_identify___other_units___model_changes_by_them_only(
    method: str, seed: int, exponents: list[float], input_exponent: float
) -> None:
    data = record(random_model(seed), 700, seed, noise=0.05)
    unit, input_unit = 10.0 ** np.array(exponents), 10.0**input_exponent
    here = found(data, method)
    there = found(replace(data, y=data.y * unit, u=data.u * input_unit), method)
    back = pulse_responses(there.model) / unit[:, np.newaxis] * input_unit
    expected = pulse_responses(here.model)
    np.testing.assert_allclose(back, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(there.fit_error, here.fit_error, rtol=1e-6)


@every_method
@few
@given(SEEDS, st.integers(3, 7), st.floats(0.0, 0.5))
def test_identify___any_data___modes_are_real_or_come_in_conjugate_pairs(
    method: str, seed: int, order: int, noise: float
) -> None:
    data = record(random_model(seed), 400, seed, noise=noise)
    answer = found(data, method, order=min(order, STATES) if noise < 1e-3 else order)
    assert all(np.isrealobj(part) for part in (answer.model.A, answer.model.B, answer.model.C))
    eigenvalues = np.linalg.eigvals(answer.model.A)
    for value in eigenvalues:
        assert np.abs(eigenvalues - value.conj()).min() < 1e-9
    states = sorted(state for mode in answer.modes for state in mode.states)
    assert states == list(range(answer.order))
    for mode in answer.modes:
        assert mode.is_pair == (mode.eigenvalue.imag > 0.0)
        assert np.abs(eigenvalues - mode.eigenvalue).min() < 1e-9


@every_method
@pytest.mark.parametrize("ranking", ["mrm", "msv"])
@few
@given(SEEDS)
def test_reduce_model___own_order___is_the_identity(method: str, ranking: str, seed: int) -> None:
    data = record(random_model(seed), 500, seed, noise=0.05)
    answer = found(data, method)
    reduced = reduce_model(
        answer,
        data,
        ranking=ranking,  # type: ignore[arg-type]
        order=STATES,
        update="none",
    )
    assert all(mode.kept for mode in reduced.modes)
    agree(answer.model, reduced.model, 1e-9)
