"""The common look of the plots: size, colours, lines and fonts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure
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
    return Figure(figsize=(WIDTH_IN, height_in), layout="constrained")


def legend_above(axes: Axes, columns: int = 3) -> None:
    """Put the legend above the axes, where it hides no curve."""
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.02), ncols=columns)


def plain_numbers() -> FuncFormatter:
    """Return a formatter for tick labels without powers of ten."""
    return FuncFormatter(lambda value, _position: f"{value:g}")
