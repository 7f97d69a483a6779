"""Program of the study, run by the verb `reproduce`: subjects are computed, shown and written."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE, VerbGroup, examples
from flexarm_core.outputs import require_place
from flexarm_core.workers import Workers
from reproduction.contents import all_subjects
from reproduction.framework.computing import Store, reproduce
from reproduction.framework.document import pages_of, write_document
from reproduction.framework.selection import select
from reproduction.framework.verdicts import Verdict, count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from reproduction.framework.computing import Outcome
    from reproduction.framework.findings import Finding, SideBySide
    from reproduction.framework.verdicts import Judgement

CACHE = Path("out/reproduction/cache")
_COLOURS = {
    Verdict.AGREES: "green",
    Verdict.BY_CONSTRUCTION: "cyan",
    Verdict.SAME_CONCLUSIONS: "cyan",
    Verdict.PARTLY: "yellow",
    Verdict.DIFFERS: "red",
    Verdict.NOT_COMPARABLE: "white",
    Verdict.ELSEWHERE: "white",
    Verdict.OURS: "white",
}


@click.group(cls=VerbGroup, context_settings={"help_option_names": ["-h", "--help"]})
def main() -> None:
    """Give this program the usage, error lines and exit codes of the command `flexarm`."""


@main.command("reproduce")
@click.argument("keys", nargs=-1)
@click.option("--list", "listing", is_flag=True, help="List the subjects.")
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/reproduction"),
    show_default=True,
    help="Folder of the pages.",
)
@click.option("--jobs", type=click.IntRange(1), help="Processes; by default one per core.")
@click.option("--dask", default="", metavar="ADDRESS", help="Scheduler of a Dask cluster.")
@click.option("--anew", is_flag=True, help="Compute what is kept of earlier runs too.")
@FORCE
@examples(
    "reproduce --list",
    "reproduce table-2-4",
    "reproduce 'figure-4-*' chapter-3",
    "reproduce all -o docs/reproduction",
    "reproduce table-2-4 --anew",
    "reproduce all --dask tcp://10.0.0.7:8786",
)
def command(
    keys: tuple[str, ...],
    out: Path,
    jobs: int | None,
    dask: str,
    **switches: bool,
) -> None:
    """Set tables, figures and claims of the thesis beside our own, with a verdict each.

    What was computed is kept, and taken again until the source changes.
    """
    if switches.pop("listing"):
        show_subjects(keys)
        return
    if not keys:
        raise click.UsageError("name a subject, such as table-2-4, or all; --list shows them")
    sys.exit(reproduce_subjects(keys, out, Workers(jobs or -1, dask), **switches))


def show_subjects(wanted: Sequence[str]) -> None:
    """Print the keys that are asked for, or all of them, with their titles."""
    table = Table("key", "what it shows", box=None)
    for subject in select(all_subjects(), wanted or ["all"]):
        table.add_row(subject.key, subject.title)
    terminal.show_table(table)


def reproduce_subjects(
    wanted: Sequence[str],
    out: Path,
    workers: Workers,
    *,
    force: bool = False,
    anew: bool = False,
) -> int:
    """Run subjects, print them, write the pages; return the exit code."""
    subjects = all_subjects()
    chosen = select(subjects, wanted)
    require_place(pages_of(chosen, out), force=force)
    try:
        with terminal.progress() as show:
            outcomes = reproduce(chosen, Store(CACHE), workers=workers, progress=show, anew=anew)
    except KeyboardInterrupt:
        terminal.CONSOLE.print(
            f"what was computed is kept: the same command{' without --anew' * anew} goes on from "
            "there"
        )
        raise
    for outcome in outcomes:
        _show(outcome)
    write_document(outcomes, out, complete=len(chosen) == len(subjects))
    _show_counts([each.finding.judgement for each in outcomes if each.finding])
    terminal.CONSOLE.print(f"written to {out / 'index.md'}")
    return 1 if any(each.failure for each in outcomes) else 0


def _show(outcome: Outcome) -> None:
    subject = outcome.subject
    terminal.step(f"{subject.key}: {subject.title}")
    if outcome.finding is None:
        terminal.marked("  failed", "red", f": {outcome.failure}")
        return
    _show_finding(outcome.finding)


def _show_finding(finding: Finding) -> None:
    for table in finding.tables:
        terminal.show_table(_rich_table(table))
    judgement = finding.judgement
    colour = _COLOURS[judgement.verdict]
    terminal.marked(f"  {judgement.verdict.value}", colour, f": {judgement.because}")


def _rich_table(side_by_side: SideBySide) -> Table:
    table = Table(title=side_by_side.title, title_justify="left", box=None)
    for heading in side_by_side.headings:
        table.add_column(heading, overflow="fold")
    for row in side_by_side.rows:
        table.add_row(*row)
    return table


def _show_counts(judgements: Sequence[Judgement]) -> None:
    counted = count(judgements).items()
    words = (Text(f"{kind.value} {n}", _COLOURS[kind]) for kind, n in counted)
    terminal.CONSOLE.print(Text(", ").join(words))


if __name__ == "__main__":
    main(["reproduce", *sys.argv[1:]], prog_name="flexarm")
