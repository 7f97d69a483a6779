"""Peers of the laws on the thesis's arm: what others would take for it, and the servo.

All know the payload: they are designed on the printed model of it. `lqg by the book` is
python-control's `dlqr` and `dlqe` with weights by Bryson's rule and a static gain on the set-point;
`mpc` has the same weights, an estimated force, and the limits in a quadratic program; `pd + zv` is
the thesis's PD behind the shaper of Singer and Seering (1990). The figures are without the sensors'
noise.
"""

from __future__ import annotations

import time
from importlib.util import find_spec
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import control
import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import csc_matrix

from bench.tools import make_table
from flexarm_control import PdpGains, build_law, margins, nominal_model, step_figures
from flexarm_control.design.regulator_tuning import law_loop
from flexarm_control.laws.gains import PdGains
from flexarm_control.laws.law_protocol import Effort
from flexarm_control.servo.controller import Servo
from flexarm_control.servo.job import ServoRequest, Source, design_servo
from flexarm_control.servo.regulator import loop_plant
from flexarm_control.servo.robustness import loop_margin
from flexarm_control.shaping.shaped_law import ShapedLaw, nominal_vibrations
from flexarm_daq import RigParameters
from flexarm_ident.friction.dry_friction import DryFriction
from reproduction.framework.rig import RATE_HZ, STEP_S, step_to

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from flexarm_control.laws.law_protocol import Law
    from flexarm_core.arrays import FloatArray

PAYLOADS_KG, SETPOINTS_V = (0.0, 0.2, 0.4), (1.0, 3.0, 5.0)
_LIMIT_V, _SETTLED_S, _CALLS = 10.0, 3.0, 5000
# Bryson's rule: what each output and the input may be; then the noise of each output.
_ALLOWED_V, _NOISE_V = (1.0, 3.0, 3.0, 3.0), (0.005, 0.05, 0.05, 0.02)
_POSITION, _SPEED = 0, 3
# Samples for which MPC holds each input of its horizon, and how much the force changes in one.
_HOLDS, _FORCE_V = (1,) * 8 + (2,) * 4 + (4,) * 4 + (8,) * 4, 0.01


class Peer(NamedTuple):
    """A law for a payload, and the disk margin of its loop."""

    law: Law
    disk_margin: float


class PeerStep(NamedTuple):
    """A step with the mean time of a sample's answer."""

    law: str
    payload_kg: float
    setpoint_v: float
    settling_s: float
    mean_error_v: float
    overshoot: float
    residual_gauge_rms_v: float
    effort_rms_v: float
    disk_margin: float
    step_us: float


class _Observer:
    """Kalman filter of python-control with a gain on the state.

    `driven` maps white noise of unit size to the state, (states, sources).
    """

    bandwidth_hz = 1.0

    def __init__(self, model: control.StateSpace, driven: FloatArray, gain: FloatArray) -> None:
        A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
        noise = np.diag(np.square(_NOISE_V))
        _, spread, _ = control.dlqe(A, driven, C, np.eye(driven.shape[1]), noise)
        self._A, self._B, self._C, self._gain = A, B, C, gain
        self._correction = np.linalg.solve(C @ spread @ C.T + noise, C @ spread).T
        corrected = np.eye(len(A)) - self._correction @ C
        moves = A - B @ gain
        self.controller = control.StateSpace(
            moves @ corrected,
            moves @ self._correction,
            -gain @ corrected,
            -gain @ self._correction,
            model.dt,
        )
        self._x = np.zeros(len(A))

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        now = self._x + self._correction @ (np.asarray(volts) - self._C @ self._x)
        effort_v = float(np.clip(self._wanted(now, reference_v), -_LIMIT_V, _LIMIT_V))
        self._x = self._A @ now + self._B[:, 0] * effort_v
        return Effort(effort_v, 0.0)

    def reset(self) -> None:
        """Begin at rest."""
        self._x = np.zeros(len(self._A))

    def _wanted(self, now: FloatArray, reference_v: float) -> float:
        raise NotImplementedError


class BookLqg(_Observer):
    """LQG of python-control with a static gain on the set-point."""

    def __init__(self, model: control.StateSpace) -> None:
        gain, *_ = control.dlqr(model.A, model.B, _cost(model), [[_LIMIT_V**-2.0]])
        super().__init__(model, model.B, np.asarray(gain))
        rest, effort = _at_rest(model.A - model.B @ gain, model.B)
        self._forward = effort / float((model.C @ rest)[_POSITION])

    def _wanted(self, now: FloatArray, reference_v: float) -> float:
        return self._forward * reference_v - float((self._gain @ now)[0])


class Mpc(_Observer):
    """MPC with a force at the input that is estimated: a quadratic program a sample, by OSQP.

    It has the weights of `BookLqg`, and that one's cost beyond its horizon.
    """

    def __init__(self, model: control.StateSpace) -> None:
        import osqp  # noqa: PLC0415 - optional

        order, count, horizon = model.nstates, len(_HOLDS), sum(_HOLDS)
        A, B, cost = np.asarray(model.A), np.asarray(model.B), _cost(model)
        _, beyond, _ = control.dlqr(A, B, cost, [[_LIMIT_V**-2.0]])
        powers = [np.eye(order)]
        for _ in range(horizon):
            powers.append(A @ powers[-1])
        free = np.vstack(powers[1:])
        answers = (free @ np.linalg.solve(A, B)).reshape(horizon, order)
        forced = np.zeros((horizon, order, horizon))
        for column in range(horizon):
            forced[column:, :, column] = answers[: horizon - column]
        forced = forced.reshape(-1, horizon) @ np.repeat(np.eye(count), _HOLDS, axis=0)
        weight = block_diag(*[cost] * (horizon - 1), np.asarray(beyond))
        hessian = forced.T @ weight @ forced + np.diag(_HOLDS) * _LIMIT_V**-2.0
        self._linear = forced.T @ weight @ free
        gain = np.linalg.solve(hessian, self._linear)[:1]
        self._program = osqp.OSQP()
        ends = np.full(len(_HOLDS), _LIMIT_V)
        self._program.setup(
            P=csc_matrix(np.triu(hessian)),
            q=np.zeros(count),
            A=csc_matrix(np.eye(count)),
            l=-ends,
            u=ends,
            verbose=False,
            eps_abs=1e-4,
            eps_rel=1e-4,
        )
        rest, effort = _at_rest(A, B)
        size = float((model.C @ rest)[_POSITION])
        self._rest, self._effort = rest / size, effort / size
        with_force = control.StateSpace(
            np.block([[A, B], [np.zeros((1, order)), np.eye(1)]]),
            np.vstack([B, [[0.0]]]),
            np.hstack([model.C, np.zeros((len(model.C), 1))]),
            0.0,
            model.dt,
        )
        driven = block_diag(B, [[_FORCE_V]])
        super().__init__(with_force, driven, np.append(gain, [[1.0]], axis=1))

    def _wanted(self, now: FloatArray, reference_v: float) -> float:
        rest_v = self._effort * reference_v - float(now[-1])
        ends = np.full(len(_HOLDS), _LIMIT_V)
        start = self._linear @ (now[:-1] - self._rest * reference_v)
        self._program.update(q=start, l=-ends - rest_v, u=ends - rest_v)
        return float(self._program.solve().x[0]) + rest_v


def _cost(model: control.StateSpace) -> FloatArray:
    scaled = np.asarray(model.C) / np.reshape(_ALLOWED_V, (-1, 1))
    return np.asarray(scaled.T @ scaled)


def _at_rest(A: FloatArray, B: FloatArray) -> tuple[FloatArray, float]:
    """Return a state at rest, of any size, and the input that keeps it."""
    found = np.linalg.svd(np.hstack([A - np.eye(len(A)), B]))[2][-1]
    return found[:-1], float(found[-1])


class _ServoLaw:
    """Servo as a law of the thesis's arm."""

    def __init__(self, servo: Servo) -> None:
        self._servo = servo
        self.reset = servo.reset

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        return Effort(self._servo.step(volts, [reference_v])[0], 0.0)


def has_osqp() -> bool:
    """Return whether the solver of `Mpc` is installed."""
    return find_spec("osqp") is not None


def peers(payload_kg: float) -> dict[str, Peer]:
    """Return the laws for a payload by name."""
    model = nominal_model(payload_kg)
    book = BookLqg(model)
    pd = PdGains()
    shaped = ShapedLaw(
        build_law("pd"), "zv", nominal_vibrations(), rate_hz=RATE_HZ, payload_kg=payload_kg
    )
    rig, unknown = RigParameters(), np.zeros(1)
    level = np.array([rig.coulomb_friction_nm / rig.motor_gain_nm_per_v])
    friction = DryFriction(level, unknown, unknown, unknown, np.asarray(model.C[[_SPEED]]))
    position, force = model.output_labels[_POSITION], model.input_labels[0]
    request = ServoRequest((position,), {force: _LIMIT_V})
    design = design_servo([Source("printed", model, friction)], request)
    held = loop_margin(design.choice.regulator, loop_plant(model)).disk
    found = {
        "lqg by the book": Peer(book, _margin_of(book, model)),
        "pd + zv": Peer(shaped, margins(model, PdpGains(pd.kp, pd.kd, 0.0)).disk_margin),
        "pdpc": Peer(build_law("pdpc"), _packaged("pdpc", model)),
        "ilqr": Peer(build_law("ilqr"), _packaged("ilqr", model)),
    }
    if has_osqp():
        mpc = Mpc(model)
        found["mpc"] = Peer(mpc, _margin_of(mpc, model))
    return {**found, "servo": Peer(_ServoLaw(Servo(design.gains)), float(held))}


def peer_steps() -> list[PeerStep]:
    """Step all peers on the thesis's simulated arm."""
    found = []
    for payload_kg in PAYLOADS_KG:
        for (name, peer), setpoint_v in product(peers(payload_kg).items(), SETPOINTS_V):
            arm = RigParameters(payload_kg=payload_kg)
            peer.law.reset()
            run = step_to(peer.law, setpoint_v, arm=arm, seed=0)
            figures = step_figures(run.time_s, run.true_y[:, _POSITION], setpoint_v)
            late = run.time_s >= _SETTLED_S
            found.append(
                PeerStep(
                    name,
                    payload_kg,
                    setpoint_v,
                    min(figures.settling_s, STEP_S),
                    figures.mean_error_v,
                    figures.overshoot,
                    float(np.sqrt(np.mean(run.true_y[late, 1] ** 2))),
                    float(np.sqrt(np.mean(run.command_v**2))),
                    peer.disk_margin,
                    _step_us(peer.law),
                )
            )
    return found


def peer_table(steps: Sequence[PeerStep]) -> Table:
    """Return the figures of each peer: means over the steps, and the worst where that is said."""
    heads = ("settling s, mean, worst", "error V, worst", "overshoot, worst", "gauge V", "effort V")
    table = make_table("law", *heads, "disk margin, least", "us")
    for name in dict.fromkeys(each.law for each in steps):
        some = [each for each in steps if each.law == name]
        settling = [each.settling_s for each in some]
        table.add_row(
            name,
            f"{np.mean(settling):.2f} {max(settling):.2f}",
            f"{max(abs(each.mean_error_v) for each in some):.3f}",
            f"{100.0 * max(each.overshoot for each in some):.1f} %",
            f"{np.mean([each.residual_gauge_rms_v for each in some]):.4f}",
            f"{np.mean([each.effort_rms_v for each in some]):.2f}",
            f"{min(each.disk_margin for each in some):.2f}",
            f"{min(each.step_us for each in some):.1f}",
        )
    return table


def _margin_of(law: Any, model: control.StateSpace) -> float:  # noqa: ANN401 - of a linear controller
    return float(loop_margin(law, loop_plant(model)).disk)


def _packaged(law: str, model: control.StateSpace) -> float:
    found = law_loop(law, model)
    if found is None:
        raise ValueError(f"{law} has no loop of its own")
    return found.margins().disk_margin


def _step_us(law: Law) -> float:
    """Return the microseconds of a sample."""
    volts = [0.9, 0.1, -0.1, 0.2]
    law.reset()
    start_s = time.perf_counter()
    for _ in range(_CALLS):
        law.step(volts, 1.0)
    return 1e6 * (time.perf_counter() - start_s) / _CALLS
