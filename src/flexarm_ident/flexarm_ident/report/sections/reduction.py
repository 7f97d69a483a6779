"""Reduction section: cost of each step, and ranks of the modes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import decay, label_and_unit
from flexarm_ident.friction.dry_friction import net_records
from flexarm_ident.models.modes import rank_table
from flexarm_ident.reduction.costs import cost_over_orders, step_costs
from flexarm_ident.report.content.blocks import Heading, Plots, Section, Table, Words
from flexarm_ident.report.content.wording import error_text
from flexarm_ident.report.plots.order_plots import cost_plot

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_ident.models.modes import Mode
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.reduction.costs import StepCost
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_ORDERS_SHOWN = 12
_LOWEST_ORDER = 2
_UPDATES = {"none": "cut", "b": "B refitted", "c": "C refitted"}
_KEPT = "\u2713"


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    if outcome.reduction is None:
        yield Words(
            "The model was not reduced. The ranks say in which order its modes would be kept."
        )
    elif len(outcome.identification.modes) == 1:
        yield Words("The model has one mode alone: there is nothing to reduce.")
    else:
        yield from _costs(outcome, outcome.reduction.order)
    yield Heading("Ranks of the modes")
    yield _ranks(outcome)
    if outcome.reduction is not None:
        yield Words(f"{_KEPT} marks the modes that are kept.")


SECTION = Section(50, "Reduction", _build)


def _costs(outcome: Outcome, order: int) -> Iterator[Block]:
    """Yield the cost of the reduction, step by step."""
    found, request, records = outcome.identification, outcome.request, _judged(outcome)
    known_hz = request.known_modes_hz
    steps = step_costs(found, records, order=order, known_modes_hz=known_hz)
    yield from map(Words, _words(outcome, steps))
    yield _table(outcome, steps)
    yield Words(
        "Cut: only the kept modes, as they are in the full model. B or C refitted: that matrix was "
        "fitted again to the data, (3-11) or (3-19). Errors are of the simulation over the whole "
        "records, driven by the input that moves the linear model. The marked row is the model."
    )
    orders = np.unique(np.linspace(_LOWEST_ORDER, found.order, _ORDERS_SHOWN).round().astype(int))
    wanted = [(request.reduction, request.update), ("mrm", "none"), ("msv", "none")]
    curves = {
        _name(ranking, update): cost_over_orders(
            found, records, orders.tolist(), ranking=ranking, update=update, known_modes_hz=known_hz
        )
        for ranking, update in wanted
    }
    plot = cost_plot(curves, full=steps[0].mean, order=order)
    yield Plots((("Error over the number of states", plot),))


def _ranks(outcome: Outcome) -> Table:
    """Return the modes by either index, side by side (Table 3-1a)."""
    table = rank_table(outcome.modes)
    rows = tuple(
        (str(place), *_place(outcome, one, one.mrm), *_place(outcome, other, other.msv))
        for place, (one, other) in enumerate(zip(table.by_mrm, table.by_msv, strict=True), start=1)
    )
    header = ("Rank", "By MRM: states", "Hz", "MRM", "By MSV: states", "Hz", "MSV")
    return Table("ranks", "Ranks of the modes by MRM and by MSV", header, rows)


def _judged(outcome: Outcome) -> Sequence[IoData]:
    """Return the records with the input that moves the linear model."""
    found = outcome.identification
    if found.friction is None:
        return outcome.records
    return net_records(found.model, found.friction, found.x0, outcome.records)


def _place(outcome: Outcome, mode: Mode, index: float) -> tuple[str, str, str]:
    mark = f" {_KEPT}" if outcome.reduction and mode.kept else ""
    frequency = decay(mode.eigenvalue, outcome.model.dt) or f"{mode.frequency_hz:.3f}"
    return mode.label + mark, frequency, f"{index:.4g}"


def _name(ranking: str | None, update: str) -> str:
    return f"{ranking.upper()}, {_UPDATES[update]}" if ranking else "Full model"


def _table(outcome: Outcome, steps: Sequence[StepCost]) -> Table:
    outputs = [label_and_unit(name)[0] for name in outcome.records[0].outputs]
    following = any(step.sfv is not None for step in steps)
    header = ("Model", "States", *outputs, "Mean δ", "Ratio to full")
    rows = tuple(
        (
            _name(step.ranking, step.update),
            str(step.order),
            *(error_text(float(delta)) for delta in step.errors),
            error_text(step.mean),
            _ratio(step, steps[0]),
            *((_sfv_text(step),) if following else ()),
        )
        for step in steps
    )
    return Table(
        "costs",
        "Errors of the full, the reduced and the updated model",
        (*header, "Mean δ, SFV") if following else header,
        rows,
        tuple(_is_chosen(outcome, step) for step in steps),
    )


def _words(outcome: Outcome, steps: Sequence[StepCost]) -> tuple[str, ...]:
    full = steps[0]
    by_name = {(step.ranking, step.update): step for step in steps}
    asked, update = outcome.request.reduction, outcome.request.update
    cut = by_name[asked, "none"]
    if cut.order == full.order:
        return ("Fewer states would cost more than the allowed loss of fit: all are kept.",)
    line = (
        f"Keeping {cut.order} of {full.order} states by {asked.upper()} takes the mean error from "
        f"{error_text(full.mean)} to {error_text(cut.mean)}"
    )
    if update != "none":
        chosen = by_name[asked, update]
        line += f"; with {update.upper()} refitted it is {error_text(chosen.mean)}"
    lines = [f"{line}."]
    if outcome.friction is not None:
        lines.append(
            "These errors are of the linear model under the net input of the full one. Under "
            "Errors the friction follows from the model's own speeds."
        )
    mrm, msv = by_name["mrm", "none"], by_name["msv", "none"]
    if set(mrm.kept) == set(msv.kept):
        lines.append("MRM and MSV keep the same modes.")
    else:
        better = "MRM" if mrm.mean <= msv.mean else "MSV"
        lines.append(
            f"Of the two rankings, {better} loses less before anything is refitted: "
            f"{error_text(mrm.mean)} by MRM with {mrm.order} states, "
            f"{error_text(msv.mean)} by MSV with {msv.order}."
        )
    return tuple(lines)


def _is_chosen(outcome: Outcome, step: StepCost) -> bool:
    asked = outcome.request
    return (step.ranking, step.update) == (asked.reduction, asked.update)


def _ratio(step: StepCost, full: StepCost) -> str:
    ratio = step.mean / full.mean if full.mean > 0.0 else math.inf
    return f"\u00d7 {ratio:.2f}" if math.isfinite(ratio) else "-"


def _sfv_text(step: StepCost) -> str:
    return "-" if step.sfv is None else error_text(step.sfv)
