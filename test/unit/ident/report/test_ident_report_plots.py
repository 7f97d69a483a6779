from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes

from flexarm_core.labels import axis_label, label_and_unit
from flexarm_ident.models.modes import ranked_modes
from flexarm_ident.report.plots.frequency_plot import frequency_grid, frequency_plot
from flexarm_ident.report.plots.order_plots import cost_plot, singular_value_plot
from flexarm_ident.report.plots.pole_plots import damping_plot, pole_plot
from flexarm_ident.report.plots.style import STYLE, figure_of, inline_svg
from flexarm_ident.report.plots.time_plots import input_plot, match_plot
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step
from support.step_plots import a_step, times

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from matplotlib.backend_bases import RendererBase

    from flexarm_ident.models.modes import Mode

KNOWN_HZ = (9.4, 24.1, 45.6)


def mode_list() -> list[Mode]:
    """Return the modes of the arm model, every other one left out."""
    found = ranked_modes(arm_model(), [record(arm_model(), 300, 1)], np.ones(4))
    return [replace(mode, kept=i % 2 == 0) for i, mode in enumerate(found)]


def test_pole_plot___one_mode_more___has_its_mark_above_and_below_the_axis() -> None:
    modes = mode_list()
    assert pole_plot(modes, DT_S).count("<use") == pole_plot(modes[1:], DT_S).count("<use") + 2


def test_pole_plot___mode_that_grows___counts_it() -> None:
    outside = replace(mode_list()[0], eigenvalue=1.3 + 0.2j)
    assert "0 not inside the unit circle" in pole_plot(mode_list(), DT_S)
    assert "1 not inside the unit circle" in pole_plot([outside, *mode_list()[1:]], DT_S)


def test_plot___any___is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[str] = []
    draw = Axes.draw

    def counted(axes: Axes, renderer: RendererBase) -> None:
        drawn.append(axes.get_ylabel())
        draw(axes, renderer)

    monkeypatch.setattr(Axes, "draw", counted)
    input_plot(times(300), np.sin(times(300)), "current_a")
    assert drawn == ["current, A"]


def test_plot___ticks_wider_than_measured___is_not_cut() -> None:
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


def texts(svg: str) -> Sequence[str]:
    return ["".join(node.itertext()) for node in ET.fromstring(svg).iter() if "text" in node.tag]  # noqa: S314 (own text)


def curve_points(svg: str) -> int:
    paths: list[str] = re.findall(r' d="([^"]*)"', svg)
    return max(path.count("L") + path.count("M") for path in paths)


@pytest.mark.parametrize(
    ("draw", "expected"),
    [
        (a_step, {"position", "set-point", "base", "middle", "strain, V", "command, V"}),
        (
            lambda: input_plot(times(300), np.sin(times(300)), "current_a"),
            {"current, A", "time, s"},
        ),
        (
            lambda: pole_plot(mode_list(), DT_S),
            {"real part of z", "in the model", "left out", "75 Hz", "112.5 Hz"},
        ),
        (lambda: damping_plot(mode_list()), {"damping ratio", "frequency, Hz", "in the model"}),
        (
            lambda: cost_plot({"MRM, cut": [(2, 9.0), (4, 0.2)]}, full=0.1, order=4),
            {"MRM, cut", "full model", "order 4", "states kept"},
        ),
        (
            lambda: singular_value_plot(np.geomspace(1e3, 1e-9, 60), 12),
            {"order 12", "singular value"},
        ),
        (
            lambda: singular_value_plot(np.array([2.0, 1.0, 0.0]), 2),
            {"order 2", "used", "left out"},
        ),
        (
            lambda: frequency_plot(
                arm_model(),
                arm_model(),
                3,
                frequencies_hz=frequency_grid(arm_model(), 0.1),
                known_modes_hz=KNOWN_HZ,
            ),
            {"full, 9 states", "reduced, 9 states", "known modes", "gain, dB (V/V)", "10"},
        ),
        (
            lambda: frequency_plot(
                random_model(1),
                None,
                0,
                frequencies_hz=frequency_grid(random_model(1), 0.1),
            ),
            {"full, 5 states", "gain, dB", "phase, deg", "frequency, Hz"},
        ),
    ],
)
def test_plot___any___is_an_element_with_labels(
    draw: Callable[[], str], expected: set[str]
) -> None:
    svg = draw()
    root = ET.fromstring(svg)  # noqa: S314 (own text)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert root.attrib["role"] == "img"
    assert root.attrib["aria-label"]
    assert "width" not in root.attrib
    assert expected <= set(texts(svg))


def test_match_plot___long_record___keeps_every_peak_with_few_points() -> None:
    time_s = times(100_000)
    measured = np.zeros(100_000)
    measured[77_777] = 1.0
    svg = match_plot(time_s, measured, 0.0 * measured, "speed_v", fitted_s=10.0)
    assert curve_points(svg) <= 2000
    whole = match_plot(time_s[:3], measured[77_776:77_779], np.zeros(3), "speed_v", fitted_s=0.0)
    assert peak(svg) == pytest.approx(peak(whole), abs=0.02)


def peak(svg: str) -> float:
    """Return the height of the first clipped line, the measured one."""
    lines = re.findall(r'<path d="([^"]*)" clip-path[^>]*stroke: #56b4e9', svg)
    return min(float(y) for y in re.findall(r"[ML] [\d.-]+ ([\d.-]+)", lines[0]))


@pytest.mark.parametrize(
    ("name", "words", "unit"),
    [
        ("position_v", "position", "V"),
        ("base_strain_v", "base strain", "V"),
        ("elbow_deg", "elbow", "deg"),
        ("elbow_deg_s", "elbow", "deg/s"),
        ("motor_current_a", "motor current", "A"),
        ("torque_nm", "torque", "N m"),
        ("u0", "u0", ""),
        ("v", "v", ""),
        ("_v", "v", ""),
        ("plan_b", "plan b", ""),
    ],
)
def test_label_and_unit___name___is_split(name: str, words: str, unit: str) -> None:
    assert (label_and_unit(name)[0].strip(), label_and_unit(name)[1]) == (words, unit)
    assert axis_label(name).strip() == (f"{words}, {unit}" if unit else words)


def test_match_plot___holes___break_the_curve_and_are_marked() -> None:
    y = np.sin(np.arange(5000) / 50.0)
    whole = match_plot(times(5000), y, y, "position_v", fitted_s=0.5, points=400)
    y = y.copy()
    y[1000:1400] = y[3000:3010] = np.nan
    svg = match_plot(times(5000), y, np.zeros(5000), "position_v", fitted_s=0.5, points=400)
    assert "holes" in svg
    assert "holes" not in whole
    assert "nan" not in svg


def test_match_plot___one_output___names_channel_and_unit() -> None:
    u = square_wave(400, 1)
    y = step_by_step(arm_model(), u)[:, 0]
    svg = match_plot(times(400), y, y, "position_v", fitted_s=0.5)
    assert {"position, V", "time, s", "measured", "simulated", "fitted part"} <= set(texts(svg))
