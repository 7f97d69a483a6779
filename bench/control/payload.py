"""Benchmark of payload detection and of gains that follow it, on the simulated rig.

Every payload of the grid is stepped to every set-point with several seeds: once with the robust
gains, once with the gains that follow the detected payload. The baseline is the robust gains.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.table import Table

from bench.control.control import THRESHOLDS
from bench.tools import count_option, json_option, run_trials, write_json
from flexarm_bringup.console import terminal
from flexarm_control.design.criteria import step_figures
from flexarm_control.laws.payload import PayloadDetection, PayloadEstimator
from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.laws.pdpc_scheduled import ScheduledPdpc, ScheduleGains
from flexarm_control.simulation import simulate
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, THESIS_NOISE_V

if TYPE_CHECKING:
    from pathlib import Path

RATE_HZ, LENGTH_S, DETECTED_S = 300.0, 4.0, 2.0
PAYLOADS_KG = (0.0, 0.1, 0.2, 0.3, 0.4)
SETPOINTS_V = (1.0, 3.0, 5.0)
NOISE_V = {"low": LOW_NOISE_V, "thesis": THESIS_NOISE_V}
ACCURACY_KG = 0.06


@dataclass(frozen=True)
class Trial:
    """One step with either law; the payload is what was detected after two seconds."""

    payload_kg: float
    setpoint_v: float
    noise: str
    seed: int
    law: str
    settling_s: float
    overshoot: float
    mean_error_v: float
    detected_kg: float | None
    deviation_kg: float


@click.command()
@count_option("--seeds", 4)
@click.option("--noise", type=click.Choice(list(NOISE_V)), default="low", show_default=True)
@json_option
def main(*, seeds: int, noise: str, json_file: Path | None) -> None:
    """Run the trials, print one table, and write them to a file on request."""
    cases = list(product(PAYLOADS_KG, SETPOINTS_V, (noise,), range(seeds), ("fixed", "scheduled")))
    trials = run_trials(trial, cases, chunk=4)
    terminal.show_table(table(trials))
    terminal.show_table(detection(trials))
    write_json(json_file, trials)


def trial(case: tuple[float, float, str, int, str]) -> Trial:
    """Step the arm once."""
    payload_kg, setpoint_v, noise, seed, name = case
    law = (
        ScheduledPdpc(ScheduleGains(), THRESHOLDS, PayloadDetection())
        if name == "scheduled"
        else Pdpc(ScheduleGains().robust, THRESHOLDS)
    )
    estimator = PayloadEstimator(PayloadDetection())
    rig = SimulatedRig(RigParameters(payload_kg=payload_kg, noise_v=NOISE_V[noise]), seed=seed)
    run = simulate(rig, law, np.full(round(LENGTH_S * RATE_HZ), setpoint_v))
    for volts in run.y[run.time_s < DETECTED_S].tolist():
        estimator.step(volts)
    figures = step_figures(run.time_s, run.y[:, 0], setpoint_v)
    estimate = estimator.estimate
    return Trial(
        payload_kg,
        setpoint_v,
        noise,
        seed,
        name,
        min(figures.settling_s, LENGTH_S),
        figures.overshoot,
        figures.mean_error_v,
        estimate.payload_kg if estimate.detected else None,
        estimate.deviation_kg,
    )


def table(trials: list[Trial]) -> Table:
    """Return settling times summed over the payloads, as ratios to the fixed gains."""
    result = Table("set-point", "fixed, s", "scheduled, s", "ratio", "worst overshoot, both")
    means: dict[tuple[str, float], float] = defaultdict(float)
    seeds = len({each.seed for each in trials})
    for each in trials:
        means[each.law, each.setpoint_v] += each.settling_s / seeds
    for setpoint_v in SETPOINTS_V:
        fixed, scheduled = means["fixed", setpoint_v], means["scheduled", setpoint_v]
        worst = {
            law: max(t.overshoot for t in trials if (t.law, t.setpoint_v) == (law, setpoint_v))
            for law in ("fixed", "scheduled")
        }
        result.add_row(
            f"{setpoint_v:g} V",
            f"{fixed:.2f}",
            f"{scheduled:.2f}",
            f"{scheduled / fixed:.3f}",
            f"{worst['fixed']:.1%} {worst['scheduled']:.1%}",
        )
    return result


def detection(trials: list[Trial]) -> Table:
    """Return counts and errors of the payloads that were detected after two seconds."""
    result = Table("payload", "set-point", "detected", f"within {1e3 * ACCURACY_KG:.0f} g", "worst")
    for payload_kg, setpoint_v in product(PAYLOADS_KG, SETPOINTS_V):
        errors_kg = [
            None if each.detected_kg is None else abs(each.detected_kg - payload_kg)
            for each in trials
            if (each.payload_kg, each.setpoint_v, each.law) == (payload_kg, setpoint_v, "fixed")
        ]
        known = [error for error in errors_kg if error is not None]
        result.add_row(
            f"{1e3 * payload_kg:.0f} g",
            f"{setpoint_v:g} V",
            f"{len(known)} of {len(errors_kg)}",
            str(sum(error <= ACCURACY_KG for error in known)),
            f"{1e3 * max(known):.0f} g" if known else "-",
        )
    return result


if __name__ == "__main__":
    main()
