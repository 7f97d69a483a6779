"""Self-contained HTML report of an identification."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import jinja2
import numpy as np

from flexarm_core.channels import CHANNEL_NAMES
from flexarm_core.errors import IdentificationError
from flexarm_core.labels import counted, label_and_unit
from flexarm_core.outputs import MARK
from flexarm_ident.diagnostics.verdict import fit_text
from flexarm_ident.report.content.blocks import Card, Facts
from flexarm_ident.report.content.match_gallery import first_match
from flexarm_ident.report.content.wording import listed, sentence, short_labels
from flexarm_ident.report.script import content_policy, script
from flexarm_ident.report.sections import sections
from flexarm_ident.report.summary import cautions, remarks, summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from flexarm_ident.diagnostics.verdict import Verdict
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_END, _NAV_END = "</main>", "</ul></nav>"
_EXTRA = '<section id="more-'
_NAMES_SHOWN = 3


def render_report(subject: Subject, *, title: str) -> str:
    """Render the data, the model, its fit and its cautions as a report.

    Parameters
    ----------
    subject : Subject
        The identification.
    title : str
        Heading.

    Returns
    -------
    str
        A HTML document with its style, plots, script and model inside; it loads nothing.
    """
    shown = [section for section in sections() if section.applies(subject)]
    return _template("report.html.j2").render(
        title=title,
        card=card(subject),
        summary=summary(subject.outcome),
        cautions=cautions(subject.outcome),
        remarks=remarks(subject.outcome),
        sections=[(section.anchor, section.title, section.build(subject)) for section in shown],
    )


def render_page(title: str, lines: Iterable[str], parts: Mapping[str, Iterable[Block]]) -> str:
    """Render a page in the style of the reports, which may link to files beside it.

    Parameters
    ----------
    title : str
        Heading.
    lines : iterable of str
        Summary, one sentence each.
    parts : mapping of str to iterable of Block
        Headings of the sections and their content.
    """
    return _template("report.html.j2").render(
        title=title,
        card=None,
        summary=list(lines),
        cautions=(),
        remarks=(),
        sections=[(head.lower().replace(" ", "-"), head, blocks) for head, blocks in parts.items()],
    )


def append_section(text: str, title: str, blocks: Iterable[Block]) -> str:
    """Add a section at the end of a report from `render_report`.

    Parameters
    ----------
    text : str
        The report.
    title : str
        Heading of the section.
    blocks : iterable of Block
        Its content.

    Raises
    ------
    IdentificationError
        If `text` is no such report.
    """
    start, end, rest = text.rpartition(_END)
    if not end:
        raise IdentificationError(f"cannot add {title!r}: the text is not a report")
    anchor = f"more-{text.count(_EXTRA) + 1}"
    entry, section = _macro("entry", anchor, title), _macro("section", anchor, title, blocks)
    before, nav_end, after = start.partition(_NAV_END)
    return f"{before}{entry}{nav_end}{after}{section}{end}{rest}"


@cache
def _environment() -> jinja2.Environment:
    folder = files("flexarm_ident.report") / "templates"
    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: (folder / name).read_text("utf-8")),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["rendered"] = _rendered
    environment.globals |= {"mark": MARK, "policy": content_policy(), "script": script()}
    return environment


def _template(name: str) -> jinja2.Template:
    return _environment().get_template(name)


def _macro(name: str, *arguments: object) -> str:
    return str(getattr(_template("blocks.html.j2").module, name)(*arguments))


def _rendered(block: Block) -> str:
    return _macro(block.macro, block)


def card(subject: Subject) -> Card:
    """Return the card of an identification."""
    outcome = subject.outcome
    found, step = outcome.verdict, outcome.verdict.next_step
    return Card(
        level=str(found.level),
        verdict=f"The model is {found.level}",
        figures=tuple(_figures(found)),
        next_step=sentence(step),
        facts=Facts(tuple(_facts(subject))),
        picture=first_match(outcome),
    )


def _figures(found: Verdict) -> list[tuple[str, str]]:
    worst = label_and_unit(found.worst_output)[0]
    about = (
        f"fit (NRMSE, simulation, {found.validation}); the lowest is {worst} with "
        f"{fit_text(found.worst)}"
    )
    figures = [(fit_text(found.error), about)]
    if np.isfinite(found.missed):
        words = "of the residual power is coherent with the input"
        removable = ": a better linear model could remove it" if found.avoidable else ""
        figures.append((f"{100.0 * found.missed:.0f} %", words + removable))
    return figures


def _facts(subject: Subject) -> list[tuple[str, str]]:
    outcome = subject.outcome
    names = list(short_labels(outcome.records).values())
    more = counted(len(names) - _NAMES_SHOWN, "other") if len(names) > _NAMES_SHOWN else ""
    seconds = sum(outcome.samples) * outcome.records[0].dt_s
    facts = [
        ("rig", _rig(outcome)),
        ("record", f"{listed([*names[:_NAMES_SHOWN], *filter(None, [more])])}, {seconds:.1f} s"),
        ("model", f"{counted(outcome.model.nstates, 'state')}, {outcome.identification.title}"),
    ]
    if subject.begun:
        begun = subject.begun.replace("T", " ").replace("+00:00", " UTC")
        facts.insert(2, ("recorded", begun))
    return facts


def _rig(outcome: Outcome) -> str:
    first = outcome.records[0]
    if first.outputs == CHANNEL_NAMES:
        return "flexible arm"
    inputs, outputs = (
        counted(len(each), noun)
        for each, noun in ((first.inputs, "input"), (first.outputs, "output"))
    )
    return f"{inputs}, {outputs}: {listed([label_and_unit(name)[0] for name in first.outputs[:4]])}"
