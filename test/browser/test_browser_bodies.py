"""The 3D view of the page: bodies of a rig that knows them, turned by hand."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest

from support.browser import wait_until
from support.foreign_rigs import ONE_JOINT
from support.live_mock import LiveMock
from support.live_page import opened

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.browser import Browser

WORLD = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
RED, BLUE = [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]
# Middle of all pixels in which one of red, green, blue stands out, in parts of the half width.
MIDDLE = """(() => {{
  const canvas = document.getElementById("bodies");
  const {{ width, height }} = canvas;
  const {{ data }} = canvas.getContext("2d").getImageData(0, 0, width, height);
  let [count, x, y] = [0, 0, 0];
  for (let k = 0; k < data.length; k += 4) {{
    if (data[k + 3] < 200 || data[k + {channel}] < 100 || data[k + {other}] > 50) continue;
    const at = (k / 4) % width;
    [count, x, y] = [count + 1, x + at, y + (k / 4 - at) / width];
  }}
  return [count, (2 * x / count - width) / width, (height - 2 * y / count) / width];
}})()"""


def solid(body: int, rgba: list[float], kind: str = "box") -> dict[str, object]:
    """Return a link of 1 m from its joint on, thin, or another solid in its place."""
    place = {"place_m": [0.5, 0.0, 0.0], "turn": [1.0, 0.0, 0.0, 0.0]}
    return {"body": body, "kind": kind, "size_m": [0.5, 0.02, 0.05], "rgba": rgba, **place}


def turned(deg: float, x: float = 0.0, y: float = 0.0) -> list[float]:
    """Return the pose of a body that has turned about the vertical."""
    half_rad = 0.5 * math.radians(deg)
    return [x, y, 0.0, math.cos(half_rad), 0.0, 0.0, math.sin(half_rad)]


@pytest.fixture
def mock() -> Iterator[LiveMock]:
    with LiveMock(rig=ONE_JOINT) as served:
        served.solids = [solid(1, RED)]
        served.poses = [WORLD, turned(0.0)]
        yield served


def seen(browser: Browser, colour: list[float]) -> tuple[int, float, float]:
    """Return how many pixels a solid has and where it is, to the right and up from the joint."""
    channel = colour.index(1.0)
    count, right, up = browser.ask(MIDDLE.format(channel=channel, other=2 - channel))
    return count, right or 0.0, up or 0.0


def is_at(browser: Browser, right: float, up: float) -> bool:
    count, *found = seen(browser, RED)
    return count > 0 and math.dist(found, (right, up)) < 0.05


def away(browser: Browser) -> float:
    """Return how far up a link is drawn that points away."""
    wait_until(lambda: seen(browser, RED)[2] > 0.1, "a link that points away")
    return seen(browser, RED)[2]


def test_bodies___move___as_their_poses_say(browser: Browser, mock: LiveMock) -> None:
    opened(browser, mock)
    # Seen from 35 degrees, what is beside the joint looks longer than what is behind it.
    half = away(browser) / math.sin(math.radians(35.0))
    for deg, side in ((90.0, -half), (-90.0, half)):
        mock.poses = [WORLD, turned(deg)]
        wait_until(lambda side=side: is_at(browser, side, 0.0), f"the link at {deg} deg")
    # That the test reads the picture is for the test alone.
    assert [line for line in browser.console if "getImageData" not in line] == []


def test_view___by_a_drag_and_by_keys___turns(browser: Browser, mock: LiveMock) -> None:
    opened(browser, mock)
    up = away(browser)
    half = up / math.sin(math.radians(35.0))
    x, y = browser.ask(
        """(() => { const node = document.getElementById("bodies");
        node.scrollIntoView({ block: "center", behavior: "instant" });
        const box = node.getBoundingClientRect();
        return [box.x + box.width / 2, box.y + box.height / 2]; })()"""
    )
    browser.mouse("mousePressed", x, y)
    # Half a degree a pixel: a quarter turn. It leaves the drawing, which holds the pointer.
    for step in range(1, 19):
        browser.mouse("mouseMoved", x + 10.0 * step, y)
    browser.mouse("mouseReleased", x + 180.0, y)
    # What is in front of the joint goes with the hand, and what is behind it the other way.
    wait_until(lambda: is_at(browser, -half, 0.0), "a quarter turn by hand")
    browser.ask("document.getElementById('bodies').focus()")
    for _ in range(18):
        browser.press("ArrowLeft")
    wait_until(lambda: is_at(browser, 0.0, up), "back by keys")


def test_body___in_front_of_another___hides_it(browser: Browser, mock: LiveMock) -> None:
    mock.solids = [solid(1, BLUE), solid(2, RED)]
    for nearer, hidden in ((RED, BLUE), (BLUE, RED)):
        # The second link is beside the first one, nearer to the viewer or behind it.
        mock.poses = [WORLD, turned(90.0), turned(90.0, x=-0.3 if nearer == RED else 0.3)]
        opened(browser, mock)
        browser.ask("document.getElementById('bodies').focus()")
        for _ in range(7):
            browser.press("ArrowDown")
        wait_until(lambda colour=nearer: seen(browser, colour)[0] > 0, "the nearer link")
        assert seen(browser, hidden)[0] == 0


def test_arm_without_bodies___has_no_3d_view(browser: Browser) -> None:
    with LiveMock(rig=ONE_JOINT) as mock:
        opened(browser, mock)
        assert not browser.ask("document.getElementById('bodies').checkVisibility()")


@pytest.mark.parametrize("width", [1400, 400])
def test_page_with_bodies___fits(browser: Browser, mock: LiveMock, width: int) -> None:
    opened(browser, mock, width=width)
    away(browser)
    assert browser.ask("document.documentElement.scrollWidth") <= width
    for name in ("arm", "bodies"):
        box = f"document.getElementById('{name}').getBoundingClientRect()"
        assert browser.ask(f"{box}.width") > 250
        assert browser.ask(f"{box}.height") > 150
