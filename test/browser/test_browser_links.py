"""The page of arms that are not the thesis's: links, handles, set-points and traces."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from support.browser import wait_until
from support.foreign_rigs import CART, ONE_JOINT, TWO_JOINTS
from support.live_mock import LiveMock
from support.live_page import asked, opened

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.browser import Browser

COUNTS_PER_DEG = 4096.0 / 360.0
# Of the reach: the first link and what the last handle stands out.
SHOULDER, ELBOW, BEYOND = 4.0 / 7.0, 3.0 / 7.0, 0.06


@pytest.fixture
def two_joints() -> Iterator[LiveMock]:
    with LiveMock(rig=TWO_JOINTS) as served:
        yield served


def tip(browser: Browser) -> complex:
    """Return where the last link that is drawn ends, y ahead, by the matrix of the browser."""
    x, y = browser.ask(
        """(() => { const link = [...document.querySelectorAll("#arm .link")].at(-1);
        const frame = document.getElementById("arm").getScreenCTM().inverse();
        const end = new DOMPoint(0, link.y2.baseVal.value);
        const at = end.matrixTransform(frame.multiply(link.getScreenCTM()));
        return [at.x, at.y]; })()"""
    )
    return complex(x, -y)


def pointing(deg: float, length: float) -> complex:
    """Return a link that has turned counter-clockwise from straight ahead."""
    return length * complex(-math.sin(math.radians(deg)), math.cos(math.radians(deg)))


def test_links___are_drawn___each_turned_as_the_one_before_it(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    for shoulder_deg, elbow_rad in ((0.0, 0.0), (40.0, -1.2), (-75.0, 1.9)):
        two_joints.arm.fixed = (shoulder_deg * COUNTS_PER_DEG, elbow_rad, 0.0, 0.0, 0.0)
        wanted = pointing(shoulder_deg, SHOULDER)
        wanted += pointing(shoulder_deg + math.degrees(elbow_rad), ELBOW)
        wait_until(lambda end=wanted: abs(tip(browser) - end) < 0.01, f"tip at {wanted}")
    figures = "[...document.querySelectorAll('#arm_figures dd')].map((node) => node.textContent)"
    browser.wait_for(f"{figures}.join() === '\u221275.0°,0.0°,108.9°,0.0°'")


@pytest.mark.parametrize(
    ("place", "joint", "unit_deg"),
    [(0, "shoulder", 1.0 / COUNTS_PER_DEG), (1, "elbow", math.degrees(1.0))],
)
def test_handle___of_each_joint___sets_its_set_point_alone(
    browser: Browser, two_joints: LiveMock, place: int, joint: str, unit_deg: float
) -> None:
    opened(browser, two_joints)
    x, y, scale = browser.ask(
        """(() => { const matrix = document.getElementById("arm").getScreenCTM();
        return [matrix.e, matrix.f, matrix.a]; })()"""
    )

    def at(deg: float) -> tuple[float, float]:
        """Return the place of the handle on the screen, with the other joint straight ahead."""
        along = 0.6 * SHOULDER if place == 0 else ELBOW + BEYOND
        point = pointing(0.0, SHOULDER * place) + pointing(deg, along)
        return x + scale * point.real, y - scale * point.imag

    browser.mouse("mousePressed", *at(0.0))
    for deg in (-10.0, -25.0, -40.0):
        browser.mouse("mouseMoved", *at(deg))
    browser.mouse("mouseReleased", *at(-40.0))
    wait_until(lambda: two_joints.arm.references[place] * unit_deg == pytest.approx(-40.0, abs=1.0))
    assert two_joints.arm.references[1 - place] == 0.0
    assert {request["joint"] for request in asked(two_joints, "reference")} == {joint}


def test_handle___in_focus___moves_by_keys_and_says_its_value(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    elbow = "document.querySelector('#arm [aria-label=\"Set-point of elbow\"]')"
    browser.ask(f"{elbow}.focus()")
    for _ in range(3):
        browser.press("ArrowLeft")
    wait_until(lambda: two_joints.arm.references[1] == pytest.approx(math.radians(3.0)))
    browser.wait_for(f"{elbow}.getAttribute('aria-valuenow') === '3.000'")
    assert browser.ask(f"{elbow}.getAttribute('aria-valuetext')") == "3.0°"
    assert browser.ask(f"Number({elbow}.getAttribute('aria-valuemax'))") == pytest.approx(
        math.degrees(2.0), abs=1e-3
    )
    assert two_joints.arm.references[0] == 0.0


def test_set_point___that_nobody_gave___is_where_the_arm_is(
    browser: Browser, two_joints: LiveMock
) -> None:
    two_joints.arm.references = [math.nan, math.nan]
    two_joints.arm.fixed = (20.0 * COUNTS_PER_DEG, 0.5, 0.0, 0.0, 0.0)
    opened(browser, two_joints)
    browser.wait_for("document.getElementById('setpoint_value').value === '20.00'")
    browser.ask("document.querySelector('#arm .ghost').focus()")
    browser.press("ArrowLeft")
    wait_until(
        lambda: two_joints.arm.references[0] == pytest.approx(21.0 * COUNTS_PER_DEG, rel=1e-6)
    )


def test_set_points___by_their_fields___stay_within_the_travel_of_each(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    browser.ask(
        """for (const field of document.querySelectorAll("#setpoints [type=number]")) {
          field.value = "500";
          field.dispatchEvent(new Event("change"));
        }"""
    )
    wait_until(lambda: two_joints.arm.references == pytest.approx([1024.0, 2.0]))


def test_stop___of_another_arm___is_the_space_bar_and_is_released(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    browser.press("Space")
    browser.wait_for("document.getElementById('badge').dataset.state === 'HELD'")
    browser.click("#release")
    browser.wait_for("document.getElementById('badge').dataset.state === 'OFF'")
    browser.click("#activate")
    browser.wait_for("document.getElementById('badge').dataset.state === 'DRIVING'")


def test_traces___of_another_arm___have_a_plot_for_each_quantity_with_its_units(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    two_joints.arm.fixed = (512.0, 0.5, 0.0, 1.0, 300.0)
    titles = (
        "[...document.querySelectorAll('#traces figcaption b')].map((node) => node.textContent)"
    )
    plots = ["Angle, count", "Angle, rad", "Rate", "Acceleration", "Other"]
    assert browser.ask(titles) == [*plots, "Command, V", "Command, N m"]
    reading = "document.querySelector('#traces output').textContent"
    browser.wait_for(f"{reading} === '45.00°'")
    browser.press("u")
    browser.wait_for(f"{reading} === '512.00 count'")
    texts = browser.ask("document.getElementById('traces').textContent")
    assert "300.00 lux" in texts
    assert "set-point elbow rad" in texts


def test_parts_of_the_thesis___for_another_arm___are_hidden(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    hidden = ("enlarged", "simulated", "waveform", "tab_tune", "tip")
    visible = [
        name
        for name in hidden
        if browser.ask(f"document.getElementById('{name}')?.checkVisibility() ?? false")
    ]
    assert visible == []
    assert browser.ask("document.getElementById('arm_title').textContent") == "two-joints"
    assert browser.console == []
    assert asked(two_joints, "tune_line") == []


def test_record_of_another_arm___by_clicks___is_identified_in_its_own_units(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    browser.click("#record")
    browser.wait_for("document.getElementById('record').textContent === 'Stop recording'")
    browser.click("#record")
    browser.click("#identify")
    browser.wait_for("document.querySelector('#fits svg') !== null")
    labels = "[...document.querySelectorAll('#fits text.label')].map((node) => node.textContent)"
    assert "shoulder count, count" in browser.ask(labels)
    assert browser.console == []


def test_step___of_the_joint_that_was_chosen___is_drawn(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    browser.click("#tab_step")
    browser.ask(
        """(() => { const menu = document.getElementById("step_joint");
        menu.value = "1"; menu.dispatchEvent(new Event("change"));
        document.getElementById("step_seen").value = "0.5"; })()"""
    )
    browser.click("#step")
    browser.wait_for("document.querySelectorAll('#steps .curve').length === 1")
    assert two_joints.arm.references == pytest.approx([0.0, 0.2])
    command = browser.ask("document.getElementById('command_step').textContent")
    assert command == "./flexarm reference elbow 0.2"


def test_arm_of_one_joint___has_one_set_point_in_its_unit_and_stops(browser: Browser) -> None:
    with LiveMock(rig=ONE_JOINT) as mock:
        opened(browser, mock)
        browser.ask("document.querySelector('#arm .ghost').focus()")
        browser.press("ArrowLeft")
        wait_until(lambda: mock.arm.references == pytest.approx([1.0]))
        assert "joint" not in asked(mock, "reference")[0]
        assert browser.ask("document.querySelectorAll('#setpoints .slide').length") == 1
        browser.press("Space")
        browser.wait_for("document.getElementById('badge').dataset.state === 'HELD'")
        browser.click("#release")
        browser.wait_for("document.getElementById('badge').dataset.state === 'OFF'")


def test_cart___slides___to_where_its_handle_is_drawn(browser: Browser) -> None:
    with LiveMock(rig=CART) as mock:
        opened(browser, mock)
        x, y, scale = browser.ask(
            """(() => { const { x, y, width, height } =
              document.querySelector("#arm .ghost circle").getBoundingClientRect();
            return [x + width / 2, y + height / 2, document.getElementById("arm").getScreenCTM().a];
            })()"""
        )
        reach_m = 0.01 + 0.25
        browser.mouse("mousePressed", x, y)
        browser.mouse("mouseMoved", x - 0.1 / reach_m * scale, y)
        browser.mouse("mouseReleased", x - 0.1 / reach_m * scale, y)
        # Positive is left.
        wait_until(lambda: mock.arm.references == pytest.approx([100.0], abs=2.0))


def test_controls___of_another_arm___have_accessible_names(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints)
    roles = {"button", "textbox", "spinbutton", "slider", "combobox", "tab", "link"}
    nodes = browser.call("Accessibility.getFullAXTree")["nodes"]
    controls = [node for node in nodes if node.get("role", {}).get("value") in roles]
    assert [node for node in controls if not node.get("name", {}).get("value")] == []
    sliders = [node["name"]["value"] for node in controls if node["role"]["value"] == "slider"]
    assert sliders.count("Set-point of elbow") == 2


def test_page_of_two_joints___400_pixels_wide___fits(
    browser: Browser, two_joints: LiveMock
) -> None:
    opened(browser, two_joints, width=400)
    assert browser.ask("document.documentElement.scrollWidth") <= 400
