"""Terminal of the user: steps, progress, tables."""

from __future__ import annotations

import shlex
import sys
import textwrap
from contextlib import contextmanager
from math import isnan
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from flexarm_bringup.console.called import as_called
from flexarm_bringup.console.interruption import check_interruption
from flexarm_core.labels import decay, label_and_unit, with_deviation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from flexarm_ident.job import Results
    from flexarm_ident.models.modes import Mode

# Without a terminal there is nothing to wrap for. Names of a user may have brackets.
CONSOLE = Console(
    highlight=False, markup=False, soft_wrap=True, width=None if sys.stdout.isatty() else 110
)
_WIDEST = 1000
_LEVEL = ".friction_level"
_GRADES = {"do not use": "bold red", "caution": "yellow"}
"""Colours of notes, by their first words."""


class ShownModel(NamedTuple):
    """Facts of an identified model that the user sees.

    Errors are those of (2-25), one per output and the mean; `left_out`, of the full model on blocks
    left out of the fit, and `sfv` may be empty. Of the parameters `models.<name>.*` the friction is
    shown. The standard deviations of the modes' frequencies may be unknown.
    """

    modes: Sequence[Mode]
    outputs: Sequence[str]
    dmv: Sequence[float]
    left_out: Sequence[float]
    sfv: Sequence[float]
    parameters: Mapping[str, Any]
    warnings: Sequence[str]
    frequency_std_hz: Sequence[float] = ()


def facts_of(results: Results) -> ShownModel:
    """Return what the user sees of the results of an identification."""
    outcome = results.outcome
    return ShownModel(
        modes=outcome.modes,
        outputs=outcome.records[0].outputs,
        dmv=results.dmv,
        left_out=results.left_out,
        sfv=results.sfv,
        parameters=results.parameters,
        warnings=outcome.warnings,
        frequency_std_hz=results.frequency_std_hz,
    )


def show_model(model: ShownModel) -> None:
    """Print modes, fits, dry friction and warnings."""
    dt_s = next(value for key, value in model.parameters.items() if key.endswith(".dt_s"))
    show_table(mode_table(model.modes, dt_s, model.frequency_std_hz))
    is_reduced = not all(mode.kept for mode in model.modes)
    of_full = " of the full model" if is_reduced else ""
    rows = [
        ("simulation, measured input (DMV)", model.dmv),
        (f"5-fold cross-validation{of_full}", model.left_out),
        ("closed-loop simulation (SFV)", model.sfv),
    ]
    rows = [(name, errors) for name, errors in rows if len(errors)]
    show_table(fit_table(model.outputs, rows))
    friction = friction_table(model.parameters)
    if friction.row_count:
        show_table(friction)
    for warning in model.warnings:
        note(warning)


def show_table(table: Table) -> None:
    """Print a table with all its words: a narrow terminal wraps its rows, as it does other lines.

    Rich would end names in an ellipsis there, and one that no other has may be lost.
    """
    natural = CONSOLE.measure(table, options=CONSOLE.options.update(max_width=_WIDEST)).maximum
    # A console never prints wider than it is.
    wide = Console(
        force_terminal=CONSOLE.is_terminal,
        highlight=False,
        markup=False,
        soft_wrap=True,
        width=max(CONSOLE.width, natural),
    )
    with wide.capture() as drawn:
        wide.print(table)
    CONSOLE.print(Text.from_ansi(drawn.get().removesuffix("\n")), soft_wrap=True)


def note(text: str) -> None:
    """Print a note below what it belongs to, in a colour by its grade."""
    style = next((style for grade, style in _GRADES.items() if text.startswith(grade)), None)
    if CONSOLE.is_terminal:
        text = textwrap.fill(
            text,
            CONSOLE.width,
            initial_indent="  ",
            subsequent_indent="    ",
            break_long_words=False,
        )
    else:
        text = f"  {text}"
    CONSOLE.print(text, style=style)


def next_step(text: str) -> None:
    """Print what a user may do next: a command, with its paths `quoted`."""
    CONSOLE.print(f"Then: {as_called(text)}")


def quoted(path: Path) -> str:
    """Return a path as a shell takes it."""
    return shlex.quote(str(path))


@contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """Show what is being done and the part of the whole; without a terminal, a line per stage.

    What is called to show it raises the KeyboardInterrupt that a library has swallowed.
    """
    with _shown_progress() as show:

        def checked(text: str, done: float) -> None:
            check_interruption()
            show(text, done)

        yield checked


@contextmanager
def _shown_progress() -> Iterator[Callable[[str, float], None]]:
    if not CONSOLE.is_terminal:
        yield _stage_lines()
        return
    columns = (
        TextColumn("  {task.description:12}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
    )
    with Progress(*columns, TimeElapsedColumn(), console=CONSOLE, transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda text, done: bar.update(task, description=text, completed=done)


@contextmanager
def progress_bar(text: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show how much of `total` is done; without a terminal, the text alone."""
    with _shown_progress() as show:

        def checked(done: int) -> None:
            check_interruption()
            show(text, done / total)

        yield checked


def _stage_lines() -> Callable[[str, float], None]:
    shown = ""

    def show(text: str, _done: float) -> None:
        nonlocal shown
        if text != shown:
            shown = text
            CONSOLE.print(f"  {text}")

    return show


@contextmanager
def busy(text: str) -> Iterator[None]:
    """Show that something is being worked on."""
    if CONSOLE.is_terminal:
        with CONSOLE.status(Text(text)):
            yield
    else:
        CONSOLE.print(f"  {text}")
        yield


def step(text: str) -> None:
    """Announce a step."""
    CONSOLE.print(text, style="bold")


def marked(word: str, colour: str, text: str) -> None:
    """Print a word in a colour, and what it is said of."""
    CONSOLE.print(Text.assemble((word, colour), text))


def mode_table(modes: Sequence[Mode], dt_s: float, frequency_std_hz: Sequence[float] = ()) -> Table:
    """Return the table of modes as in Table 3-1a; real ones have their time constants, s."""
    table = Table("frequency Hz", "damping", "MRM", "rank", "MSV", "rank", "kept", box=None)
    deviations: Sequence[float | None] = frequency_std_hz or [None] * len(modes)
    pairs = zip(modes, deviations, strict=True)
    for mode, deviation_hz in sorted(pairs, key=lambda pair: pair[0].mrm_rank):
        table.add_row(
            decay(mode.eigenvalue, dt_s) or with_deviation(mode.frequency_hz, deviation_hz),
            f"{mode.damping_ratio:.4f}",
            f"{mode.mrm:.4g}",
            str(mode.mrm_rank),
            f"{mode.msv:.4g}",
            str(mode.msv_rank),
            "yes" if mode.kept else "",
        )
    return table


def fit_table(outputs: Sequence[str], rows: Iterable[tuple[str, Sequence[float]]]) -> Table:
    """Return a table of fits in percent, one column per output and the mean.

    The fit is 100 (1 - e) of the relative error e (2-25) about the mean. The mean error stands
    beside it, for comparison with the thesis. A constant output has no fit.
    """
    table = Table("fit, %", *outputs, "mean", "relative error", box=None)
    for name, errors in rows:
        fits = ("-" if isnan(error) else f"{100.0 * (1.0 - error):.1f}" for error in errors)
        table.add_row(name, *fits, f"{errors[-1]:.4f}")
    return table


def friction_table(parameters: Mapping[str, Any]) -> Table:
    """Return the table of dry friction among a model's parameters; without rows when none is.

    Rise at standstill and load have columns where the friction depends on them.
    """
    found = [key.removesuffix("level") for key in parameters if key.endswith(_LEVEL)]
    fields = {"Coulomb level": "level", "offset": "offset"}
    if any(prefix + "rise" in parameters for prefix in found):
        fields |= {"rise at standstill": "rise", "part of load": "load"}
    table = Table("dry friction", *fields, "unit", box=None)
    for prefix in found:
        names = parameters[prefix.removesuffix("friction_") + "input_names"]
        columns = [
            [
                # An effect that was not taken is not a zero that was measured.
                with_deviation(value, deviation) if value or deviation else "-"
                for value, deviation in zip(
                    parameters[prefix + field], parameters[f"{prefix}{field}_std"], strict=True
                )
            ]
            for field in fields.values()
        ]
        for name, *cells in zip(names, *columns, strict=True):
            table.add_row(name, *cells, label_and_unit(name)[1])
    return table
