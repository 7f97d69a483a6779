"""Benchmark of the control laws: trials on the simulated rig, cost of a step, time to tune.

The gauge is measured as the acceptance lines ask and also without sensor noise: the noise of the
base gauge, 0.05 V, hides most of what is left of the vibration.

The gains are tuned on the printed models. The thresholds of (4-8) are tuned to the noise: the
thesis's 0.05 V of error is the whole 5 % of a step of 1 V, and its 0.05 V of speed is passed by the
noise of the tachometer, 0.02 V, three times a second. `pdpc_thesis` has the thesis's own.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import click
import numpy as np
from rich.table import Table
from scipy.optimize import NonlinearConstraint, minimize
from scipy.signal import dlsim

from bench.control.peers import has_osqp, peer_steps, peer_table
from bench.tools import count_option, json_option, run_trials, write_json
from flexarm_bringup.console import terminal
from flexarm_control import (
    LAWS,
    PdpGains,
    build_law,
    nominal_model,
    nominal_payloads_kg,
    step_figures,
    tune_pdp,
)
from flexarm_control.design.criteria import position_itae, strain_itae
from flexarm_control.design.margins import LoopResponse
from flexarm_control.design.tuning import PDP_BOUNDS, PDP_STARTS
from flexarm_control.laws.gains import CompensationLevel, TunedCompensation
from flexarm_control.laws.pdpc import Pdp, Pdpc
from flexarm_control.laws.pdpc_plus import PdpcPlus
from flexarm_control.models.arm_model import BASE_STRAIN, MIDDLE_STRAIN, POSITION
from flexarm_daq import RigParameters
from reproduction.framework.rig import step_to

if TYPE_CHECKING:
    from pathlib import Path

    import control

    from flexarm_control import Law

LENGTH_S, SETTLED_S, RESIDUAL_FROM_S = 10.0, 3.0, 8.0
CASES = ((0.0, 1.0), (0.2, 3.0), (0.3, 4.0), (0.4, 5.0))
THRESHOLDS = TunedCompensation()
ILQR_PAYLOAD_KG, ILQR_LENGTH_S, ILQR_LATE_S = 0.3, 20.0, 10.0
_STEPS = 20_000
# Acceptance lines, as the table words them.
_ERROR_V, _WITHOUT_V, _OVERSHOOT = 0.05, 0.5, 0.06
_LOADED_S, _EMPTY_S = 2.0, 3.5
_CALMER = 0.7
_HUNTING_FROM_V, _HUNTING_OVERSHOOT, _HUNTING_V = 4.0, 0.08, 0.2
_GAUGES = {
    "residual_gauge_rms_v": "8-10 s",
    "true_gauge_rms_v": "8-10 s (no noise)",
    "settled_true_gauge_rms_v": "3-10 s (no noise)",
}


@dataclass(frozen=True)
class Trial:
    """One step; `true` figures are without sensor noise.

    The gauge is that at the base: `residual` over 8 to 10 s, `settled` over 3 to 10 s.
    """

    law: str
    payload_kg: float
    setpoint_v: float
    seed: int
    mean_error_v: float
    overshoot: float
    settling_s: float
    true_settling_s: float
    residual_gauge_rms_v: float
    true_gauge_rms_v: float
    settled_true_gauge_rms_v: float


class IlqrTrial(NamedTuple):
    """A step at 300 g under ILQR; the swing is peak to peak over 10 to 20 s."""

    setpoint_v: float
    seed: int
    overshoot: float
    swing_v: float


def laws(tuned: PdpGains) -> dict[str, Law]:
    """Return the laws under trial by name."""
    return {
        "pdp": Pdp(tuned),
        "pdpc": Pdpc(tuned, THRESHOLDS),
        "pdpc_thesis": Pdpc(),
        "pdpc_unconditional": Pdpc(tuned, CompensationLevel()),
        "pdpc_plus": PdpcPlus(tuned),
        "lqg": build_law("lqg"),
    }


@click.command()
@count_option("--seeds", 20)
@click.option("--peers", is_flag=True, help="Only what others would take, beside the servo.")
@json_option
def main(*, seeds: int, peers: bool, json_file: Path | None) -> None:
    """Run the trials, print the tables, and write the figures to a file on request."""
    if peers:
        steps = peer_steps()
        terminal.show_table(peer_table(steps))
        if not has_osqp():
            terminal.note(
                "without mpc: ./flexarm exec python -m pip install -r requirements/mpc.in"
            )
        write_json(json_file, [each._asdict() for each in steps])
        return
    models = [nominal_model(payload_kg) for payload_kg in nominal_payloads_kg()]
    start_s = time.perf_counter()
    tuned = tune_pdp(models).gains
    tuning_s = time.perf_counter() - start_s
    start_s = time.perf_counter()
    tune_pdp(models, starts=PDP_STARTS[:1])
    one_start_s = time.perf_counter() - start_s
    naive_s = naive_tuning_s(models)
    step_us = {name: step_cost_us(build_law(name)) for name in LAWS}
    cases = [
        (name, tuned, *case) for name, case in product(laws(tuned), product(CASES, range(seeds)))
    ]
    trials = run_trials(trial, cases, chunk=4)
    ilqr = run_trials(ilqr_trial, list(product((3.0, 5.0), range(seeds))))
    terminal.CONSOLE.print(f"tuned gains kp {tuned.kp:.4f}, kd {tuned.kd:.4f}, ksg {tuned.ksg:.4f}")
    terminal.CONSOLE.print(
        f"tuning {tuning_s:.2f} s from three starts; {one_start_s:.2f} s from one, "
        f"{naive_s:.2f} s with scipy's dlsim"
    )
    terminal.show_table(costs(step_us))
    terminal.show_table(table(trials))
    terminal.show_table(lines(trials, ilqr))
    figures = {
        "step_us": step_us,
        "tuning_s": tuning_s,
        "one_start_s": one_start_s,
        "naive_one_start_s": naive_s,
        "gains": tuned,
        "trials": trials,
        "ilqr": [each._asdict() for each in ilqr],
    }
    write_json(json_file, figures)


def trial(case: tuple[str, PdpGains, tuple[float, float], int]) -> Trial:
    """Step the arm once."""
    name, tuned, (payload_kg, setpoint_v), seed = case
    law = laws(tuned)[name]
    run = step_to(
        law, setpoint_v, arm=RigParameters(payload_kg=payload_kg), seed=seed, length_s=LENGTH_S
    )
    time_s, measured_v, true_v = run.time_s, run.y, run.true_y
    figures = step_figures(time_s, measured_v[:, 0], setpoint_v)
    late = time_s >= RESIDUAL_FROM_S
    return Trial(
        name,
        payload_kg,
        setpoint_v,
        seed,
        figures.mean_error_v,
        figures.overshoot,
        min(figures.settling_s, LENGTH_S),
        min(step_figures(time_s, true_v[:, 0], setpoint_v).settling_s, LENGTH_S),
        float(np.sqrt(np.mean(measured_v[late, 1] ** 2))),
        float(np.sqrt(np.mean(true_v[late, 1] ** 2))),
        float(np.sqrt(np.mean(true_v[time_s >= SETTLED_S, 1] ** 2))),
    )


def ilqr_trial(case: tuple[float, int]) -> IlqrTrial:
    """Step the arm with 300 g once."""
    setpoint_v, seed = case
    rig = RigParameters(payload_kg=ILQR_PAYLOAD_KG)
    run = step_to(build_law("ilqr"), setpoint_v, arm=rig, seed=seed, length_s=ILQR_LENGTH_S)
    position_v = run.y[:, 0]
    return IlqrTrial(
        setpoint_v,
        seed,
        step_figures(run.time_s, position_v, setpoint_v).overshoot,
        float(np.ptp(position_v[run.time_s >= ILQR_LATE_S])),
    )


def step_cost_us(law: Law) -> float:
    """Return the microseconds of one step, best of three."""
    volts, took_s = [0.9, 0.1, -0.1, 0.2], []
    for _ in range(3):
        start_s = time.perf_counter()
        for _ in range(_STEPS):
            law.step(volts, 1.0)
        took_s.append(time.perf_counter() - start_s)
    return 1e6 * min(took_s) / _STEPS


def naive_tuning_s(models: list[control.StateSpace]) -> float:
    """Return the seconds from one start with scipy's dlsim; the margins are found as in ours."""
    loops = [LoopResponse(model) for model in models]

    def criterion(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
        kp, kd, ksg = values.tolist()
        total = 0.0
        for model in models:
            A, B, C = (np.asarray(matrix) for matrix in (model.A, model.B, model.C))
            closed = A - B @ (np.array([[kp, 0.0, ksg, kd]]) @ C)
            _, y, _ = dlsim((closed, kp * B, C, np.zeros((4, 1)), model.dt), np.ones(1500))
            total += position_itae(y[:, POSITION], 1.0, dt_s=model.dt)
            total += strain_itae(y[:, BASE_STRAIN], y[:, MIDDLE_STRAIN], dt_s=model.dt)
        return 0.5 * total

    def excess(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[float]:
        found = [loop.margins(PdpGains(*values)) for loop in loops]
        return [
            *(min(each.gain_margin_db, 60.0) - 10.0 for each in found),
            *(each.phase_margin_deg - 55.0 for each in found),
        ]

    start = PDP_STARTS[0]
    start_s = time.perf_counter()
    minimize(
        criterion,
        [start.kp, start.kd, start.ksg],
        method="SLSQP",
        bounds=PDP_BOUNDS,
        constraints=NonlinearConstraint(excess, 0.0, np.inf),
    )
    return time.perf_counter() - start_s


def costs(step_us: dict[str, float]) -> Table:
    """Return microseconds of one step of every law."""
    result = Table("law", "step, us")
    for name, cost_us in step_us.items():
        result.add_row(name, f"{cost_us:.2f}")
    return result


def table(trials: list[Trial]) -> Table:
    """Return the worst figures per law and case; the gauge as a mean over the seeds."""
    result = Table("law", "case", "|error|", "overshoot", "settling, true", "gauge, true, 3-10 s")
    names = dict.fromkeys(each.law for each in trials)
    for name, (payload_kg, setpoint_v) in product(names, CASES):
        some = _of(trials, name, payload_kg)
        result.add_row(
            name,
            f"{1e3 * payload_kg:.0f} g {setpoint_v:g} V",
            f"{max(abs(t.mean_error_v) for t in some):.3f}",
            f"{max(t.overshoot for t in some):.1%}",
            f"{max(t.settling_s for t in some):.2f} {max(t.true_settling_s for t in some):.2f}",
            " ".join(f"{_rms(some, kind):.4f}" for kind in _GAUGES),
        )
    return result


def lines(trials: list[Trial], ilqr: list[IlqrTrial]) -> Table:
    """Return the figures beside the acceptance lines."""
    result = Table("line", "figure", "holds")

    def add(line: str, figure: float, *, holds: bool) -> None:
        result.add_row(line, f"{figure:.3f}", "yes" if holds else "NO")

    for name in ("pdpc", "pdpc_thesis", "pdpc_plus"):
        some = [t for t in trials if t.law == name]
        error_v = max(abs(t.mean_error_v) for t in some)
        add(f"{name}: |mean error| <= 0.05 V", error_v, holds=error_v <= _ERROR_V)
        overshoot = max(t.overshoot for t in some)
        add(f"{name}: overshoot <= 6 %", overshoot, holds=overshoot <= _OVERSHOOT)
        for words, kind in (("", "settling_s"), (" (no noise)", "true_settling_s")):
            loaded = max(getattr(t, kind) for t in some if t.payload_kg > 0.0)
            add(f"{name}: settling{words}, loaded <= 2 s", loaded, holds=loaded <= _LOADED_S)
            empty = max(getattr(t, kind) for t in some if t.payload_kg == 0.0)
            add(f"{name}: settling{words}, 0 g <= 3.5 s", empty, holds=empty <= _EMPTY_S)
    for payload_kg in (0.0, 0.2):
        least_v = min(abs(t.mean_error_v) for t in _of(trials, "pdp", payload_kg))
        add(f"pdp: error >= 0.5 V at {payload_kg:g} kg", least_v, holds=least_v >= _WITHOUT_V)
    for (payload_kg, least), (kind, words) in product(
        ((0.0, 2.0), (0.2, 2.0), (0.4, 1.5)), list(_GAUGES.items())[:2]
    ):
        ratio = _rms(_of(trials, "pdpc_unconditional", payload_kg), kind) / _rms(
            _of(trials, "pdpc", payload_kg), kind
        )
        line = f"gauge {words}, unconditional / conditional >= {least:g} at {payload_kg:g} kg"
        add(line, ratio, holds=ratio >= least)
    for kind, words in _GAUGES.items():
        calm, plain = (
            _rms([t for t in trials if t.law == name], kind) for name in ("pdpc_plus", "pdpc")
        )
        line = f"gauge {words}, pdpc_plus / pdpc <= {_CALMER:g}"
        add(line, calm / plain, holds=calm <= _CALMER * plain)
    calm_v, plain_v = (
        max(abs(t.mean_error_v) for t in trials if t.law == name) for name in ("pdpc_plus", "pdpc")
    )
    add("|mean error|, pdpc_plus / pdpc <= 1", calm_v / plain_v, holds=calm_v <= plain_v)
    held = [each for each in ilqr if each.setpoint_v < _HUNTING_FROM_V]
    hunting = [each for each in ilqr if each.setpoint_v >= _HUNTING_FROM_V]
    most, swing_v = max(t.overshoot for t in held), max(t.swing_v for t in held)
    add("ilqr, 3 V: overshoot <= 6 %", most, holds=most <= _OVERSHOOT)
    add("ilqr, 3 V: peak to peak over 10-20 s <= 0.05 V", swing_v, holds=swing_v <= _ERROR_V)
    least, swing_v = min(t.overshoot for t in hunting), min(t.swing_v for t in hunting)
    add("ilqr, 5 V: overshoot >= 8 %", least, holds=least >= _HUNTING_OVERSHOOT)
    add("ilqr, 5 V: peak to peak over 10-20 s >= 0.2 V", swing_v, holds=swing_v >= _HUNTING_V)
    return result


def _of(trials: list[Trial], name: str, payload_kg: float) -> list[Trial]:
    return [t for t in trials if (t.law, t.payload_kg) == (name, payload_kg)]


def _rms(trials: list[Trial], kind: str) -> float:
    return float(np.mean([getattr(t, kind) for t in trials]))


if __name__ == "__main__":
    main()
