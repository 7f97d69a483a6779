"""Benchmark on measured records: our default beside peers with an order of their own choice.

Each CSV file of a folder is cut into halves. The means of the first are taken off all columns, the
first is fitted, and the second is simulated freely from the initial state that suits it best. The
error is relative to the output's deviation about its mean, averaged over the outputs. `grid` is the
best of our own methods and orders with hindsight.
"""

from __future__ import annotations

import tempfile
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import click
import control
import numpy as np

from bench.ident.arx import arx
from bench.ident.ident import install, interpreters, run_worker
from bench.tools import json_option, make_table, run_trials, write_json
from flexarm_bringup.console import terminal
from flexarm_core.errors import FlexarmError
from flexarm_ident import identify, validate_dmv
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.importing.csv_columns import TableColumns, guessed_columns
from flexarm_ident.importing.csv_record import read_csv
from flexarm_ident.subspace.methods import METHODS

if TYPE_CHECKING:
    from rich.table import Table

    from flexarm_ident import IoData

GRID_ORDERS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 22, 26, 30)
CLOSE = 1.05
"""Ratio to the best peer up to which the default counts as good as it."""
_PEERS = ("ctrlsys", "sippy")
_BLOCK_ROWS = 15
_HALF = 0.5


@dataclass(frozen=True)
class Row:
    """Errors on the second half of a file; infinite where there is no model.

    `peers` are those of ARX, SLICOT and SIPPY by names, `grid` is None where it was not asked for.
    """

    file: str
    samples: int
    inputs: int
    outputs: int
    default: float
    model: str
    peers: dict[str, float]
    grid: float | None

    @property
    def ratio(self) -> float:
        """Error of the default in units of the best peer's."""
        return self.default / min(self.peers.values())


@click.command()
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--grid", is_flag=True, help="Fit every method and order, too.")
@json_option
@click.option("--install-peers", is_flag=True, help="Install the peers from PyPI first.")
def main(folder: Path, *, grid: bool, json_file: Path | None, install_peers: bool) -> None:
    """Measure on all CSV files of FOLDER, whose inputs are called u, u1, torque...

    Each gets a row: the default's error beside those of the peers.
    """
    if install_peers:
        install(_PEERS)
    files = sorted(folder.glob("*.csv"))
    if not files:
        raise click.ClickException(f"{folder}: no CSV file is there")
    pythons = interpreters()
    rows = run_trials(measured, [(file, grid, pythons) for file in files])
    write_json(json_file, rows)
    terminal.show_table(table(rows))
    good = sum(row.ratio <= CLOSE for row in rows)
    terminal.CONSOLE.print(f"ahead of the best peer or within 5 %: {good} of {len(rows)}")
    if missing := set(_PEERS) - set(pythons):
        terminal.CONSOLE.print(f"not installed: {', '.join(sorted(missing))}; --install-peers")


def measured(case: tuple[Path, bool, dict[str, str]]) -> Row:
    """Return the row of one file, by the Python of each installed peer."""
    file, grid, pythons = case
    first, second = halves(read_csv(file, TableColumns(*guessed_columns(file, (), ()))))
    default, model = np.inf, "none"
    try:
        found = identify(first)
        default, model = judged(found.model, second), f"{found.method} {found.order}"
    except FlexarmError as error:
        model = str(error)
    peers = {"arx": judged(arx(first), second)}
    for peer in _PEERS:
        if peer in pythons:
            peers[peer] = _peer(peer, pythons, first, second)
    best = min(_grid(first, second), default=np.inf) if grid else None
    shape = (len(first), len(first.inputs), len(first.outputs))
    return Row(file.stem, *shape, default, model, peers, best)


def halves(data: IoData) -> tuple[IoData, IoData]:
    """Return both halves without the means of the first."""
    first, second = data.split(_HALF)
    u, y = first.u.mean(axis=0), np.nanmean(first.y_measured, axis=0)
    return replace(first, u=first.u - u, y=first.y - y), replace(
        second, u=second.u - u, y=second.y - y
    )


def judged(model: control.StateSpace, second: IoData) -> float:
    """Return the mean error in free simulation, infinite where that overflows."""
    try:
        return mean_error(validate_dmv(model, second).error)
    except FlexarmError:
        return np.inf


def table(rows: list[Row]) -> Table:
    """Return the rows as a table."""
    peers = list(rows[0].peers)
    heads = ("file", "model", "samples", "in x out", "default", *peers, "to the best", "grid")
    shown = make_table(*heads, title="relative error on the half that was left out", words=2)
    for row in rows:
        shown.add_row(
            *(row.file, row.model[:24], str(row.samples), f"{row.inputs} x {row.outputs}"),
            f"{row.default:.3f}",
            *(f"{row.peers[peer]:.3f}" for peer in peers),
            f"{row.ratio:.2f}",
            "-" if row.grid is None else f"{row.grid:.3f}",
        )
    return shown


def _grid(first: IoData, second: IoData) -> list[float]:
    errors = []
    for method, order in product(METHODS, GRID_ORDERS):
        with suppress(FlexarmError):  # too few data for the order
            errors.append(judged(identify(first, method=method, order=order).model, second))
    return errors


def _peer(peer: str, pythons: dict[str, str], first: IoData, second: IoData) -> float:
    """Return the error of a peer that chooses its order itself."""
    channels = len(first.inputs) + len(first.outputs)
    block_rows = max(2, min(_BLOCK_ROWS, len(first) // (2 * (channels + 1)) - 1))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.save(folder / "u.npy", first.u)
        np.save(folder / "y.npy", first.y)
        answer = run_worker(peer, folder, pythons, 0, block_rows)
    if isinstance(answer, str):
        return np.inf
    A, B, C, D = map(np.atleast_2d, answer["model"][:4])
    return judged(control.ss(A, B, C, D, first.dt_s), second)


if __name__ == "__main__":
    main()
