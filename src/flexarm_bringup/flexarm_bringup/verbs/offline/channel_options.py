"""Options that say what of a bag is read: signals of other programs, and a part of the time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console.quantity import TIME_S, Quantity
from flexarm_bringup.console.verb_group import together
from flexarm_core.errors import BagError
from flexarm_ident.reading.channels import CLOCKS, Selection, selection
from flexarm_ident.reading.fields import parse_field
from flexarm_ident.reading.read import signals_text
from flexarm_ident.records.span import Span

if TYPE_CHECKING:
    from pathlib import Path

channel_options = together(
    click.option(
        "--input",
        "inputs",
        multiple=True,
        metavar="TOPIC.FIELD",
        help="Input in a bag of other messages, such as /command.data, or column of a CSV file; "
        "repeat. NAME=TOPIC.FIELD names it.",
    ),
    click.option(
        "--output",
        "outputs",
        multiple=True,
        metavar="TOPIC.FIELD",
        help="Output, such as /joint_states.position[0], or column; repeat.",
    ),
    click.option(
        "--time",
        "times",
        multiple=True,
        metavar="TIME",
        help="Time of a CSV file: COLUMN, COLUMN:us or a rate, 200Hz; both to resample.",
    ),
    click.option(
        "--clock",
        type=click.Choice(CLOCKS),
        help="Time stamps of other messages; else headers where every topic has them.",
    ),
    click.option(
        "--held/--interpolated",
        default=True,
        show_default=True,
        help="Input hold: zero-order (commands) or first-order (measured).",
    ),
    click.option(
        "--from",
        "from_s",
        type=Quantity(TIME_S, 0.0),
        default=0.0,
        metavar="TIME",
        help="Start of the part to use, s from the start of each record.",
    ),
    click.option(
        "--to",
        "to_s",
        type=Quantity(TIME_S, 0.0),
        metavar="TIME",
        help="End of the part to use; the record's end by default.",
    ),
    click.option(
        "--wrap",
        type=click.FloatRange(min=0.0),
        metavar="PERIOD",
        help="Counts per turn at which an output wraps, such as 4000; 0: none. Found by default.",
    ),
)
"""Options of a verb, which takes them by `taken_channels` and `taken_span`."""


def taken_channels(options: dict[str, Any], bag: Path) -> Selection | None:
    """Take the channels out of the options; None when none is named.

    Raises
    ------
    BagError
        When a name is none of a field, with those that a bag has.
    """
    inputs, outputs, clock, held = (
        options.pop(name) for name in ("inputs", "outputs", "clock", "held")
    )
    output_only = options.pop("output_only", False)
    if not (inputs or outputs):
        if clock or not held:
            raise click.UsageError(
                "--clock and --interpolated belong to --input and --output of a bag"
            )
        return None
    try:
        for name in (*inputs, *outputs):
            parse_field(name)
    except BagError as error:
        raise BagError(f"{error}; {signals_text(bag)}") from error
    return selection(inputs, outputs, clock=clock, interpolated=not held, output_only=output_only)


def taken_span(options: dict[str, Any]) -> Span:
    """Take the part of the records out of the options."""
    return Span(options.pop("from_s"), options.pop("to_s"), options.pop("wrap"))
