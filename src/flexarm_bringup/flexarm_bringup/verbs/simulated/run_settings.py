"""Choices of the user about a run on the simulated arm, and room for its results."""

from __future__ import annotations

import os
import shutil
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE, together
from flexarm_bringup.graph.processes import HeldDriveError
from flexarm_bringup.verbs.laboratory.options import ARM, LIVE, PAYLOAD, paced
from flexarm_core.outputs import MARK, OutputError, is_replaceable, require_place
from flexarm_core.own_files import claimed
from flexarm_ident.job import result_files

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from flexarm_bringup.runs.pace import Pace

SUMMARY_FILE = "summary.json"
REPORT_FILE = "report.html"
EXPERIMENT = "experiment"
"""Name of the record that is identified, and of its model."""
MODELS_FOLDER = "models"
_BAG_FOLDER = "bag"
_LEFT_OVER = ".flexarm"


@dataclass(frozen=True)
class RunSettings:
    """Choices of the user.

    `keep_bag` keeps the bags in the folder of the results, `force` replaces what somebody else or
    an earlier `keep_bag` left there. `live` serves a page that looks on.
    """

    out: Path
    payload_kg: float
    seed: int
    pace: Pace
    keep_bag: bool
    force: bool
    live: bool
    namespace: str

    def results_text(self) -> str:
        """Return where the results are, for the user."""
        kept = str(self.out / _BAG_FOLDER) if self.keep_bag else "removed, --keep-bag keeps them"
        return f"Report: {self.out / REPORT_FILE}. Bags: {kept}"

    def make_room(self) -> None:
        """Refuse, before any work, to replace what somebody else or `keep_bag` left in the folder.

        Raises
        ------
        OutputError
            When a result would replace something of somebody else.
        """
        out = self.out
        models = result_files(out / MODELS_FOLDER / EXPERIMENT, ())
        require_place([out / SUMMARY_FILE, out / REPORT_FILE, *models], force=self.force)
        bags = out / _BAG_FOLDER
        is_left_over = (bags / _LEFT_OVER).is_file() and is_replaceable(bags / _LEFT_OVER)
        if bags.exists() and not (self.force or is_left_over):
            raise OutputError(
                f"{bags}: holds bags that were kept, or something else: move it away, choose "
                "another --out, or replace it with --force"
            )

    @contextmanager
    def bag_folder(self) -> Iterator[Path]:
        """Give an empty folder for bags; remove it at the end, unless kept.

        The bags of a run whose drive was held are evidence: they stay until the next run.

        Raises
        ------
        OutputError
            When another run is at work in the folder of the results.
        """
        self.out.mkdir(parents=True, exist_ok=True)
        taken = OutputError(
            f"{self.out}: another run is at work there: choose another --out, or wait for it"
        )
        # Another run would take these bags away.
        with claimed(os.open(self.out, os.O_RDONLY), taken):
            yield from self._emptied()

    def _emptied(self) -> Iterator[Path]:
        folder = self.out / _BAG_FOLDER
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        if not self.keep_bag:
            # A run that is killed leaves the folder: the next one may remove it.
            (folder / _LEFT_OVER).write_text(f"{MARK}\n", "utf-8")
        keeps = self.keep_bag
        try:
            yield folder.absolute()
        except HeldDriveError:
            keeps = True
            terminal.CONSOLE.print(f"what was recorded is kept in {folder}")
            raise
        finally:
            if not keeps:
                shutil.rmtree(folder, ignore_errors=True)


run_options = together(
    PAYLOAD,
    click.option(
        "--seed",
        type=click.IntRange(0),
        default=1,
        show_default=True,
        help="Seed of the noise.",
    ),
    paced,
    click.option("--keep-bag", is_flag=True, help="Keep the recorded bags in OUT/bag."),
    LIVE,
    FORCE,
    ARM,
)
"""Options of `RunSettings`, but for the folder."""
