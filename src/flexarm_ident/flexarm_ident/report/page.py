"""The report of an identification: one HTML file that needs nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, reduce
from importlib.resources import files
from typing import TYPE_CHECKING

import jinja2

from flexarm_core.errors import IdentificationError
from flexarm_ident.report import content as report_content
from flexarm_ident.report import data as report_data
from flexarm_ident.report import export as report_export
from flexarm_ident.report import figures as report_plots
from flexarm_ident.report import friction as report_friction
from flexarm_ident.report import reduction as report_reduction

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flexarm_ident.models.model_parameters import ParameterValue
    from flexarm_ident.workflow.workflow import Outcome

_END, _NAV_END = "</main>", "</ul></nav>"
_EXTRA = '<section id="more-'


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
        Plot, from `flexarm_ident.report.plots`; may be empty.
    """

    title: str
    words: str
    svg: str = ""


def render_report(
    outcome: Outcome,
    *,
    title: str,
    name: str,
    parameters: Mapping[str, ParameterValue],
    files: Sequence[str] = (),
    extra_sections: Sequence[Section] = (),
) -> str:
    """Render what was identified, from which data, how well it fits, and the model itself.

    Parameters
    ----------
    outcome : Outcome
        The identification.
    title : str
        Heading.
    name : str
        Name of the model.
    parameters : mapping
        The model as flat parameters `models.<name>.*` with the fields of `model_provenance`.
    files : sequence of str
        Files of the model that lie beside the report.
    extra_sections : sequence of Section
        Sections that follow at the end.

    Returns
    -------
    str
        A HTML document with its style, its plots and the model inside; it loads nothing and runs
        nothing.
    """
    galleries = report_plots.galleries(outcome)
    friction = report_friction.friction_table(outcome)
    text = (
        _environment()
        .get_template("report.html.j2")
        .render(
            title=title,
            sections=_contents([gallery.title for gallery in galleries], friction is not None),
            summary=report_content.summary(outcome),
            headline=report_data.headline(outcome),
            remarks=report_data.remarks(outcome),
            records=report_data.record_table(outcome),
            channels=report_data.channel_table(outcome),
            checks=report_data.checks(outcome),
            input_plots=report_data.input_plots(outcome),
            compensation_removed=outcome.request.remove_compensation,
            order=report_content.order_words(outcome),
            order_plots=report_plots.order_plots(outcome),
            clusters=report_content.cluster_table(outcome),
            modes=report_content.mode_table(outcome),
            mode_scatter=report_content.mode_scatter_words(outcome),
            pole_plots=report_plots.pole_plots(outcome),
            ranks=report_reduction.ranks(outcome),
            costs=report_reduction.costs(outcome),
            friction=friction,
            friction_words=report_friction.friction_words(outcome),
            errors=report_content.error_table(outcome),
            galleries=galleries,
            model=report_content.model_facts(outcome),
            files=files,
            downloads=report_export.downloads(name, parameters),
            loading=report_export.loading_lines(name),
            provenance=report_export.provenance(name, parameters),
        )
    )
    return reduce(append_section, extra_sections, text)


def _contents(galleries: Sequence[str], friction: bool) -> list[str]:  # noqa: FBT001 - as found
    """Return the headings that the navigation leads to."""
    more = ["Dry friction"] if friction else []
    return [
        *("Data", "Order", "Modes", "Poles", "Reduction", *more, "Errors"),
        *dict.fromkeys(galleries),
        "The model",
    ]


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
    anchor = f"more-{text.count(_EXTRA) + 1}"
    template = _environment().get_template("section.html.j2")
    added, entry = (
        template.render(section=section, anchor=anchor, part=part) for part in ("section", "entry")
    )
    before, nav_end, after = start.partition(_NAV_END)
    return f"{before}{entry}{nav_end}{after}{added}{end}{rest}"


@cache
def _environment() -> jinja2.Environment:
    folder = files("flexarm_ident.report") / "templates"
    return jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: (folder / name).read_text("utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
