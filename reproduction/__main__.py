"""The verb reproduce: tables and figures of the thesis beside our own, without any node."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_reproduction.document import write_document
from flexarm_reproduction.findings import Verdict, count
from flexarm_reproduction.run import reproduce
from flexarm_reproduction.selection import all_subjects, select
from flexarm_reproduction.store import Store

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_reproduction.computing import Workers
    from flexarm_reproduction.findings import Finding, Judgement, SideBySide
    from flexarm_reproduction.run import Outcome

CACHE = Path("out/reproduction/cache")
_COLOURS = {Verdict.AGREES: "green", Verdict.SAME_RANKING: "yellow", Verdict.DIFFERS: "red"}


def show_subjects(wanted: Sequence[str]) -> None:
    """Print the keys that are meant, or all of them, with what the thesis shows there."""
    table = Table("key", "what it shows", box=None)
    for subject in select(all_subjects(), wanted or ["all"]):
        table.add_row(subject.key, escape(subject.title))
    terminal.CONSOLE.print(table)


def reproduce_subjects(wanted: Sequence[str], out: Path, workers: Workers) -> int:
    """Run what is wanted, print it, write the pages; return the exit code.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, after a line that says what is kept.
    """
    subjects = all_subjects()
    chosen = select(subjects, wanted)
    try:
        with terminal.progress() as show:
            outcomes = reproduce(chosen, Store(CACHE), workers=workers, progress=show)
    except KeyboardInterrupt:
        terminal.CONSOLE.print("what was computed is kept: the same command goes on from there")
        raise
    for outcome in outcomes:
        _show(outcome)
    write_document(outcomes, out, complete=len(chosen) == len(subjects))
    _show_counts([each.finding.judgement for each in outcomes if each.finding])
    terminal.CONSOLE.print(f"written to {out / 'index.md'}")
    return 1 if any(each.failure for each in outcomes) else 0


def _show(outcome: Outcome) -> None:
    subject = outcome.subject
    terminal.step(f"{subject.key}: {escape(subject.title)}")
    if outcome.finding is None:
        terminal.CONSOLE.print(f"  [red]failed[/red]: {escape(outcome.failure)}")
        return
    _show_finding(outcome.finding)


def _show_finding(finding: Finding) -> None:
    for table in finding.tables:
        terminal.CONSOLE.print(_rich_table(table))
    judgement = finding.judgement
    colour = _COLOURS[judgement.verdict]
    words = f"[{colour}]{judgement.verdict.value}[/{colour}]: {escape(judgement.because)}"
    terminal.CONSOLE.print(f"  {words}")


def _rich_table(side_by_side: SideBySide) -> Table:
    headings = map(escape, side_by_side.headings)
    table = Table(title=escape(side_by_side.title), title_justify="left", box=None)
    for heading in headings:
        table.add_column(heading, overflow="fold")
    for row in side_by_side.rows:
        table.add_row(*map(escape, row))
    return table


def _show_counts(judgements: Sequence[Judgement]) -> None:
    words = (f"[{_COLOURS[kind]}]{kind.value} {n}[/]" for kind, n in count(judgements).items())
    terminal.CONSOLE.print(", ".join(words))
