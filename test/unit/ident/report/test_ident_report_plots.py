from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import control
import numpy as np
import pytest

from flexarm_core.labels import axis_label, label_and_unit
from flexarm_ident.models.modes import ModeUncertainty, frequency_grid, ranked_modes
from flexarm_ident.report.plots.frequency_plot import frequency_plot
from flexarm_ident.report.plots.marks import HEIGHT, WIDTH, Axis, SecondUnit, between, dots, line
from flexarm_ident.report.plots.order_plots import cost_plot, singular_value_plot
from flexarm_ident.report.plots.time_plots import (
    ARM_UNITS,
    Match,
    input_plot,
    liveliest,
    match_plot,
    near_plot,
)
from flexarm_ident.report.sections.frequency import (
    settling_samples,
    step_response,
    step_response_plot,
)
from flexarm_ident.report.sections.poles import damping_plot, pole_plot, pole_zero_plot
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step
from support.step_plots import a_step, times

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.models.modes import Mode

KNOWN_HZ = (9.4, 24.1, 45.6)


def mode_list() -> list[Mode]:
    """Return the modes of the arm model, every other one left out."""
    found = ranked_modes(arm_model(), [record(arm_model(), 300, 1)], np.ones(4))
    return [replace(mode, kept=i % 2 == 0) for i, mode in enumerate(found)]


def test_pole_plot___one_mode_more___has_its_mark_above_and_below_the_axis() -> None:
    modes = mode_list()
    assert pole_plot(modes, DT_S).count("h0") == pole_plot(modes[1:], DT_S).count("h0") + 2


def test_pole_plot___mode_that_grows___counts_it() -> None:
    outside = replace(mode_list()[0], eigenvalue=1.3 + 0.2j)
    assert "0 not inside the unit circle" in pole_plot(mode_list(), DT_S)
    assert "1 not inside the unit circle" in pole_plot([outside, *mode_list()[1:]], DT_S)


def test_step_response___first_order___is_its_closed_form() -> None:
    pole, gain = 0.9, 3.0
    model = control.StateSpace([[pole]], [[gain * (1.0 - pole)]], [[1.0]], [[0.0]], DT_S)
    expected = gain * (1.0 - pole ** np.arange(50))
    np.testing.assert_allclose(step_response(model, 0, 0, 50), expected, rtol=1e-12)


def test_settling_samples___pair_and_slower_real_pole___are_those_of_the_pair() -> None:
    pair, slow = replace(mode_list()[0], states=(0, 1)), replace(mode_list()[0], states=(2,))
    modes = [
        replace(pair, eigenvalue=0.98 * np.exp(0.3j)),
        replace(slow, eigenvalue=0.999),
    ]
    samples = settling_samples(modes, DT_S)
    assert 0.98**samples == pytest.approx(np.exp(-4.0), rel=0.03)
    assert settling_samples(modes[1:], DT_S) > samples


def test_step_response_plot___output_and_input___names_both_units() -> None:
    plot = step_response_plot({"full": arm_model()}, 0, 0, 50, names=("position_v", "command_v"))
    assert "position, V/V" in plot
    assert "position after a unit step of command" in plot


def area_extents(plot: str) -> list[FloatArray]:
    """Return the extents of each area over the width and the height of its plot, as parts."""
    found = []
    for path in re.findall(r'<path class="band m[^>]* d="([^"]+)"', plot):
        start, rest = path.rstrip("z")[1:].split("l")
        steps = np.array([start.split(), *np.array(rest.split()).reshape(-1, 2)], dtype=float)
        places = np.cumsum(steps, axis=0) / (WIDTH, HEIGHT)
        found.append(np.stack([places.min(axis=0), places.max(axis=0)]))
    return found


def test_damping_plot___known_deviations___ellipses_hold_95_percent() -> None:
    modes = [replace(mode_list()[0], frequency_hz=hz) for hz in (10.0, 1000.0)]
    known = [ModeUncertainty(10.0, modes[0].damping_ratio, 0.5, 0.01)]
    (extent,) = area_extents(damping_plot(modes, known))
    # The radius that holds 95 % of a normal pair is 2.4477 deviations; the axis is two decades and
    # a twentieth of room at each end.
    expected = np.log10((10.0 + 2.4477 * 0.5) / (10.0 - 2.4477 * 0.5)) / 2.2
    assert extent[1, 0] - extent[0, 0] == pytest.approx(expected, rel=5e-3)


def test_pole_plot___mode_of_a_known_deviation___ellipse_lies_around_it_and_its_conjugate() -> None:
    mode = next(each for each in mode_list() if each.frequency_hz > 0.0)
    known = ModeUncertainty(mode.frequency_hz, mode.damping_ratio, 0.5, 0.01)
    extents = area_extents(pole_plot([mode], DT_S, [known]))
    assert len(extents) == 2
    reach = 1.3 * max(1.0, abs(mode.eigenvalue))
    for extent, z in zip(extents, (mode.eigenvalue, np.conj(mode.eigenvalue)), strict=True):
        place = np.array([z.real + reach, reach - z.imag]) / (2.0 * reach)
        assert np.all(extent[0] < place)
        assert np.all(place < extent[1])


def test_pole_zero_plot___zero_far_outside___leaves_the_circle_its_size() -> None:
    poles, near, far = np.array([0.5 + 0j]), np.array([-0.3 + 0j]), np.array([-9.0 + 0j])
    plots = [pole_zero_plot(poles, zeros, DT_S) for zeros in (near, far)]
    assert all('data-x="-1.3 1.3"' in plot for plot in plots)
    # Each dot stands where its value is, the far one outside.
    assert f"M{WIDTH * (0.5 + 1.3) / 2.6:.0f} {HEIGHT // 2}h0" in plots[0]
    assert f"M{WIDTH * (-0.3 + 1.3) / 2.6:.0f} {HEIGHT // 2}h0" in plots[0]
    assert re.search(rf"M-\d+ {HEIGHT // 2}h0", plots[1])


def texts(plot: str) -> set[str]:
    root = ET.fromstring(plot)  # noqa: S314 (own text)
    return {words for node in root.iter() for words in (node.text, node.tail) if words}


def path_of(plot: str, look: str, view: int = 0) -> str:
    """Return the path of a look in one of the views."""
    views = [node for node in ET.fromstring(plot).iter() if node.get("role") == "group"]  # noqa: S314
    found = [node for node in views[view].iter("path") if look in (node.get("class") or "").split()]
    return str(found[0].get("d"))


def points_of(path: str) -> NDArray[np.int64]:
    """Return the points of a path, (points, 2), by following its differences."""
    found: list[tuple[int, int]] = []
    for command, given in re.findall("([Ml])([^A-Za-z]*)", path):
        numbers = [int(each) for each in re.findall(r"-?\d+", given)]
        for x, y in zip(numbers[::2], numbers[1::2], strict=True):
            before = (0, 0) if command == "M" else found[-1]
            found.append((before[0] + x, before[1] + y))
    return np.array(found)


def test_line___values___stand_at_their_places() -> None:
    x, y = Axis("x", 0.0, 4.0), Axis("y", -1.0, 1.0, log=True)
    curve = line([0.0, 1.0, 2.0, 4.0], [0.1, 1.0, np.nan, 10.0], "solid")
    assert curve.path(x, y) == f"M0 {HEIGHT}l2500 -1000M{WIDTH} 0h0"
    assert dots([4.0], [0.0], "dot").path(x, y) == ""
    area = between([0.0, 4.0], 0.1, 10.0, "shade").path(x, y)
    corners = [[0, HEIGHT], [WIDTH, HEIGHT], [WIDTH, 0], [0, 0]]
    assert points_of(area).tolist() == corners
    assert area.endswith("z")


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        (Axis("", 0.0, 40.0, ticks=4), {0.0: "0", 0.25: "10", 0.5: "20", 0.75: "30", 1.0: "40"}),
        (Axis("", -1.0, 1.0, ticks=2), {0.0: "\u22121", 0.5: "0", 1.0: "1"}),
        (Axis("", -200.0, 200.0, step=180.0), {0.05: "\u2212180", 0.5: "0", 0.95: "180"}),
        (
            Axis("", -1.0, 3.0, log=True),
            {0.0: "0.1", 0.25: "1", 0.5: "10", 0.75: "100", 1.0: "1000"},
        ),
    ],
)
def test_axis___range___has_round_ticks(axis: Axis, expected: dict[float, str]) -> None:
    assert [text for _, text in axis.marks()] == list(expected.values())
    assert [place for place, _ in axis.marks()] == pytest.approx(list(expected), abs=1e-12)


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (2.8, 19.0, ["3", "5", "7", "10"]),
        (0.5, 40.0, ["0.5", "0.7", "1", "2", "3", "5", "7", "10", "20", "30"]),
        (0.4, 90.0, ["0.5", "1", "2", "5", "10", "20", "50"]),
        (0.1, 150.0, ["0.1", "1", "10", "100"]),
        (9.0, 9.9, ["9", "9.2", "9.4", "9.6", "9.8"]),
    ],
)
def test_axis___logarithmic___has_ticks_near_its_ends(
    low: float, high: float, expected: list[str]
) -> None:
    axis = Axis("", float(np.log10(low)), float(np.log10(high)), log=True)
    places, words = zip(*axis.marks(), strict=True)
    assert list(words) == expected
    values = [float(each) for each in words]
    assert places == pytest.approx(np.log(np.divide(values, low)) / np.log(high / low), abs=1e-9)


def test_axis___second_unit___has_its_own_ticks_at_the_same_values() -> None:
    axis = Axis("position, V", -3.0, 3.0, second=SecondUnit("deg", 35.0 / 3.0))
    marks = axis.second_marks()
    assert [text for _, text in marks] == ["\u221220", "0", "20"]
    assert marks[-1][0] == pytest.approx((20.0 * 3.0 / 35.0 + 3.0) / 6.0)


def test_arm_units___position_and_speed___are_those_of_the_thesis() -> None:
    names = ("position_v", "speed_v", "base_strain_v")
    units, per_volt = zip(*(ARM_UNITS[name] for name in names), strict=True)
    assert units == ("deg", "deg/s", "N m")
    assert per_volt[:2] == pytest.approx((35.0 / 3.0, 180.0 / np.pi / 0.2014))


def test_liveliest___one_transition___is_inside() -> None:
    y = np.zeros((4000, 2))
    y[2500:, 0] = 3.0
    part = liveliest(y, 300)
    assert part.start < 2500 < part.stop
    assert part.stop - part.start == 300
    assert liveliest(y, 5000) == slice(0, 4000)


@pytest.mark.parametrize(
    ("draw", "expected"),
    [
        (
            a_step,
            {
                "position",
                "set-point",
                "base strain",
                "middle strain",
                "strain, V",
                "deg/s",
                "command, V",
            },
        ),
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
                {"full": arm_model(), "reduced": arm_model()},
                3,
                frequencies_hz=frequency_grid(arm_model(), 0.1),
                known_modes_hz=KNOWN_HZ,
            ),
            {"full", "reduced", "known modes", "gain, dB (V/V)", "10"},
        ),
        (
            lambda: frequency_plot(
                {"full, 5 states": random_model(1)},
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
    plot = draw()
    views = [node for node in ET.fromstring(plot).iter() if node.get("role") == "group"]  # noqa: S314
    assert views
    assert all(view.get("aria-label") for view in views)
    assert expected <= texts(plot)


def classes(plot: str, kind: str) -> list[str]:
    """Return the classes of all elements of a kind."""
    nodes = ET.fromstring(plot).iter()  # noqa: S314 (own text)
    return [name for node in nodes if kind in (name := node.get("class") or "").split()]


def test_step_plot___panels_with_and_without_degrees___are_as_wide() -> None:
    areas = classes(a_step(), "area")
    assert len(areas) == 4
    assert len(set(areas)) == 1
    without = input_plot(times(300), np.sin(times(300)), "current_a")
    assert classes(without, "area") != areas[:1]


def legends(plot: str) -> dict[str, list[str]]:
    """Return the entries of the legend above all panels, and of those beside the axes' names."""
    found: dict[str, list[str]] = {}
    for node in ET.fromstring(plot).iter():  # noqa: S314 (own text)
        keys = node.find("*[@class='keys']")
        if keys is not None:
            found[node.findtext("span") or ""] = ["".join(each.itertext()) for each in keys]
    return found


def test_step_plot___legends___stand_at_their_panels() -> None:
    assert legends(a_step()) == {
        "position, V": ["position", "set-point"],
        "strain, V": ["base strain", "middle strain"],
    }


def test_frequency_plot___curves_of_both_panels___have_one_legend() -> None:
    found = frequency_plot(
        {"full": arm_model(), "reduced": arm_model()},
        3,
        frequencies_hz=frequency_grid(arm_model(), 0.1),
        deviation=np.ones(len(frequency_grid(arm_model(), 0.1))),
    )
    assert legends(found) == {"": ["full", "reduced"], "gain, dB (V/V)": ["±2 standard deviations"]}


def match(y: FloatArray, simulated: FloatArray, name: str = "position_v") -> Match:
    return Match(name, times(len(y)), y, simulated)


def test_match_plot___long_record___keeps_every_peak_with_few_points() -> None:
    measured = np.zeros(100_000)
    measured[77_777] = 1.0
    near = slice(77_700, 78_000)
    plot = match_plot(match(measured, 0.0 * measured), fitted_s=10.0, near=near)
    whole, part = (points_of(path_of(plot, "solid", view)) for view in (0, 1))
    assert len(whole) <= 2000
    assert whole[:, 1].min() == part[:, 1].min()
    # With 5 % of room above.
    assert part[:, 1].min() == pytest.approx(HEIGHT * 0.05 / 1.1, abs=1.0)
    assert part[part[:, 1].argmin(), 0] == pytest.approx(WIDTH * 77.0 / 300.0, abs=1.0)
    alone = near_plot(match(measured, 0.0 * measured), near)
    assert path_of(alone, "solid") == path_of(plot, "solid", 1)


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
    near = slice(0, 300)
    whole = match_plot(match(y, y), fitted_s=0.5, near=near, points=400)
    y = y.copy()
    y[1000:1400] = y[3000:3010] = np.nan
    plot = match_plot(match(y, np.zeros(5000)), fitted_s=0.5, near=near, points=400)
    assert "holes" in texts(plot)
    assert "holes" not in texts(whole)
    assert "nan" not in plot
    first, second = points_of(path_of(plot, "solid")), points_of(path_of(whole, "solid"))
    inside = np.abs(first[:, 0] - 0.24 * WIDTH) < 0.035 * WIDTH
    assert not inside.any()
    assert (np.abs(second[:, 0] - 0.24 * WIDTH) < 0.035 * WIDTH).any()
    hole = path_of(plot, "hole")
    assert hole.startswith(f"M{WIDTH * 1000 // 5000} {HEIGHT}")


def test_match_plot___one_output___names_channel_and_unit() -> None:
    u = square_wave(400, 1)
    y = step_by_step(arm_model(), u)[:, 0]
    plot = match_plot(match(y, y), fitted_s=0.5, near=slice(0, 100))
    assert {"position, V", "time, s", "measured", "simulated", "fitted part"} <= texts(plot)
