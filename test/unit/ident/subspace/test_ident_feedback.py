from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy import linalg, signal, stats

from flexarm_ident import IoData, preprocess, read_bag
from flexarm_ident.subspace.feedback import feedback_test
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.loop_test import is_closed_loop
from support.exhaustive import wide
from support.ident_systems import DT_S, arm_model, random_model, square_wave, step_by_step
from support.project import BAGS

if TYPE_CHECKING:
    from collections.abc import Callable

    import control
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def open_loop(seed: int, *, colour: str = "white", samples: int = 3000) -> IoData:
    rng = np.random.default_rng(seed)
    u = square_wave(samples, seed)
    y = step_by_step(arm_model(), u)
    noise = rng.normal(size=y.shape)
    if colour == "ar":
        noise = signal.lfilter([1.0], [1.0, -0.9], noise, axis=0)
    if colour == "butterworth":
        noise = signal.lfilter(*signal.butter(2, 50.0, fs=300.0), noise, axis=0)
    return IoData(u, y + 0.02 * y.std(axis=0) * noise, dt_s=DT_S)


@pytest.mark.slow
def test_feedback_test___open_loop___p_values_are_those_of_chance() -> None:
    tests = [feedback_test([d], block_gram([d], 20)) for d in map(open_loop, range(60))]
    assert {test.degrees for test in tests} == {20}
    # Uniformly distributed: Kolmogorov and Smirnov see nothing odd.
    assert stats.kstest([test.p_value for test in tests], "uniform").pvalue > 1e-3
    assert not any(test.detected for test in tests)


@pytest.mark.parametrize("colour", ["ar", "butterworth"])
def test_feedback_test___coloured_noise_in_open_loop___is_no_feedback(colour: str) -> None:
    for seed in range(8):
        data = open_loop(seed, colour=colour)
        assert not feedback_test([data], block_gram([data], 40)).detected


def test_feedback_test___statistic___is_that_of_the_explicit_regression() -> None:
    data = open_loop(3, samples=900)
    z = np.hstack([data.y, data.u])
    columns = len(z) - 11
    hankel = np.vstack([z[i : i + columns].T for i in range(12)])
    past, rest = hankel[:45], hankel[45:]
    rest = rest - rest @ np.linalg.pinv(past) @ past
    innovation, following = rest[:4], rest[[4, 9, 14]]
    # The squared canonical correlations are the eigenvalues of the product of projections.
    q_e = np.linalg.qr(innovation.T)[0]
    q_u = np.linalg.qr(following.T)[0]
    expected = (columns - 45) * np.sum(np.linalg.svd(q_e.T @ q_u)[1] ** 2)
    found = feedback_test([data], block_gram([data], 12))
    assert found.statistic == pytest.approx(expected, rel=1e-6)
    assert found.degrees == 12


@pytest.mark.parametrize("seed", range(4))
def test_feedback_test___disturbance_of_the_inputs_period___is_no_feedback(seed: int) -> None:
    # Friction does that: it leaves what no linear model explains, again in each period.
    rng = np.random.default_rng(seed)
    u = np.tile(np.repeat([2.0, -2.0], 100), 40)[:, np.newaxis]
    repeated = np.tile(rng.normal(size=(200, 4)), (40, 1))
    y = step_by_step(arm_model(), u)
    y += 0.02 * y.std(axis=0) * (repeated + rng.normal(size=y.shape))
    data = IoData(u, y, dt_s=DT_S)
    found = feedback_test([data], block_gram([data], 40))
    assert found.p_value < 1e-6
    assert not found.detected


@pytest.mark.parametrize("bag", ["c_dat3_0g", "c_dat3_400g", "quanser_2dsfl"])
def test_feedback_test___recorded_closed_loops___are_found(bag: str) -> None:
    data = preprocess(read_bag(BAGS / bag))
    assert feedback_test([data], block_gram([data], 40)).detected


def test_feedback_test___no_noise___is_undecided() -> None:
    u = square_wave(2000, 1)
    data = IoData(u, step_by_step(arm_model(), u), dt_s=DT_S)
    found = feedback_test([data], block_gram([data], 20))
    assert not found.detected
    assert found.degrees == 0
    assert found.p_value == 1.0


SAMPLES = 2000
LIMIT = 100.0


def multisine(rng: np.random.Generator, lines: int) -> Array:
    frequency_hz = 60.0 * np.arange(1, lines + 1) / lines
    phase = rng.uniform(0.0, 2.0 * np.pi, lines)
    angle = 2.0 * np.pi * np.outer(DT_S * np.arange(SAMPLES), frequency_hz) + phase
    return np.asarray(np.cos(angle).sum(axis=1))


def filtered(rng: np.random.Generator, kind: str, bound_hz: Any) -> Array:  # noqa: ANN401
    b, a = signal.butter(4, bound_hz, kind, fs=1.0 / DT_S)  # type: ignore[call-overload]
    return np.asarray(signal.lfilter(b, a, rng.normal(size=SAMPLES)))


OPEN_LOOP: dict[str, Callable[[np.random.Generator], Array]] = {
    "white noise": lambda rng: rng.normal(size=SAMPLES),
    "noise below 5 Hz": lambda rng: filtered(rng, "low", 5.0),
    "noise above 20 Hz": lambda rng: filtered(rng, "high", 20.0),
    "noise from 20 to 60 Hz": lambda rng: filtered(rng, "band", (20.0, 60.0)),
    "multisine of 10": lambda rng: multisine(rng, 10),
    "multisine of 60": lambda rng: multisine(rng, 60),
    "chirp": lambda _: signal.chirp(DT_S * np.arange(SAMPLES), 0.2, DT_S * SAMPLES, 60.0),
    "held noise": lambda rng: np.repeat(rng.normal(size=SAMPLES // 4), 4),
    "binary noise": lambda rng: np.sign(rng.normal(size=SAMPLES)),
    "square waves": lambda rng: square_wave(SAMPLES, int(rng.integers(1 << 30)))[:, 0],
}


@pytest.mark.parametrize("waveform", OPEN_LOOP)
@pytest.mark.slow
def test_is_closed_loop___no_controller___is_open_for_any_excitation(waveform: str) -> None:
    for seed in range(30 if waveform in {"white noise", "multisine of 60"} else 6):
        rng = np.random.default_rng(seed)
        u = OPEN_LOOP[waveform](rng)[:, np.newaxis]
        model = arm_model() if seed % 2 else random_model(seed, outputs=3, inputs=1)
        y = step_by_step(model, u)
        noise = rng.normal(size=y.shape)
        if seed % 3 == 0:
            noise = signal.lfilter([1.0], [1.0, -0.9], noise, axis=0)
        y += rng.uniform(0.02, 0.2) * y.std(axis=0) * noise + 1.0
        data = IoData(u, y, dt_s=DT_S, outputs=tuple(f"y{i}" for i in range(y.shape[1])))
        assert is_closed_loop(data) is False, f"seed {seed}"


@pytest.mark.parametrize(
    "waveform", ["white noise", "noise above 20 Hz", "binary noise", "held noise"]
)
@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_is_closed_loop___sensor_with_feedthrough___is_no_controller(
    waveform: str, noise: float
) -> None:
    for seed in range(4):
        rng = np.random.default_rng(seed)
        u = OPEN_LOOP[waveform](rng)[:, np.newaxis]
        model = random_model(seed, outputs=2, inputs=1)
        y = step_by_step(model, u)
        y = y / y.std(axis=0) + u / u.std()
        y += noise * rng.normal(size=y.shape)
        data = IoData(u, y, dt_s=DT_S, outputs=("a", "b"))
        assert is_closed_loop(data, feedthrough=True) is False, f"seed {seed}"
        assert is_closed_loop(data) is True, f"seed {seed}"


@pytest.mark.parametrize("dither", [0.0, 0.02])
def test_is_closed_loop___law_at_a_steady_set_point___is_found(dither: float) -> None:
    model = arm_model()
    A, B, C = np.asarray(model.A), np.asarray(model.B)[:, 0], np.asarray(model.C)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        x, u, y = np.zeros(len(A)), np.empty((SAMPLES, 1)), np.empty((SAMPLES, len(C)))
        for k in range(SAMPLES):
            y[k] = C @ x + 0.05 * rng.normal(size=len(C))
            u[k] = 0.4 * (1.0 - y[k, 0]) - y[k, -1] + dither * rng.normal()
            x = A @ x + B * u[k]
        assert is_closed_loop(IoData(u, y, dt_s=DT_S)) is True, f"seed {seed}"


def lqg(model: control.StateSpace, effort: float) -> tuple[Array, Array]:
    """Return state feedback and filter gain from the two Riccati equations."""
    A, B, C = np.asarray(model.A), np.asarray(model.B), np.asarray(model.C)
    X = linalg.solve_discrete_are(A, B, np.eye(len(A)), effort * np.eye(1))
    Y = linalg.solve_discrete_are(A.T, C.T, np.eye(len(A)), np.eye(len(C)))
    K = np.linalg.solve(effort * np.eye(1) + B.T @ X @ B, B.T @ X @ A)
    return K, Y @ C.T @ np.linalg.inv(C @ Y @ C.T + np.eye(len(C)))


def closed_loop(seed: int, law: str, *, noise: float, delay: int = 0, held: int = 1) -> IoData:
    """Return a record of a controller that follows steps."""
    rng = np.random.default_rng(seed)
    model = arm_model() if law == "pd" else random_model(seed, outputs=2, inputs=1)
    A, B, C = np.asarray(model.A), np.asarray(model.B)[:, 0], np.asarray(model.C)
    gain = float(C[0] @ np.linalg.solve(np.eye(len(A)) - 0.999 * A, B))
    circle = np.exp(1j * np.linspace(0.0, np.pi, 400))
    peak = max(abs(C[0] @ np.linalg.solve(z * np.eye(len(A)) - 0.999 * A, B)) for z in circle)
    kp, ki = 0.3 / peak, min(1.0 / abs(gain), 30.0 / peak)
    K, L = lqg(model, 5.0) if law == "lqg" else (np.zeros((1, len(A))), np.zeros((len(A), len(C))))
    x, estimate, sum_, command = np.zeros(len(A)), np.zeros(len(A)), 0.0, 0.0
    waiting = deque([0.0] * delay)
    u, y = np.empty((SAMPLES, 1)), np.empty((SAMPLES, len(C)))
    for k, reference in enumerate(np.repeat(rng.normal(size=SAMPLES // 250), 250)):
        y[k] = C @ x + noise * rng.normal(size=len(C))
        corrected = estimate + L @ (y[k] - C @ estimate)
        sum_ += DT_S * (gain * reference - y[k, 0])
        if k % held == 0:
            command = {
                "pd": 0.4 * (reference - y[k, 0]) - y[k, -1],
                "pi": np.sign(gain) * (kp * (gain * reference - y[k, 0]) + ki * sum_),
                "lqg": reference - float(K[0] @ corrected),
            }[law]
        waiting.append(float(np.clip(command, -LIMIT, LIMIT)))
        u[k] = waiting.popleft()
        x, estimate = A @ x + B * u[k], A @ corrected + B * u[k]
    return IoData(u, y, dt_s=DT_S, outputs=tuple(f"y{i}" for i in range(len(C))))


@pytest.mark.parametrize(("delay", "held"), [(0, 1), (1, 1), (2, 1), (0, 2)])
@pytest.mark.parametrize("law", ["pd", "pi", "lqg"])
@pytest.mark.slow
def test_is_closed_loop___controller___is_found_with_its_delay(
    law: str, delay: int, held: int
) -> None:
    for seed in range(wide(10, 30) if (delay, held) == (0, 1) else 5):
        data = closed_loop(seed, law, noise=0.005, delay=delay, held=held)
        if np.abs(data.u).max() < LIMIT:  # a delay may make a loop unstable
            assert is_closed_loop(data) is True, f"seed {seed}"


def test_is_closed_loop___no_noise___is_undecided() -> None:
    assert is_closed_loop(closed_loop(1, "pd", noise=0.0)) is None


def test_is_closed_loop___two_seconds___is_undecided() -> None:
    assert is_closed_loop(closed_loop(1, "pd", noise=0.005).head(400)) is None


def test_is_closed_loop___one_input_of_two_by_a_controller___is_found() -> None:
    data = closed_loop(1, "pd", noise=0.005)
    other = np.random.default_rng(5).normal(size=(SAMPLES, 1))
    both = IoData(np.hstack([other, data.u]), data.y, dt_s=DT_S, inputs=("u0", "u1"))
    assert is_closed_loop(both) is True


@pytest.mark.parametrize("bag", ["c_dat3_0g", "c_dat3_400g", "quanser_2dsfl"])
def test_is_closed_loop___recorded_closed_loops___are_found(bag: str) -> None:
    assert is_closed_loop(read_bag(BAGS / bag)) is True
