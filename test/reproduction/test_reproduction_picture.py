from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib as mpl
from matplotlib.axes import Axes

from reproduction.framework.picture import STYLE, figure_of, inline_svg

if TYPE_CHECKING:
    import pytest
    from matplotlib.backend_bases import RendererBase


def test_inline_svg___figure___is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[str] = []
    draw = Axes.draw

    def counted(axes: Axes, renderer: RendererBase) -> None:
        drawn.append(axes.get_ylabel())
        draw(axes, renderer)

    monkeypatch.setattr(Axes, "draw", counted)
    with mpl.rc_context(STYLE):
        figure = figure_of(2.0)
        figure.subplots().set_ylabel("current, A")
        inline_svg(figure, "words")
    assert drawn == ["current, A"]


def test_inline_svg___ticks_wider_than_measured___is_not_cut() -> None:
    with mpl.rc_context(STYLE):
        figure = figure_of(3.0)
        axes = figure.subplots()
        axes.set_ylabel("words")
        higher = axes.get_window_extent().height
        # The layout makes the axes lower for the label below.
        axes.set_xlabel("three\nlines of\nwords")
        axes.yaxis.set_major_formatter(
            lambda value, _: f"{value:.{1 if axes.get_window_extent().height >= higher else 15}f}"
        )
        inline_svg(figure, "words")
    assert axes.yaxis.label.get_window_extent().x0 >= 0.0
