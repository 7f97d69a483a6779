"""Verbs that work on files alone: import, identify, repair."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory

from flexarm_bringup import terminal
from flexarm_daq import repair
from flexarm_daq.csv_import import import_csv
from flexarm_daq.csv_map import load_csv_map
from flexarm_daq.definitions import load_typestore
from flexarm_ident import workflow
from flexarm_ident.bags import read_bag_report
from flexarm_ident.results import write_results


def import_measurements(csv: Path, map_file: Path, bag: Path) -> str:
    """Turn a CSV file into a bag and say what came of it."""
    share = Path(get_package_share_directory("flexarm_msgs"))
    summary = import_csv(
        csv, load_csv_map(map_file), bag, typestore=load_typestore({"flexarm_msgs": share})
    )
    return (
        f"{summary.bag}: {summary.samples} samples at {summary.rate_hz:g} Hz, "
        f"{summary.duration_s:.2f} s"
    )


def identify_bags(bags: tuple[Path, ...], out: Path, **request: Any) -> None:  # noqa: ANN401
    """Identify from bags, show modes and errors, write the results."""
    readings = [read_bag_report(bag) for bag in bags]
    with terminal.progress_bar("identifying", 100) as progress:
        outcome = workflow.run(
            [reading.data for reading in readings],
            workflow.Request(**request),
            progress=lambda _, fraction: progress(round(100 * fraction)),
        )
    write_results(out, outcome)
    outputs = outcome.records[0].outputs
    rows = [("data (DMV)", [*outcome.dmv_errors, outcome.dmv_errors.mean()])]
    if outcome.sfv is not None:
        rows.append(("set-point (SFV)", [*outcome.sfv.delta, outcome.sfv.mean]))
    console = terminal.CONSOLE
    console.print(terminal.mode_table(outcome.modes))
    console.print(terminal.error_table(outputs, rows))
    for warning in (*(text for each in readings for text in each.warnings), *outcome.warnings):
        console.print(f"note: {warning}")
    console.print(f"order {outcome.model.nstates}, results in {out}")


def repair_bag(damaged: Path, output: Path) -> str:
    """Copy what is whole and say how much it is."""
    summary = repair.repair_bag(damaged, output)
    damage = f" ({summary.damage})" if summary.damage else " (nothing was damaged)"
    return f"{summary.bag}: {summary.messages} messages{damage}"
