"""Peers of the laws on the thesis's arm: what others would take for it, and the servo.

All know the payload: they are designed on the printed model of it. `lqg by the book` is
python-control's `dlqr` and `dlqe` with weights by Bryson's rule and a static gain on the set-point;
`pd + zv` is the thesis's PD behind the shaper of Singer and Seering (1990). The figures are without
the sensors' noise.
"""

from __future__ import annotations

import time
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import control
import numpy as np

from bench.tools import make_table
from flexarm_control import PdpGains, build_law, margins, nominal_model, step_figures
from flexarm_control.design.regulator_margins import law_loop
from flexarm_control.laws.gains import PdGains
from flexarm_control.laws.law_protocol import Effort
from flexarm_control.servo.controller import Servo
from flexarm_control.servo.job import ServoRequest, Source, design_servo
from flexarm_control.servo.regulator import loop_plant
from flexarm_control.servo.robustness import loop_margin
from flexarm_control.shaping.shaped_law import ShapedLaw
from flexarm_control.shaping.vibrations import nominal_vibrations
from flexarm_daq import RigParameters
from flexarm_ident.friction.dry_friction import DryFriction
from reproduction.framework.rig import RATE_HZ, STEP_S, step_to

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.table import Table

    from flexarm_control.laws.law_protocol import Law

PAYLOADS_KG, SETPOINTS_V = (0.0, 0.2, 0.4), (1.0, 3.0, 5.0)
_LIMIT_V, _SETTLED_S, _CALLS = 10.0, 3.0, 5000
# Bryson's rule: what each output and the input may be; then the noise of each output.
_ALLOWED_V, _NOISE_V = (1.0, 3.0, 3.0, 3.0), (0.005, 0.05, 0.05, 0.02)
_POSITION, _SPEED = 0, 3


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


class BookLqg:
    """LQG of python-control with a static gain on the set-point."""

    def __init__(self, model: control.StateSpace) -> None:
        self.bandwidth_hz = 1.0
        A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
        scaled = C / np.reshape(_ALLOWED_V, (-1, 1))
        gain, *_ = control.dlqr(A, B, scaled.T @ scaled, np.diag([_LIMIT_V**-2.0]))
        noise = np.diag(np.square(_NOISE_V))
        _, spread, _ = control.dlqe(A, B, C, np.eye(1), noise)
        self._A, self._B, self._C, self._gain = A, B, C, np.asarray(gain)
        self._correction = np.linalg.solve(C @ spread @ C.T + noise, C @ spread).T
        at_rest = np.linalg.solve(np.eye(len(A)) - A + B @ self._gain, B)
        self._forward = 1.0 / float((C @ at_rest)[_POSITION, 0])
        corrected = np.eye(len(A)) - self._correction @ C
        moves = A - B @ self._gain
        self.controller = control.StateSpace(
            moves @ corrected,
            moves @ self._correction,
            -self._gain @ corrected,
            -self._gain @ self._correction,
            model.dt,
        )
        self._x = np.zeros(len(A))

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        now = self._x + self._correction @ (np.asarray(volts) - self._C @ self._x)
        wanted = self._forward * reference_v - float((self._gain @ now)[0])
        effort_v = float(np.clip(wanted, -_LIMIT_V, _LIMIT_V))
        self._x = self._A @ now + self._B[:, 0] * effort_v
        return Effort(effort_v, 0.0)

    def reset(self) -> None:
        """Begin at rest."""
        self._x = np.zeros(len(self._A))


class _ServoLaw:
    """Servo as a law of the thesis's arm."""

    def __init__(self, servo: Servo) -> None:
        self._servo = servo
        self.reset = servo.reset

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        return Effort(self._servo.step(volts, [reference_v])[0], 0.0)


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
