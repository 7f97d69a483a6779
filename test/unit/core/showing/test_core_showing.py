"""What results show of themselves: tables in HTML and panels over time."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot as plt

from flexarm_core.showing.tables import html_table
from flexarm_core.showing.traces import Panel, plot_traces


def test_html_table___words_with_marks___are_text() -> None:
    table = html_table("a < b", ("name", "<i>"), [("R&D", "1"), ("x", "2")])
    root = ET.fromstring(table)  # noqa: S314 - our own text
    assert root.findtext("caption") == "a < b"
    assert [each.text for each in root.iter("th")] == ["name", "<i>", "R&D", "x"]
    assert [each.text for each in root.iter("td")] == ["1", "2"]


def test_plot_traces___panels___share_the_time_and_have_their_curves() -> None:
    time_s = np.arange(4.0)
    gap = np.array([0.0, np.nan, 2.0, 3.0])
    panels = [Panel("angle, deg", [("measured", gap), ("simulated", time_s)]), Panel("u, V", [])]
    with mpl.rc_context({"backend": "agg"}):
        axes = plot_traces(time_s, panels)
        lines = axes[0].get_lines()
        assert [line.get_label() for line in lines] == ["measured", "simulated"]
        assert lines[0].get_ydata() == pytest.approx(gap, nan_ok=True)
        assert lines[0].get_linestyle() != lines[1].get_linestyle()
        assert [each.get_ylabel() for each in axes] == ["angle, deg", "u, V"]
        assert axes[0].get_shared_x_axes().joined(*axes)
        assert axes[1].get_legend() is None
        plt.close(axes[0].figure)
