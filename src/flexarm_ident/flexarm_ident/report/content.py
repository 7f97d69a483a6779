"""What a report says of an identification: its sentences and tables."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.workflow.workflow import Outcome

_LIGHT_DAMPING = 0.2
_LARGE = 1e3

_RANKINGS = {
    "mrm": "largest modal response (MRM)",
    "msv": "largest mode singular value (MSV)",
    "mrmc": "known flexible modes first, then largest modal response (MRMC)",
}
_UPDATES = {"none": "nothing was refitted", "b": "B was refitted", "c": "C was refitted"}


@dataclass(frozen=True)
class Table:
    """Cells of a table as text; the first column names the row.

    Attributes
    ----------
    header : tuple of str
        Column titles.
    rows : tuple of tuple of str
        Cells.
    marked : tuple of bool
        Rows that stand out; empty when none does.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    marked: tuple[bool, ...] = ()


def summary(outcome: Outcome) -> list[str]:
    """Return the outcome in a few sentences."""
    records, model = outcome.records, outcome.model
    seconds = sum(outcome.samples) * records[0].dt_s
    full = outcome.identification.order
    origin = f", reduced from {full}" if model.nstates < full else ""
    error = _percent(float(outcome.dmv_errors.mean()))
    friction = " and dry friction at its inputs" if outcome.friction else ""
    lines = [
        f"The model has {model.nstates} states{origin}{friction}.",
        f"It comes from {_count(len(records), 'record')} of {seconds:.1f} s in all.",
        f"Driven by the measured input alone, it misses the outputs by {error} on average.",
    ]
    if outcome.sfv is not None:
        lines.append(
            "Under the experiment's own control law, it misses them by "
            f"{_percent(outcome.sfv.mean)} on average."
        )
    light = [
        f"{mode.frequency_hz:.2f} Hz"
        for mode in sorted(outcome.modes, key=lambda mode: mode.frequency_hz)
        if mode.kept and mode.is_pair and mode.damping_ratio < _LIGHT_DAMPING
    ]
    lines.append(
        f"It vibrates at {_listed(light)} (damping ratio below {_LIGHT_DAMPING})."
        if light
        else f"It has no vibration with a damping ratio below {_LIGHT_DAMPING}."
    )
    return lines


def order_words(outcome: Outcome) -> list[str]:
    """Return why the full model has its order."""
    identification = outcome.identification
    how = "as asked for" if outcome.request.order else "chosen by its fit"
    if identification.friction is not None:
        how = "that of an arm's equations of motion; what follows is of its subspace start"
    stable = _ranges(identification.stable_orders)
    return [
        f"The full model has order {identification.order}, {how}.",
        f"The widest gap of the singular values is after number {identification.suggested_order}.",
        f"Models of these orders are stable as identified: {stable}."
        if stable
        else "No order gives a model that is stable as identified.",
    ]


def cluster_table(outcome: Outcome) -> Table | None:
    """Return the modes that come back over the orders, with their scatter; None without any."""
    rows = tuple(
        (
            f"{mode.frequency_hz:.3f}{_plus_minus(mode.frequency_std_hz)}",
            f"{mode.damping_ratio:.3f}{_plus_minus(mode.damping_std)}",
            f"{mode.count} ({100.0 * mode.share:.0f} %)",
            _ranges(sorted(mode.orders)),
        )
        for mode in outcome.identification.diagram.modes
    )
    header = ("Frequency, Hz", "Damping", "Found at", "Orders")
    return Table(header, rows) if rows else None


def mode_table(outcome: Outcome) -> Table:
    """Return the modes of the full model, as Tables 3-1a to 3-3a."""
    header = ("States", "Frequency, Hz", "Damping", "MSV (rank)", "MRM (rank)", "Kept")
    deviations = outcome.identification.mode_uncertainty or [None] * len(outcome.modes)
    rows = tuple(
        (
            mode.label,
            f"{mode.frequency_hz:.3f}{_plus_minus(deviation and deviation.frequency_std_hz)}"
            if mode.frequency_hz
            else "-",
            f"{mode.damping_ratio:.3f}{_plus_minus(deviation and deviation.damping_std)}",
            f"{_index(mode.msv)} ({mode.msv_rank})",
            f"{_index(mode.mrm)} ({mode.mrm_rank})",
            "yes" if mode.kept else "no",
        )
        for mode, deviation in zip(outcome.modes, deviations, strict=True)
    )
    cut = not all(mode.kept for mode in outcome.modes)
    marked = tuple(mode.kept for mode in outcome.modes) if cut else ()
    return Table(header, rows, marked)


def mode_scatter_words(outcome: Outcome) -> str:
    """Return where the deviations of the modes are from, or why there are none."""
    found = outcome.identification
    if found.mode_uncertainty:
        return "± is the standard deviation, from leaving out one tenth of the data at a time."
    if found.friction is not None:
        return (
            "There is no standard deviation: an arm with dry friction is fitted by simulation, "
            "which is not done again for parts of the data."
        )
    if found.samples != tuple(len(record) for record in found.records):
        return "There is no standard deviation: the data were fitted in pieces."
    return "There is no standard deviation: the data are too short to leave out parts of them."


def error_table(outcome: Outcome) -> Table:
    """Return the errors (2-25) of each output and their mean, as Tables 3-1b to 3-3b."""
    columns: list[tuple[str, FloatArray]] = []
    if outcome.reduction:
        columns.append(("Full, DMV", outcome.full_dmv_errors))
    name = "Reduced" if outcome.reduction else "Full"
    columns.append((f"{name}, DMV", outcome.dmv_errors))
    if outcome.sfv is not None:
        columns.append((f"{name}, SFV", outcome.sfv.delta))
    rows = [
        (label_and_unit(output)[0], *(error_text(delta[i]) for _, delta in columns))
        for i, output in enumerate(outcome.records[0].outputs)
    ]
    rows.append(("mean", *(error_text(float(delta.mean())) for _, delta in columns)))
    header = ("Output", *(title for title, _ in columns))
    return Table(header, tuple(rows), (*(False for _ in rows[1:]), True))


def model_facts(outcome: Outcome) -> dict[str, str]:
    """Return how the model was made."""
    identification = outcome.identification
    facts = {
        "method": identification.title,
        "block rows": str(identification.block_rows),
        "full order": str(identification.order),
        "sampling period": f"{outcome.model.dt:.6g} s",
        "eigenvalues moved inside the circle": str(identification.moved_eigenvalues),
    }
    if identification.choice:
        facts["why this method"] = identification.choice
    if identification.start_error is not None:
        facts["fitted by simulation"] = (
            f"mean δ of the fitted part {error_text(float(identification.fit_error.mean()))}, "
            f"of the subspace model before {error_text(float(identification.start_error.mean()))}"
        )
    if outcome.reduction:
        facts["reduction"] = (
            f"{_RANKINGS[outcome.request.reduction]}; {_UPDATES[outcome.request.update]}"
        )
        facts["kept states"] = ", ".join(outcome.reduction.kept)
    return facts


def short_labels(records: Sequence[IoData]) -> dict[str, str]:
    """Return the labels of records without the remarks in brackets that bags add to them."""
    labels = [record.label for record in records]
    short = [label.partition(" (")[0] for label in labels]
    return dict(zip(labels, short if len(set(short)) == len(set(labels)) else labels, strict=True))


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")


def _percent(error: float) -> str:
    return f"{100.0 * error:.1f} %" if math.isfinite(error) else "more than can be told"


def _index(value: float) -> str:
    return f"{value:.3f}" if value < _LARGE else f"{value:.1e}"


def error_text(delta: float) -> str:
    """Return an error (2-25) with four decimals."""
    return f"{delta:.4f}" if math.isfinite(delta) else "∞"


def _listed(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))


def _ranges(numbers: Iterable[int]) -> str:
    """Return numbers with runs drawn together: ``7 to 12, 14``."""
    runs = (
        [number for _, number in run]
        for _, run in groupby(enumerate(numbers), key=lambda pair: pair[1] - pair[0])
    )
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)


def _plus_minus(deviation: float | None) -> str:
    return "" if deviation is None else f" \u00b1 {deviation:.3f}"
