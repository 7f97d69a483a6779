from __future__ import annotations

import json
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from flexarm_ident import IoData, preprocess, read_bag
from flexarm_ident.diagnostics.stabilisation import Criteria, mac, stabilisation, subspace_matrices
from flexarm_ident.report.plots.order_plots import stabilisation_plot
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.orse import innovation_scaled, past_instruments
from flexarm_ident.subspace.subspace_protocol import StateMatrices
from support.ident_systems import DT_S, arm_model, square_wave, step_by_step
from support.project import BAGS

if TYPE_CHECKING:
    from flexarm_ident.diagnostics.stabilisation import Stabilisation

ARM_HZ = (9.4, 24.1, 45.6)
ARM_DAMPING = (0.04, 0.03, 0.02)


def rotation(frequency_hz: float, damping_ratio: float) -> np.ndarray:
    rate = 2.0 * np.pi * frequency_hz * DT_S
    lam = np.exp(rate * (-damping_ratio + 1j * np.sqrt(1.0 - damping_ratio**2)))
    return np.array([[lam.real, lam.imag], [-lam.imag, lam.real]])


def matrices(*modes: tuple[float, float, tuple[float, float]]) -> StateMatrices:
    """Return a block-diagonal model of modes: frequency, damping ratio and shape."""
    A = np.zeros((2 * len(modes), 2 * len(modes)))
    C = np.zeros((2, 2 * len(modes)))
    for i, (frequency_hz, damping_ratio, shape) in enumerate(modes):
        A[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = rotation(frequency_hz, damping_ratio)
        C[:, 2 * i] = shape
    return StateMatrices(A, C)


ONES = np.ones(2)


def test_stabilisation___mode_at_all_orders_among_wandering_ones___is_the_physical_one() -> None:
    rng = np.random.default_rng(0)
    by_order = {
        order: matrices(
            (10.0 + 0.02 * order, 0.03, (1.0, 0.5)), (rng.uniform(20.0, 140.0), 0.01, (1.0, -1.0))
        )
        for order in range(4, 24)
    }
    diagram = stabilisation(by_order, ONES, DT_S)
    (mode,) = diagram.modes
    # The first order has none before it.
    assert mode.orders == tuple(range(5, 24))
    assert mode.count == 19
    assert mode.share == pytest.approx(0.95)
    expected = 10.0 + 0.02 * np.arange(5, 24)
    assert mode.frequency_hz == pytest.approx(np.median(expected))
    assert mode.frequency_std_hz == pytest.approx(np.std(expected))
    assert mode.damping_ratio == pytest.approx(0.03)
    assert mode.damping_std == pytest.approx(0.0, abs=1e-9)
    assert mac(mode.shape, np.array([1.0, 0.5], dtype=complex)) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("second", "reason"),
    [
        ((10.5, 0.03, (1.0, 0.5)), "frequency"),
        ((10.0, 0.08, (1.0, 0.5)), "damping"),
        ((10.0, 0.03, (0.5, -1.0)), "shape"),
    ],
)
def test_stabilisation___mode_alternates_between_places___is_not_stable(
    second: tuple[float, float, tuple[float, float]], reason: str
) -> None:
    first = matrices((10.0, 0.03, (1.0, 0.5)))
    by_order = {order: matrices(second) if order % 2 else first for order in range(2, 12)}
    diagram = stabilisation(by_order, ONES, DT_S)
    assert all(pole.admissible for pole in diagram.poles)
    assert not any(pole.stable for pole in diagram.poles), reason
    assert diagram.modes == ()


@pytest.mark.parametrize("damping_ratio", [-0.01, 0.4])
def test_stabilisation___growing_or_overdamped___fails_the_hard_criterion(
    damping_ratio: float,
) -> None:
    one = matrices((10.0, damping_ratio, (1.0, 0.5)))
    diagram = stabilisation(dict.fromkeys(range(2, 12), one), ONES, DT_S)
    assert not any(pole.admissible or pole.stable for pole in diagram.poles)
    assert diagram.modes == ()


def test_stabilisation___two_modes_of_equal_frequency___are_distinguished_by_their_shapes() -> None:
    both = matrices((10.0, 0.03, (1.0, 0.0)), (10.02, 0.03, (0.0, 1.0)))
    diagram = stabilisation(dict.fromkeys(range(4, 14), both), ONES, DT_S)
    assert [mode.count for mode in diagram.modes] == [9, 9]
    assert mac(diagram.modes[0].shape, diagram.modes[1].shape) == pytest.approx(0.0, abs=1e-12)


def test_stabilisation___order_splits_a_mode___counts_once() -> None:
    split = matrices((10.0, 0.03, (1.0, 0.5)), (10.1, 0.03, (1.0, 0.5)))
    (mode,) = stabilisation(dict.fromkeys(range(4, 14), split), ONES, DT_S).modes
    assert mode.count == 9
    assert mode.share <= 1.0


def test_stabilisation___tighter_criteria___find_less() -> None:
    by_order = {order: matrices((10.0 + 0.02 * order, 0.03, (1.0, 0.5))) for order in range(2, 12)}
    assert len(stabilisation(by_order, ONES, DT_S).modes) == 1
    assert stabilisation(by_order, ONES, DT_S, Criteria(frequency=1e-4)).modes == ()


@pytest.mark.parametrize("seed", range(4))
def test_stabilisation___noisy_arm___finds_its_modes_with_the_least_scatter(seed: int) -> None:
    u = square_wave(6000, seed)
    y = step_by_step(arm_model(), u)
    y += 0.02 * y.std(axis=0) * np.random.default_rng(seed).normal(size=y.shape)
    space = innovation_scaled(block_gram([IoData(u, y, dt_s=DT_S)], 40))
    modes = stabilisation(subspace_matrices(space), space.output_scale, DT_S).modes
    steadiest = sorted(modes, key=lambda mode: mode.frequency_std_hz / mode.frequency_hz)[:3]
    steadiest.sort(key=lambda mode: mode.frequency_hz)
    np.testing.assert_allclose([mode.frequency_hz for mode in steadiest], ARM_HZ, rtol=0.01)
    np.testing.assert_allclose([mode.damping_ratio for mode in steadiest], ARM_DAMPING, atol=0.005)
    assert len(modes) <= 5


def recorded(bag: str) -> Stabilisation:
    data = preprocess(read_bag(BAGS / bag)).head(6000)
    space = past_instruments(block_gram([data], 80))
    return stabilisation(subspace_matrices(space), space.output_scale, data.dt_s)


@pytest.mark.parametrize("bag", ["c_dat3_0g", "c_dat3_400g"])
def test_stabilisation___recorded_experiment___first_modes_of_the_rig_stand_out(bag: str) -> None:
    manifest = json.loads((BAGS / "manifest.json").read_text())
    true_hz = next(entry["true_modes_hz"] for entry in manifest if entry["bag"] == bag)
    modes = recorded(bag).modes
    found_hz = [mode.frequency_hz for mode in modes[: len(true_hz)]]
    np.testing.assert_allclose(found_hz, true_hz, rtol=0.08)
    assert len(modes) <= 4


def test_mac___parallel_orthogonal_and_zero___is_one_zero_zero() -> None:
    shape = np.array([1.0 + 2.0j, -0.5j, 3.0], dtype=complex)
    assert mac(shape, (2.0 - 5.0j) * shape) == pytest.approx(1.0)
    assert mac(shape, np.array([0.0, 1.0, -1.0j / 6.0], dtype=complex)) == pytest.approx(
        0.0, abs=1e-15
    )
    assert mac(shape, np.zeros(3, dtype=complex)) == 0.0


def test_stabilisation_plot___diagram___is_an_element_that_names_the_modes() -> None:
    diagram = stabilisation(
        {order: matrices((10.0, 0.03, (1.0, 0.5))) for order in range(2, 12)}, ONES, DT_S
    )
    plot = stabilisation_plot(diagram, diagram.modes, known_modes_hz=(9.4,), order=8)
    root = ET.fromstring(plot)  # noqa: S314 (our own text)
    (view,) = (node for node in root.iter() if node.get("role") == "group")
    assert view.get("aria-label") == "stabilisation diagram, physical modes: 10 Hz"
    texts = {words for node in root.iter() for words in (node.text, node.tail)}
    assert {"frequency, Hz", "order", "stays", "known modes", "physical mode", "order 8"} <= texts
    assert plot == stabilisation_plot(diagram, diagram.modes, known_modes_hz=(9.4,), order=8)


def test_stabilisation_plot___no_physical_mode___is_stated() -> None:
    diagram = stabilisation({2: matrices((10.0, 0.03, (1.0, 0.5)))}, ONES, DT_S)
    svg = stabilisation_plot(diagram, ())
    assert "physical modes: none" in svg
    assert "/svg>physical mode<" not in svg
    assert "/svg>known modes<" not in svg


def test_stabilisation_plot___mode_that_recurs_only___is_not_shaded() -> None:
    both = matrices((10.0, 0.03, (1.0, 0.5)), (60.0, 0.01, (1.0, -0.5)))
    diagram = stabilisation(dict.fromkeys(range(4, 14), both), ONES, DT_S)
    assert len(diagram.modes) == 2
    svg = stabilisation_plot(diagram, diagram.modes[:1])
    assert "physical modes: 10 Hz" in svg
