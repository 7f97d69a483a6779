"""Appendix B as shipped, the checks on models, and the loop delay."""

from __future__ import annotations

import control
import numpy as np
import pytest
from scipy.linalg import expm

import flexarm_ident
from flexarm_control import ControlError, nominal_model, nominal_payloads_kg
from flexarm_control.models.arm_model import (
    OUTPUTS,
    check_arm_model,
    check_no_feedthrough,
    delayed,
)
from flexarm_ident.fitting.validation import frequency_response
from support.project import PROJECT

DT_S = 1 / 300


def _pole_hz(model: control.StateSpace) -> np.ndarray:
    poles = np.linalg.eigvals(model.A)
    return np.sort(np.abs(np.log(poles[poles.imag > 0])) / (2 * np.pi * model.dt))


@pytest.mark.parametrize(
    ("payload_kg", "order", "sums"),
    [
        (0.0, 10, (282.4547, -2.8458, -3.2726)),
        (0.2, 9, (255.9475, -1.8214, -0.9712)),
        (0.4, 10, (366.6235, -7.6128, -0.5289)),
    ],
)
def test_nominal_model___shapes_and_sums___are_those_of_the_print(
    payload_kg: float, order: int, sums: tuple[float, float, float]
) -> None:
    model = nominal_model(payload_kg)

    assert (model.A.shape, model.B.shape, model.C.shape) == ((order, order), (order, 1), (4, order))
    # Each entry weighted by the product of its row and column number, from 1.
    weighted = [
        np.arange(1, 1 + len(matrix)) @ matrix @ np.arange(1, 1 + matrix.shape[1])
        for matrix in (model.A, model.B, model.C)
    ]
    assert weighted == pytest.approx(list(sums), abs=1e-9)
    assert not model.D.any()


def test_nominal_model___flipped___differs_in_the_sign_of_y3_alone() -> None:
    printed, flipped = nominal_model(0.2), nominal_model(0.2, flip_middle_strain=True)

    assert np.array_equal(flipped.C, [[1.0], [1.0], [-1.0], [1.0]] * printed.C)
    assert np.array_equal(flipped.A, printed.A)
    assert np.array_equal(flipped.B, printed.B)
    assert np.array_equal(nominal_model(0.2).C, printed.C)


def test_nominal_model___entries___are_those_of_the_print() -> None:
    light, middle, heavy = (nominal_model(payload_kg) for payload_kg in (0.0, 0.2, 0.4))

    assert light.A[0].tolist() == [
        1.0003, 0.0049, 0.0041, 0.0018, 0.0030, -0.0008, -0.0014, -0.0017, 0.0025, -0.0034,
    ]  # fmt: skip
    assert light.B[:, 0].tolist() == [
        0.0067, 0.0616, 0.1334, -0.1289, -0.1902, -0.1357, 0.2688, 0.2048, 0.3271, -0.7559,
    ]  # fmt: skip
    assert (light.A[8, 9], light.A[9, 8], light.C[1, 9]) == (-0.7785, 0.7968, -0.2824)
    assert (middle.A[6, 7], middle.A[7, 6], middle.B[7, 0]) == (-0.4358, 0.4752, -0.5222)
    assert (middle.C[0, 8], middle.C[3, 8]) == (0.6455, -0.0675)
    assert (heavy.A[5, 6], heavy.A[9, 9], heavy.B[6, 0]) == (0.3663, 0.9987, -0.4077)
    assert (heavy.C[0, 9], heavy.C[1, 9], heavy.C[2, 9]) == (1.2194, -1.8546, 1.212)


def test_nominal_model___names_and_rate___are_set() -> None:
    model = nominal_model(0.2)

    assert tuple(model.output_labels) == OUTPUTS
    assert model.input_labels == ["command_v"]
    assert model.dt == pytest.approx(DT_S)


def test_nominal_model___no_payload___has_the_modes_of_the_thesis() -> None:
    assert _pole_hz(nominal_model(0.0))[-3:] == pytest.approx([9.03, 22.8, 46.0], abs=0.05)


def test_nominal_model___other_payload___names_the_available() -> None:
    with pytest.raises(ControlError, match=r"payload_kg = 0\.3; Appendix B has 0, 0\.2, 0\.4 kg"):
        nominal_model(0.3)


def test_nominal_payloads___sorted___are_three() -> None:
    assert nominal_payloads_kg() == (0.0, 0.2, 0.4)


def _model(**changes: object) -> control.StateSpace:
    arguments: dict[str, object] = {"dt": DT_S, "outputs": list(OUTPUTS), **changes}
    return control.StateSpace([[0.9]], [[1.0]], np.ones((4, 1)), np.zeros((4, 1)), **arguments)


@pytest.mark.parametrize("dt", [0, None, True])
def test_check_arm_model___no_sampling_interval___is_refused(dt: object) -> None:
    with pytest.raises(ControlError, match="set its sampling period"):
        check_arm_model(_model(dt=dt))


def test_check_arm_model___two_outputs___is_refused() -> None:
    model = control.StateSpace([[0.9]], [[1.0]], [[1.0], [1.0]], 0, DT_S)

    with pytest.raises(ControlError, match="inputs: 1, outputs: 2") as refused:
        check_arm_model(model)
    # The way on is there: a function, and a section of a page.
    assert "load_model" in flexarm_ident.__all__
    page = PROJECT / "docs" / "howto" / "own_rig.md"
    assert str(page.relative_to(PROJECT)) in str(refused.value)
    assert "\n## Other signals\n" in page.read_text()
    assert "every law takes one input and the outputs position_v, " in str(refused.value)
    assert "'Other signals'" in str(refused.value)
    assert "flexarm_ident.load_model" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_check_arm_model___outputs_in_another_order___is_refused() -> None:
    with pytest.raises(ControlError, match="reorder them to position_v, base_strain_v"):
        check_arm_model(_model(outputs=list(OUTPUTS[::-1])))


def test_check_arm_model___outputs_without_names___is_accepted() -> None:
    check_arm_model(control.StateSpace([[0.9]], [[1.0]], np.ones((4, 1)), 0, DT_S))


def test_check_no_feedthrough___late_model___is_accepted() -> None:
    model = control.StateSpace([[0.9]], [[1.0]], np.ones((4, 1)), np.ones((4, 1)), DT_S)

    with pytest.raises(ControlError, match="D is not zero"):
        check_no_feedthrough(model)
    check_no_feedthrough(delayed(model, 0.1 * DT_S))


@pytest.mark.parametrize("samples", [0, 1, 3])
def test_delayed___whole_samples___are_powers_of_z(samples: int) -> None:
    model = nominal_model(0.0)
    frequency_hz = np.array([0.5, 9.0, 46.0, 120.0])
    shift = np.exp(-2j * np.pi * frequency_hz * DT_S * samples)[:, None, None]

    late = frequency_response(delayed(model, samples * DT_S), frequency_hz)

    assert np.allclose(late, shift * frequency_response(model, frequency_hz), rtol=1e-9)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.85])
def test_delayed___fraction_of_a_sample___is_the_continuous_plant_with_late_input(
    share: float,
) -> None:
    # A double integrator and a mode, sampled by the matrix exponential on either side.
    F = np.zeros((4, 4))
    F[0, 1] = 1.0
    F[2:, 2:] = [[0.0, 1.0], [-((2 * np.pi * 40) ** 2), -5.0]]
    g = np.array([[0.0], [1.0], [0.0], [1.0]])

    def hold(time_s: float) -> tuple[np.ndarray, np.ndarray]:
        both = expm(np.block([[F, g], [np.zeros((1, 5))]]) * time_s)
        return both[:4, :4], both[:4, 4:]

    A, b = hold(DT_S)
    rest, b_new = hold((1 - share) * DT_S)
    _, b_before = hold(share * DT_S)

    late = delayed(control.StateSpace(A, b, np.eye(4), 0, DT_S), share * DT_S)

    assert np.allclose(late.B[:4], b_new, atol=1e-9 * np.abs(b).max())
    assert np.allclose(late.A[:4, 4:], rest @ b_before, atol=1e-9 * np.abs(b).max())


def test_delayed___names___are_kept() -> None:
    late = delayed(nominal_model(0.0), 0.001)

    assert tuple(late.output_labels) == OUTPUTS
    assert late.input_labels == ["command_v"]
    assert late.dt == pytest.approx(DT_S)


@pytest.mark.parametrize("delay_s", [-0.001, np.nan, np.inf])
def test_delayed___impossible_delay___is_refused(delay_s: float) -> None:
    with pytest.raises(ControlError, match="finite and not negative"):
        delayed(nominal_model(0.0), delay_s)
