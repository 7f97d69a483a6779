"""Identification for a page: the model with its files and curves, and its comparison."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_core.computation import serve
from flexarm_ident.answer import request_of
from flexarm_ident.diagnostics.stabilisation import Criteria
from flexarm_ident.estimation.physical_modes import standing_of
from flexarm_ident.importing.csv_columns import TableColumns
from flexarm_ident.importing.csv_layout import is_table
from flexarm_ident.job import identify_bags, read_record
from flexarm_ident.reading.channels import selection
from flexarm_ident.series.comparison import compare_files
from flexarm_ident.workflow.request import Request

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_core.computation import Report
    from flexarm_ident.estimation.physical_modes import JudgedMode
    from flexarm_ident.job import Chosen
    from flexarm_ident.models.modes import Mode
    from flexarm_ident.records.source import Source
    from flexarm_ident.workflow.outcome import Outcome

_POINTS = 4000
_FREQUENCIES = 1000
_INSTANTS = 3000
_SMALLEST = 1e-30


def identified(asked: Mapping[str, Any], report: Report) -> dict[str, Any]:
    """Identify a record, tell what a page shows of it, and write model and report."""
    signals = _signals(asked)
    shown: dict[str, Any] = {}

    def show(name: str, outcome: Outcome) -> None:
        shown.update({"name": name, **curves(outcome), **asked["about"]})
        report("writing", None, shown)

    identify_bags(
        [Path(asked["bag"])],
        Path(asked["folder"]),
        request_of(asked["request"]),
        read=lambda bag, *_: _record(bag, bag.stat().st_mtime_ns, **signals),
        found=show,
        progress=report,
    )
    return shown


def compared(asked: Mapping[str, Any], report: Report) -> dict[str, Any]:
    """Identify a record, and write a page that compares its model with others."""
    bag = Path(asked["bag"])
    compare_files(
        [bag, *map(Path, asked["others"])],
        Path(asked["page"]),
        request_of(asked["request"]),
        channels=_channels(bag, **_signals(asked)),
        progress=report,
    )
    return {}


def _signals(asked: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    return {name: tuple(texts) for name, texts in asked["signals"].items()}


@lru_cache(maxsize=1)
def _record(bag: Path, _written_ns: int, **signals: tuple[str, ...]) -> Source:
    """Return a record, which is read once: another order is asked for again and again."""
    return read_record(bag, Request(), _channels(bag, **signals))


def _channels(
    bag: Path,
    inputs: tuple[str, ...] = (),
    outputs: tuple[str, ...] = (),
    times: tuple[str, ...] = (),
) -> Chosen:
    if is_table(bag):
        return TableColumns(inputs, outputs, times)
    return selection(inputs, outputs) if inputs or outputs else None


def curves(outcome: Outcome) -> dict[str, Any]:
    """Return figures and curves of an identification, thinned to what a screen can show."""
    found, record = outcome.identification, outcome.records[0]
    poles = [pole for pole in found.diagram.poles if pole.admissible]
    return {
        "outputs": list(record.outputs),
        "order": found.order,
        "modes": [
            {
                "frequency_hz": mode.frequency_hz,
                "damping": mode.damping_ratio,
                "kind": kind_of(mode, found.recurring_modes),
            }
            for mode in outcome.modes
            if mode.frequency_hz > 0.0 and mode.eigenvalue.imag > 0.0
        ],
        "dmv": [*outcome.dmv_errors, float(np.mean(outcome.dmv_errors))],
        "verdict": str(outcome.verdict.level),
        "verdict_line": str(outcome.verdict),
        "stabilisation": {
            "orders": list(found.diagram.orders),
            "points": [
                [pole.order, pole.frequency_hz, bool(pole.stable)] for pole in _thin(poles, _POINTS)
            ],
        },
        "spectrum": _spectrum(outcome),
        "fit": {
            "t_s": _thin(record.times_s, _INSTANTS),
            "measured": _thin(record.y_usable, _INSTANTS).T,
            "simulated": _thin(outcome.dmv[0].y, _INSTANTS).T,
        },
        "warnings": list(outcome.warnings),
    }


def kind_of(mode: Mode, judged: Sequence[JudgedMode]) -> str:
    """Return what a mode is by the report's table of the modes that recur over the orders."""
    rare = "rare" if mode.damping_ratio <= Criteria().largest_damping else "damped"
    return standing_of(mode, judged) or rare


def _spectrum(outcome: Outcome) -> dict[str, Any]:
    """Return the power of the measured outputs over the frequency, in dB of the largest of each."""
    spectra = outcome.spectra
    if spectra is None:
        return {"hz": [], "db": []}
    power = _thin(spectra.power, _FREQUENCIES)
    relative = np.maximum(power, _SMALLEST) / np.maximum(power.max(axis=0), _SMALLEST)
    hz = _thin(spectra.frequencies_hz, _FREQUENCIES)
    return {"hz": hz, "db": 10.0 * np.log10(np.maximum(relative, _SMALLEST)).T}


def _thin(values: Any, most: int) -> Any:  # noqa: ANN401 - a list or an array
    """Return at most so many of the values, evenly."""
    return values[:: max(1, -(-len(values) // most))]


if __name__ == "__main__":
    serve(lambda asked, report: (compared if "page" in asked else identified)(asked, report))
