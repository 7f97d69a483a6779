"""Chart: plots with their legends, as HTML with an SVG in each that stretches.

A panel among others explains what is drawn in it alone; the rest stands in the legend above all.
The words are HTML, so that they keep their size whatever the width. Without a script everything can
be read, and the legend hides and shows marks. The script of the page adds zoom and read-out from
the attributes that are written here.
"""

from __future__ import annotations

import html
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_ident.report.plots.marks import HEIGHT, WIDTH, Mark

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Sequence

    from flexarm_ident.report.plots.marks import Axis


@dataclass(frozen=True)
class Note:
    """Words at a point of a plot, both in the units of the axes; `side` is left, right or mid."""

    x: float
    y: float
    text: str
    side: str = "mid"


@dataclass(frozen=True, eq=False)
class Panel:
    """Marks over one vertical axis.

    Attributes
    ----------
    y : Axis
        Vertical axis.
    marks : sequence of Mark
        Marks, the rearmost first.
    size : str
        Height as a declaration of CSS.
    notes : sequence of Note
        Words within the plot.
    """

    y: Axis
    marks: Sequence[Mark]
    size: str = "height:9rem"
    notes: Sequence[Note] = ()


@dataclass(frozen=True, eq=False)
class View:
    """Panels one below the other over a common horizontal axis.

    Attributes
    ----------
    description : str
        Description for screen readers.
    x : Axis
        Horizontal axis.
    panels : sequence of Panel
        Panels from above.
    """

    description: str
    x: Axis
    panels: Sequence[Panel]


def chart(*views: View) -> str:
    """Return views side by side, of which the first is the widest, with their legends."""
    panels = [panel for view in views for panel in view.panels]
    marks = [mark for panel in panels for mark in panel.marks]
    labels = list(dict.fromkeys(mark.label for mark in marks if mark.label))
    own = {label for view in views for label in _labels_of_one(view)}
    common = [label for label in labels if label not in own]
    legend = _keys("div", common, marks, labels)
    shown = "".join(_view(view, labels, own) for view in views)
    side = " pair" if len(views) > 1 else ""
    return f'<div class="chart">{legend}<div class="views{side}">{shown}</div></div>'


def _labels_of_one(view: View) -> list[str]:
    """Return the labels that one panel only of several has."""
    if len(view.panels) == 1:
        return []
    found = Counter(
        label for panel in view.panels for label in {mark.label for mark in panel.marks}
    )
    return [label for label, panels in found.items() if panels == 1]


def _keys(tag: str, shown: Sequence[str], marks: Sequence[Mark], labels: Sequence[str]) -> str:
    """Return a legend; empty without a label."""
    samples = {mark.label: mark for mark in reversed(marks)}
    keys = "".join(_key(labels.index(label), samples[label]) for label in shown)
    return f'<{tag} class="keys">{keys}</{tag}>' if keys else ""


def _key(number: int, mark: Mark) -> str:
    return (
        f'<label><input type="checkbox" class="k{number}" checked=""/>'
        f'<svg viewBox="0 0 26 12" aria-hidden="true"><path class="{mark.look}" '
        f'd="{mark.swatch}"/></svg>{html.escape(mark.label)}</label>'
    )


def _view(view: View, labels: Sequence[str], own: Container[str]) -> str:
    # Panels of one width: an instant stands at the same place in all of them.
    two = any(panel.y.second for panel in view.panels)
    panels = "".join(
        _panel(
            *(panel, view.x, labels, _own_legend(panel, labels, own)),
            last=panel is view.panels[-1],
            two=two,
        )
        for panel in view.panels
    )
    about = html.escape(view.description, quote=True)
    words = f'<p class="x">{html.escape(view.x.label)}</p>'
    return f'<div class="view" role="group" aria-label="{about}">{panels}{words}</div>'


def _own_legend(panel: Panel, labels: Sequence[str], own: Container[str]) -> str:
    """Return the legend of one panel; what is alone there is named by the axis."""
    shown = [label for label in labels if label in {mark.label for mark in panel.marks}]
    if len(shown) == 1:
        return ""
    return _keys("span", [label for label in shown if label in own], panel.marks, labels)


def _panel(
    panel: Panel, x: Axis, labels: Sequence[str], legend: str, *, last: bool, two: bool
) -> str:
    y, second = panel.y, panel.y.second
    other = f"<b>{html.escape(second.unit)}</b>" if second else ""
    unit = f' data-second="{second.per_unit:.6g} {html.escape(second.unit)}"' if second else ""
    steps = f' data-step="{y.step:g}"' if y.step else ""
    logs = "".join(name for name, axis in (("x", x), ("y", y)) if axis.log)
    paths = "".join(_path(mark, x, y, labels) for mark in panel.marks)
    words = _ticks("x", x.marks() if last else ()) + _ticks("y", y.marks())
    words += _ticks("z", y.second_marks()) + "".join(_note(note, x, y) for note in panel.notes)
    return (
        f'<p class="y"><span>{html.escape(y.label)}</span>{legend}'
        f'<span class="read"></span>{other}</p>'
        f'<div class="area{" two" if two else ""}" style="{panel.size}" '
        f'data-x="{x.low:.8g} {x.high:.8g}" data-y="{y.low:.8g} {y.high:.8g}" data-log="{logs}" '
        f'data-count="{x.ticks} {y.ticks}"{unit}{steps}>'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" preserveAspectRatio="none" aria-hidden="true">'
        f'<path class="grid" d="{_grid(x, y)}"/>{paths}</svg>{words}</div>'
    )


def _path(mark: Mark, x: Axis, y: Axis, labels: Sequence[str]) -> str:
    name = f" m{labels.index(mark.label)}" if mark.label else ""
    read = f' data-read="{html.escape(mark.label, quote=True)}"' if mark.is_read else ""
    return f'<path class="{mark.look}{name}"{read} d="{mark.path(x, y)}"/>'


def _grid(x: Axis, y: Axis) -> str:
    across = "".join(f"M{WIDTH * place:.0f} 0v{HEIGHT}" for place, _ in x.marks())
    return across + "".join(f"M0 {HEIGHT * (1.0 - place):.0f}h{WIDTH}" for place, _ in y.marks())


def _ticks(axis: str, marks: Iterable[tuple[float, str]]) -> str:
    side = "left" if axis == "x" else "bottom"
    return "".join(
        f'<i class="{axis}" style="{side}:{100.0 * place:.2f}%">{text}</i>' for place, text in marks
    )


def _note(note: Note, x: Axis, y: Axis) -> str:
    left, bottom = (100.0 * float(axis.scaled(value)) for axis, value in ((x, note.x), (y, note.y)))
    return (
        f'<i class="note {note.side}" style="left:{left:.2f}%;bottom:{bottom:.2f}%">'
        f"{html.escape(note.text)}</i>"
    )
