"""Benchmark of modal reduction on simulated records like C_dat3 (0 g) and C_dat11 (300 g).

Each record is made anew by the simulated rig under the experiment's own law and reference, with low
noise, and taken the whole way: a model of the first half whose order is chosen by the code, reduced
to half its states by every ranking as Tables 3-1b to 3-3b do, then to as few states as cost 4 %
with C updated. Errors are those of the data matching validation (DMV) over the whole record, as
ratios to the full model's.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.table import Table

from bench.tools import (
    count_option,
    first_seed_option,
    json_option,
    make_table,
    run_trials,
    write_json,
)
from flexarm_bringup.console import terminal
from flexarm_daq import RigParameters
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V, NO_HUM_V
from flexarm_ident import reduce_model, validate_dmv
from flexarm_ident.models.modes import rank_table
from flexarm_ident.records.preprocess import output_scale
from flexarm_ident.reduction.balanced import balanced_truncation, thesis_realisation
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from reproduction.framework.realisations import realisation_difference
from reproduction.framework.rig import run_experiment

if TYPE_CHECKING:
    from pathlib import Path

EXPERIMENTS = ("C_dat3", "C_dat11")
FLEXIBLE_MODES = 3
TOLERANCE = 0.05
_VIBRATES = 0.3


@dataclass(frozen=True)
class Trial:
    """One record; ratios are mean errors over the full model's, without update unless said."""

    experiment: str
    seed: int
    method: str
    order: int
    mode_errors: tuple[float, ...]
    full_dmv: float
    ranked_by_mrm: tuple[str, ...]
    ranked_by_msv: tuple[str, ...]
    mrm_order: int
    mrm: float
    msv_order: int
    msv: float
    mrmc: float
    balanced: float
    updated_order: int
    updated: float
    realisation_difference: float

    @property
    def modes_found(self) -> bool:
        """Return whether all flexible modes are within 5 %."""
        return max(map(abs, self.mode_errors)) <= TOLERANCE

    @property
    def mrm_wins(self) -> bool:
        """Return whether the modes that MRM keeps match the data better than MSV's."""
        return self.mrm < self.msv

    @property
    def update_holds(self) -> bool:
        """Return whether the updated model is within 5 % of the full one."""
        return self.updated <= 1.0 + TOLERANCE


@click.command()
@count_option("--seeds", 20)
@first_seed_option
@click.option(
    "--order", type=click.IntRange(1), help="States of the full model; chosen if left out."
)
@json_option
def main(*, seeds: int, first_seed: int, order: int | None, json_file: Path | None) -> None:
    """Run the records, print one table, and write them to a file on request."""
    cases = list(product(EXPERIMENTS, range(first_seed, first_seed + seeds), (order,)))
    trials = run_trials(trial, cases)
    terminal.show_table(table(trials))
    terminal.show_table(verdict(trials))
    write_json(json_file, trials)


def trial(case: tuple[str, int, int | None]) -> Trial:
    """Make one record and take it the whole way."""
    name, seed, order = case
    payload_kg = experiment(name).payload_kg
    arm = RigParameters(payload_kg=payload_kg, noise_v=LOW_NOISE_V, hum_v=NO_HUM_V)
    true_hz = natural_frequencies_hz(arm)[:FLEXIBLE_MODES].tolist()
    request = Request(train_fraction=0.5, order=order, reduction="mrm", update="c")
    outcome = run(run_experiment(experiment(name), arm, seed), request)
    found, (whole,), trained = (
        outcome.identification,
        outcome.records,
        outcome.identification.records,
    )
    full_dmv = validate_dmv(found.model, whole).mean
    mrm = reduce_model(found, trained, order=found.order // 2, update="none")
    # A pair more or less decides: MSV gets as many states as MRM took.
    msv = reduce_model(found, trained, ranking="msv", order=mrm.order, update="none")
    mrmc = reduce_model(
        found, trained, ranking="mrmc", order=mrm.order, known_modes_hz=true_hz, update="none"
    )
    balanced = balanced_truncation(found.model, mrm.order, output_scale(trained))
    rebuilt = thesis_realisation(mrm.model, trained)
    vibrating = [mode for mode in found.modes if mode.is_pair and mode.damping_ratio < _VIBRATES]
    vibrating_hz = np.array([mode.frequency_hz for mode in vibrating])
    nearest = [int(np.argmin(np.abs(np.log(vibrating_hz / hz)))) for hz in true_hz]
    ranks = rank_table(found.modes)
    mrm_ratio, msv_ratio, mrmc_ratio, balanced_ratio = (
        validate_dmv(model, whole).mean / full_dmv
        for model in (mrm.model, msv.model, mrmc.model, balanced.model)
    )
    return Trial(
        name,
        seed,
        found.method,
        found.order,
        tuple(float(vibrating_hz[i] / hz - 1.0) for i, hz in zip(nearest, true_hz, strict=True)),
        full_dmv,
        tuple(mode.label for mode in ranks.by_mrm),
        tuple(mode.label for mode in ranks.by_msv),
        mrm.order,
        mrm_ratio,
        msv.order,
        msv_ratio,
        mrmc_ratio,
        balanced_ratio,
        outcome.model.nstates,
        float(outcome.dmv_errors.mean() / outcome.full_dmv_errors.mean()),
        realisation_difference(mrm.model, rebuilt, trained).frequency_response,
    )


def table(trials: list[Trial]) -> Table:
    """Return one line for each record; BT is balanced truncation."""
    title = "DMV of models of half the states over that of the full one"
    modes = [f"f{number} %" for number in range(1, FLEXIBLE_MODES + 1)]
    rankings = ["MRM", "MSV", "MRMC", "BT"]
    heads = ("order", *modes, "full", *rankings, "updated", "states")
    result = make_table("record, seed", *heads, title=title)
    for each in trials:
        result.add_row(
            f"{each.experiment} {each.seed}",
            str(each.order),
            *(f"{100.0 * error:+.1f}" for error in each.mode_errors),
            *(
                f"{figure:.3f}"
                for figure in (
                    each.full_dmv,
                    each.mrm,
                    each.msv,
                    each.mrmc,
                    each.balanced,
                    each.updated,
                )
            ),
            str(each.updated_order),
        )
    return result


def verdict(trials: list[Trial]) -> Table:
    """Return how many records of each experiment agree with the thesis's claims."""
    result = Table("experiment", "modes within 5 %", "MRM beats MSV", "updated within 5 %")
    for name in EXPERIMENTS:
        mine = [each for each in trials if each.experiment == name]
        counts = (
            sum(each.modes_found for each in mine),
            sum(each.mrm_wins for each in mine),
            sum(each.update_holds for each in mine),
        )
        result.add_row(name, *(f"{count} of {len(mine)}" for count in counts))
    return result


if __name__ == "__main__":
    main()
