"""Pictures that are also files of their own: style of matplotlib, and a figure as SVG text.

The plots of a report are drawn by `flexarm_ident.report.plots`, which needs its style sheet.
"""

from __future__ import annotations

import hashlib
import html
import io
import re
from typing import TYPE_CHECKING, Any

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import TightLayoutEngine
from matplotlib.ticker import FuncFormatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH_IN = 4.5
BLUE, VERMILION, BLACK = "#56b4e9", "#d55e00", "#000000"
SOLID: Any = {"color": BLUE, "linewidth": 1.8}
DASHED: Any = {"color": BLACK, "linestyle": "--"}
DOTTED: Any = {"color": BLACK, "linestyle": ":"}
SHADE, MARK = "#ececec", "#777777"
# A phone shows 4.5 inches 380 pixels wide: 10 points are 11 pixels there.
STYLE: Any = {
    "font.family": ["DejaVu Sans"],
    "font.size": 10.0,
    # Near the places that the labels leave, which the layout finds in one pass then.
    "figure.subplot.left": 0.15,
    "figure.subplot.right": 0.98,
    "figure.subplot.bottom": 0.2,
    "figure.subplot.top": 0.85,
    "figure.subplot.hspace": 0.4,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "#dddddd",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "legend.fontsize": 10.0,
    "legend.borderpad": 0.0,
    "legend.borderaxespad": 0.2,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.0,
    "lines.linewidth": 1.3,
    "text.parse_math": False,
    "axes.unicode_minus": True,
    "svg.fonttype": "none",
    "svg.hashsalt": "flexarm",
}


def figure_of(height_in: float) -> Figure:
    """Return an empty figure of the common width."""
    # It measures everything once; with its own rectangle, and in the constrained layout, twice.
    layout = TightLayoutEngine(pad=0.4, h_pad=0.6, rect=None)  # type: ignore[arg-type]
    return Figure(figsize=(WIDTH_IN, height_in), layout=layout)


def legend_above(axes: Axes, columns: int = 3) -> None:
    """Put the legend above the axes, where it hides no curve."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.02), ncols=columns)


def plain_numbers() -> FuncFormatter:
    """Return a formatter for tick labels without powers of ten."""
    return FuncFormatter(lambda value, _position: f"{value:g}")


def inline_svg(figure: Figure, description: str) -> str:
    """Return a figure as an SVG element that can stand in a page beside others.

    The same figure gives the same text: it has no date.

    Parameters
    ----------
    figure : Figure
        Figure, drawn with DejaVu Sans.
    description : str
        Description for screen readers.
    """
    for patch in (figure.patch, *(axes.patch for axes in figure.axes)):
        patch.set_visible(False)
    text = _drawn(figure)
    if any(axes.yaxis.label.get_window_extent().x0 < 0.0 for axes in figure.axes):
        # The ticks of the new size are wider than those that were measured.
        text = _drawn(figure)
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = text[text.index("<svg") :].strip()
    # The first font sets the layout; the others are as wide or narrower.
    text = text.replace("'DejaVu Sans'", "'DejaVu Sans', Verdana, Arial, sans-serif")
    # Another processor's last digits do not make another picture.
    text = re.sub(
        r' (?:d|x|y|transform|points)="[^"]*"',
        lambda place: re.sub(r"(\.\d\d)\d+", r"\1", place[0]),
        text,
    )
    # Names of one figure must not meet those of another in the same page.
    prefix = "f" + hashlib.sha256(text.encode()).hexdigest()[:8]
    used = set(re.findall(r'(?:url\(|href=")#([^")]+)', text))
    text = re.sub(
        r' id="([^"]+)"',
        lambda found: f' id="{prefix}{found[1]}"' if found[1] in used else "",
        text,
    )
    text = re.sub(r'(url\(|href=")#', rf"\g<1>#{prefix}", text)
    label = html.escape(description, quote=True)
    return re.sub(
        r'^<svg [^>]*?(viewBox="[^"]*")[^>]*>',
        lambda found: (
            '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
            f'{found[1]} role="img" aria-label="{label}">'
        ),
        text,
    )


def _drawn(figure: Figure) -> str:
    """Return a figure as SVG, drawn once; `savefig` draws it once more before."""
    buffer = io.StringIO()
    FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None})  # type: ignore[no-untyped-call]
    return buffer.getvalue()
