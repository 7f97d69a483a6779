"""Robustness beyond margins: worst case over payloads, and rigs drawn at random.

The gains are tuned on the printed models and never see a rig. Every payload of the grid is stepped
to every set-point; then rigs are drawn with their parameters off by up to a share each, payload and
set-point at random, and every law steps the same rigs.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import click
import numpy as np

from bench.control.control import THRESHOLDS
from bench.tools import count_option, json_option, make_table, run_trials, write_json
from flexarm_bringup.console import terminal
from flexarm_control import (
    PdpGains,
    margins,
    nominal_model,
    nominal_payloads_kg,
    step_figures,
    tune_pdp,
)
from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.laws.pdpc_plus import PdpcPlus
from flexarm_daq import RigParameters
from reproduction.framework.rig import step_to

if TYPE_CHECKING:
    from pathlib import Path

    from rich.table import Table

    from flexarm_control import Law

GRID_KG, SETPOINTS_V = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5), (1.0, 3.0, 5.0)
LENGTH_S = 6.0
NAMES = ("pdpc", "pdpc_plus")
# What a rebuilt rig, a warm motor or a worn gear changes.
UNSURE = (
    "motor_inertia_kg_m2",
    "load_inertia_kg_m2",
    "motor_gain_nm_per_v",
    "coulomb_friction_nm",
    "viscous_friction_nm_s_per_rad",
    "youngs_modulus_pa",
    "stiffness_damping_s",
    "gear_stiffness_nm_per_rad",
    "gear_damping_nm_s_per_rad",
    "backlash_deg",
    "tacho_gain_v_s_per_rad",
    "middle_gauge_v_per_nm",
    "base_gauge_v_per_nm",
    "tacho_cutoff_hz",
    "loop_delay_s",
)


class Run(NamedTuple):
    """One step; `well` is within 0.05 V of mean error, 10 % of overshoot, settled in 4 s."""

    law: str
    payload_kg: float
    setpoint_v: float
    mean_error_v: float
    overshoot: float
    settling_s: float

    @property
    def well(self) -> bool:
        """Return whether the step keeps these limits."""
        return abs(self.mean_error_v) <= 0.05 and self.overshoot <= 0.1 and self.settling_s <= 4.0  # noqa: PLR2004 - its docstring says them


Case = tuple[str, PdpGains, RigParameters, float, int]


@click.command()
@count_option("--rigs", 100)
@click.option("--spread", type=click.FloatRange(0.0, 0.5), default=0.1, show_default=True)
@json_option
def main(*, rigs: int, spread: float, json_file: Path | None) -> None:
    """Step them all, print the tables, and write the figures to a file on request."""
    models = [nominal_model(payload_kg) for payload_kg in nominal_payloads_kg()]
    tuned = tune_pdp(models).gains
    grid: list[Case] = [
        (name, tuned, RigParameters(payload_kg=payload_kg), setpoint_v, 1)
        for name, payload_kg, setpoint_v in product(NAMES, GRID_KG, SETPOINTS_V)
    ]
    drawn = [random_rig(seed, spread) for seed in range(rigs)]
    random: list[Case] = [
        (name, tuned, rig, setpoint_v, seed)
        for name in NAMES
        for seed, (rig, setpoint_v) in enumerate(drawn)
    ]
    runs = run_trials(step, grid + random, chunk=4)
    on_grid, at_random = runs[: len(grid)], runs[len(grid) :]
    disks = [margins(model, tuned).disk_margin for model in models]
    terminal.CONSOLE.print("disk margins " + ", ".join(f"{disk:.2f}" for disk in disks))
    terminal.show_table(table("worst over the payloads", on_grid))
    terminal.show_table(table(f"{rigs} rigs, parameters off by up to {spread:.0%}", at_random))
    figures = {
        "disk_margins": disks,
        "grid": [each._asdict() for each in on_grid],
        "random": [each._asdict() for each in at_random],
    }
    write_json(json_file, figures)


def random_rig(seed: int, spread: float) -> tuple[RigParameters, float]:
    """Draw a rig and a set-point."""
    random = np.random.default_rng(seed)
    middle = RigParameters()
    factors = random.uniform(1.0 - spread, 1.0 + spread, len(UNSURE)).tolist()
    values = {
        name: factor * getattr(middle, name) for name, factor in zip(UNSURE, factors, strict=True)
    }
    rig = replace(middle, payload_kg=float(random.uniform(0.0, GRID_KG[-1])), **values)
    return rig, float(random.uniform(SETPOINTS_V[0], SETPOINTS_V[-1]))


def step(case: Case) -> Run:
    """Step one rig once."""
    name, tuned, rig, setpoint_v, seed = case
    law: Law = PdpcPlus(tuned) if name == "pdpc_plus" else Pdpc(tuned, THRESHOLDS)
    run = step_to(law, setpoint_v, arm=rig, seed=seed, length_s=LENGTH_S)
    figures = step_figures(run.time_s, run.true_y[:, 0], setpoint_v)
    return Run(
        name,
        rig.payload_kg,
        setpoint_v,
        figures.mean_error_v,
        figures.overshoot,
        min(figures.settling_s, LENGTH_S),
    )


def table(title: str, runs: list[Run]) -> Table:
    """Return the worst figures of each law."""
    result = make_table("law", "|error| V", "overshoot", "settling s", "well", title=title)
    for name in NAMES:
        some = [each for each in runs if each.law == name]
        result.add_row(
            name,
            f"{max(abs(each.mean_error_v) for each in some):.3f}",
            f"{max(each.overshoot for each in some):.1%}",
            f"{max(each.settling_s for each in some):.2f}",
            f"{sum(each.well for each in some)} of {len(some)}",
        )
    return result


if __name__ == "__main__":
    main()
