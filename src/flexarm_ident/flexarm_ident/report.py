"""The report of an identification: one HTML file that needs nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, reduce
from importlib.resources import files
from typing import TYPE_CHECKING

import jinja2

from flexarm_ident import plots, report_content, report_friction, report_plots
from flexarm_ident.errors import IdentificationError
from flexarm_ident.stabilisation_plot import stabilisation_plot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_ident.workflow import Outcome

_END = "</main>"


@dataclass(frozen=True)
class Section:
    """A further section of a report.

    Attributes
    ----------
    title : str
        Heading.
    words : str
        A paragraph of plain text.
    svg : str
        Plot, from `flexarm_ident.plots`; may be empty.
    """

    title: str
    words: str
    svg: str = ""


def render_report(
    outcome: Outcome,
    *,
    title: str,
    facts: Mapping[str, str],
    extra_sections: Sequence[Section] = (),
) -> str:
    """Render what was identified, from which data, and how well it fits.

    Parameters
    ----------
    outcome : Outcome
        The identification.
    title : str
        Heading.
    facts : mapping of str
        What the model's file is called, its hash and the like; listed under "The model".
    extra_sections : sequence of Section
        Sections that follow at the end.

    Returns
    -------
    str
        A HTML document with its style and plots inside; it loads nothing and runs nothing.
    """
    text = (
        _environment()
        .get_template("report.html.j2")
        .render(
            title=title,
            summary=report_content.summary(outcome),
            warnings=outcome.warnings,
            records=report_content.record_table(outcome),
            channels=report_content.channel_table(outcome.records),
            compensation_removed=outcome.request.remove_compensation,
            order=report_content.order_words(outcome),
            order_plots=_order_plots(outcome),
            modes=report_content.mode_table(outcome),
            deviations=bool(outcome.identification.mode_uncertainty),
            friction=report_friction.friction_table(outcome),
            friction_words=report_friction.friction_words(outcome),
            errors=report_content.error_table(outcome),
            galleries=report_plots.galleries(outcome),
            model=report_content.model_facts(outcome) | dict(facts),
        )
    )
    return reduce(append_section, extra_sections, text)


def _order_plots(outcome: Outcome) -> tuple[str, str]:
    found, known_hz = outcome.identification, outcome.request.known_modes_hz
    return (
        plots.singular_value_plot(found.singular_values, found.order),
        stabilisation_plot(found.diagram, known_modes_hz=known_hz, order=found.order),
    )


def append_section(text: str, section: Section) -> str:
    """Add a section at the end of a report.

    Parameters
    ----------
    text : str
        A report, from `render_report`.
    section : Section
        The section.

    Returns
    -------
    str
        The longer report.

    Raises
    ------
    IdentificationError
        If `text` is no such report.
    """
    start, end, rest = text.rpartition(_END)
    if not end:
        raise IdentificationError(f"cannot add {section.title!r}: the text is no report")
    added = _environment().get_template("section.html.j2").render(section=section)
    return f"{start}{added}{end}{rest}"


@cache
def _environment() -> jinja2.Environment:
    folder = files("flexarm_ident") / "templates"
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: (folder / name).read_text("utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
