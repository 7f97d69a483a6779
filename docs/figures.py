"""Figures of the pages, from the bags that the commands of a page have written.

`./flexarm docs` calls it where a page says so, and compares what it draws with the figure that the
page shows.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from matplotlib import pyplot as plt

from flexarm_ident import identify, preprocess, read_bag

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LOOK: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "flexarm",
    "path.simplify": False,
    "font.family": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.4,
    "legend.frameon": False,
}
SIZE_IN = (4.8, 2.7)
EVERY = 4
"""Samples a point of a line."""
SHOWN_S = 20.0
STEP_S = 4.0
BANDS_HZ = 60.0
BAGS = click.argument("bags", nargs=-1, type=click.Path(path_type=Path))
OUT = click.argument("out", type=click.Path(path_type=Path))


def new() -> Axes:
    """Return the axes of a new figure."""
    axes: Axes = plt.subplots(figsize=SIZE_IN, layout="constrained")[1]
    return axes


def save(axes: Axes, out: Path) -> None:
    """Write the figure, the same at any time."""
    plt.sca(axes)
    plt.savefig(out, metadata={"Date": None, "Creator": None})


@click.group()
def main() -> None:
    """Draw a figure of the pages."""
    plt.rcParams.update(LOOK)


@main.command()
@BAGS
@OUT
def records(bags: tuple[Path, ...], out: Path) -> None:
    """Draw the position of an open and of a closed loop."""
    axes = new()
    looks = (("open loop", "--", "#444444"), ("closed loop", "-", "#0072b2"))
    for bag, (name, style, color) in zip(bags, looks, strict=True):
        record = read_bag(bag)
        shown = slice(0, round(SHOWN_S / record.dt_s), EVERY)
        time_s = record.dt_s * np.arange(len(record))
        label = f"{name}, {bag.name}"
        axes.plot(time_s[shown], record.y[shown, 0], style, color=color, label=label)
    axes.set(xlabel="time, s", ylabel="position, V", xlim=(0.0, SHOWN_S))
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    save(axes, out)


@main.command()
@BAGS
@OUT
def stabilisation(bags: tuple[Path, ...], out: Path) -> None:
    """Draw the modes over the order."""
    axes = identify(preprocess(read_bag(*bags))).plot_stabilisation(new())
    axes.set_xlim(0.0, BANDS_HZ)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    save(axes, out)


@main.command()
@BAGS
@OUT
def steps(bags: tuple[Path, ...], out: Path) -> None:
    """Draw the steps of three controllers."""
    axes = new()
    looks = (("tuned", "#0072b2"), ("defaults", "#b35900"), ("no compensation", "#777777"))
    for bag, (name, color) in zip(bags, looks, strict=True):
        run = read_bag(bag)
        start = 0 if run.reference is None else int(np.argmax(run.reference > 0.0))
        shown = slice(start, start + round(STEP_S / run.dt_s), EVERY)
        time_s = run.dt_s * (np.arange(len(run)) - start)
        axes.plot(time_s[shown], run.y[shown, 0], color=color, label=name)
    axes.axhline(3.0, color="black", linestyle="--", linewidth=0.8)
    axes.set(xlabel="time, s", ylabel="position, V", xlim=(0.0, STEP_S), ylim=(0.0, 3.5))
    axes.legend(loc="lower right")
    save(axes, out)


if __name__ == "__main__":
    main()
