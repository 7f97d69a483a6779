from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import control as python_control
import numpy as np
import pytest
from scipy import linalg

from flexarm_ident import IdentificationError
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.reduction.balanced import balanced_truncation
from support.ident_systems import named, pulse_responses, random_model

if TYPE_CHECKING:
    import control

FREQUENCIES_HZ = np.linspace(0.0, 150.0, 2000)


@pytest.mark.slow
def test_balanced_truncation___any_order___singular_values_are_those_of_the_hankel_matrix() -> None:
    model = random_model(1, states=6)
    blocks = pulse_responses(model, 600)[1:]
    # Rows are outputs at later times, columns inputs at earlier ones.
    hankel = np.block([[blocks[i + j] for j in range(300)] for i in range(300)])
    found = balanced_truncation(model, 3)
    expected = linalg.svdvals(hankel)[:6]
    np.testing.assert_allclose(found.hankel_singular_values, expected, rtol=1e-6)


@pytest.mark.parametrize("order", [1, 3, 5])
def test_balanced_truncation___feedthrough___error_is_below_the_bound(order: int) -> None:
    model = random_model(2, states=6, feedthrough=True)
    found = balanced_truncation(model, order)
    apart = frequency_response(model, FREQUENCIES_HZ) - frequency_response(
        found.model, FREQUENCIES_HZ
    )
    worst = np.linalg.norm(apart, ord=2, axis=(1, 2)).max()
    assert found.model.nstates == order
    # Enns (1984): between the first value left out and twice the sum of all of them.
    left_out = found.hankel_singular_values[order:]
    assert left_out[0] * (1.0 - 1e-3) <= worst <= 2.0 * left_out.sum()


def test_balanced_reduction_of_python_control___without_slycot___is_none() -> None:
    if find_spec("slycot"):
        pytest.skip("slycot is installed")
    with pytest.raises(ImportError, match="slycot"):
        python_control.balanced_reduction(random_model(2, states=6), 3)


def test_balanced_truncation___own_order___same_model_with_its_names() -> None:
    model = random_model(3, states=6, feedthrough=True)
    same = balanced_truncation(model, 6).model
    np.testing.assert_allclose(pulse_responses(same), pulse_responses(model), atol=1e-9)
    assert list(same.input_labels) == list(model.input_labels)
    assert list(same.output_labels) == list(model.output_labels)
    assert same.dt == model.dt


def test_balanced_truncation___output_scale___weights_the_outputs() -> None:
    A = np.diag([0.9, 0.5])
    model = named(A, np.ones((2, 1)), np.diag([1.0, 1e-3]), np.zeros((2, 1)))
    assert np.linalg.eigvals(balanced_truncation(model, 1).model.A)[0] == pytest.approx(
        0.9, abs=1e-3
    )
    scaled = balanced_truncation(model, 1, np.array([1e-3, 1e3])).model
    assert np.linalg.eigvals(scaled.A)[0] == pytest.approx(0.5, abs=1e-3)


def with_an_integrator(model: control.StateSpace) -> control.StateSpace:
    A = linalg.block_diag(model.A, [[1.0]])
    B = np.vstack([model.B, np.full((1, model.ninputs), 0.3)])
    C = np.hstack([model.C, np.full((model.noutputs, 1), 0.7)])
    return named(A, B, C, model.D)


def test_balanced_truncation___integrator___is_kept_as_it_is() -> None:
    model = random_model(4, states=4)
    found = balanced_truncation(with_an_integrator(model), 3)
    assert found.unstable == 1
    assert found.model.nstates == 3
    assert np.abs(np.linalg.eigvals(found.model.A) - 1.0).min() < 1e-12
    alone = balanced_truncation(model, 2)
    np.testing.assert_allclose(
        found.hankel_singular_values, alone.hankel_singular_values, rtol=1e-8
    )
    expected = pulse_responses(alone.model)[1:] + 0.21
    np.testing.assert_allclose(pulse_responses(found.model)[1:], expected, atol=1e-9)


def test_balanced_truncation___unreachable_states___are_dropped() -> None:
    model = named(np.diag([0.9, 0.5]), np.array([[1.0], [0.0]]), np.ones((1, 2)), np.zeros((1, 1)))
    assert balanced_truncation(model, 2).model.nstates == 1


@pytest.mark.parametrize("order", [0, 6])
def test_balanced_truncation___impossible_order___raises(order: int) -> None:
    with pytest.raises(IdentificationError, match="order must lie between 1 and the model's 5"):
        balanced_truncation(random_model(5), order)
