"""Moving picture of the live page, from a real run: `up` with the simulated arm, in Chromium.

A hand moves the arm by its picture and changes its payload, twice the same way: the second time is
filmed, so that the film ends as it begins. While it is filmed the arm's time runs more slowly than
the clock, and every frame is there on a busy machine too; the film shows the arm at its own pace.
"""

from __future__ import annotations

import base64
import json
import math
import signal
import sys
import tempfile
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click
from PIL import Image

from bench.live import pointer
from bench.live.film import FilmError, Shot, encoded, frames_of
from bench.live.pointer import Place
from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import FORCE
from flexarm_core.errors import FlexarmError
from flexarm_core.outputs import require_place

_ROOT = Path(__file__).parents[2]
# Browser and graph are those of the tests.
sys.path.insert(0, str(_ROOT / "test"))

from support.browser import CHROMIUM, Browser  # noqa: E402
from support.system_graph import Graph  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Sequence

LENGTH_S = 10.0
RATE_HZ = 15.0
LAW = "planned"
MOST_BYTES = 2_000_000
_WINDOW = (1200, 850)
_WIDTH = 900
_GRIP = 0.8
"""Where the hand holds the arm, in parts of its length."""


class _Hand(NamedTuple):
    """Place of the hand: an angle of the arm, or else a control by its selector."""

    time_s: float
    on: float | str
    pressed: bool = False


_LEFT, _MIDDLE, _RIGHT = 35.0, -5.0, -25.0
_HEAVY, _BARE = "#payloads button:nth-child(5)", "#payloads button:nth-child(1)"
BEFORE = (
    _Hand(-4.0, 0.0),
    _Hand(-3.5, 0.0, pressed=True),
    _Hand(-3.0, _RIGHT, pressed=True),
    _Hand(-2.8, _RIGHT),
)
"""How the hand takes the arm to where it begins."""
HAND = (
    _Hand(0.0, _RIGHT),
    _Hand(0.5, _RIGHT, pressed=True),
    _Hand(0.8, _LEFT, pressed=True),
    _Hand(1.0, _LEFT),
    _Hand(1.5, _LEFT),
    _Hand(2.3, _HEAVY, pressed=True),
    _Hand(2.5, _HEAVY),
    _Hand(2.7, _HEAVY),
    _Hand(3.4, _LEFT),
    _Hand(3.5, _LEFT, pressed=True),
    _Hand(3.8, _MIDDLE, pressed=True),
    _Hand(4.0, _MIDDLE),
    _Hand(5.6, _MIDDLE, pressed=True),
    _Hand(5.8, _LEFT, pressed=True),
    _Hand(6.0, _LEFT),
    _Hand(6.4, _LEFT),
    _Hand(7.2, _BARE, pressed=True),
    _Hand(7.4, _BARE),
    _Hand(7.5, _BARE),
    _Hand(8.1, _LEFT),
    _Hand(8.2, _LEFT, pressed=True),
    _Hand(8.5, _RIGHT, pressed=True),
    _Hand(8.7, _RIGHT),
    _Hand(LENGTH_S, _RIGHT),
)
"""What the hand does; it ends where it began."""


@click.command()
@click.option(
    "-o",
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    default=Path("out/page.webp"),
    show_default=True,
    help="File of the animated WebP.",
)
@click.option(
    "--pace",
    type=click.FloatRange(0.01, 1.0),
    default=0.25,
    show_default=True,
    help="Arm's time over that of the clock while it is filmed.",
)
@FORCE
def main(*, out: Path, pace: float, force: bool) -> None:
    """Run the arm with its page, film it and write an animated WebP of at most 2 MB."""
    try:
        require_place([out], force=force)
        if CHROMIUM is None:
            raise FilmError("no Chromium on PATH: the page is filmed in it")
        frames = frames_of(filmed(pace), LENGTH_S, RATE_HZ)
        file, colours = encoded(list(map(_picture, frames)), RATE_HZ, MOST_BYTES)
    except FlexarmError as error:
        raise click.ClickException(str(error)) from None
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(file)
    terminal.CONSOLE.print(f"{out}: {len(frames)} frames, {len(file)} bytes, {colours} colours")


def filmed(pace: float) -> list[Shot]:
    """Run a laboratory at a pace, and return the shots of its page."""
    with tempfile.TemporaryDirectory() as name, Graph(Path(name)) as graph, Browser() as browser:
        slow = {"/**": {"daq": {"ros__parameters": {"real_time_factor": pace}}}}
        file = Path(name, "slow.yaml")
        file.write_text(json.dumps(slow), "utf-8")
        up = graph.run([str(_ROOT / "flexarm"), "up", "--law", LAW, "--params-file", str(file)])
        up.wait_for("#token=")
        address = next(line for line in up.printed.splitlines() if line.startswith("http"))
        _open(browser, address)
        shots = _shots(browser, _path(browser))
        up.send(signal.SIGINT)
        if up.exit_code():
            raise FilmError(f"up did not end well, it printed: {up.printed}")
    return shots


def _open(browser: Browser, address: str) -> None:
    width, height = _WINDOW
    browser.open(address, width=width, height=height)
    browser.call(
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=height,
        deviceScaleFactor=_WIDTH / width,
        mobile=False,
    )
    browser.call("Emulation.setScrollbarsHidden", hidden=True)
    browser.wait_for("document.getElementById('arm').dataset.timeS !== undefined")


def _path(browser: Browser) -> list[Place]:
    """Return the way of the hand in the window, twice: the second time begins at 0."""
    points = {hand.on: _point(browser, hand.on) for hand in (*BEFORE, *HAND)}
    before, once = (
        [Place(hand.time_s, *points[hand.on], hand.pressed) for hand in hands]
        for hands in (BEFORE, HAND)
    )
    earlier = [place._replace(time_s=place.time_s - LENGTH_S) for place in before + once[:-1]]
    return earlier + once


def _point(browser: Browser, on: float | str) -> tuple[float, float]:
    """Return the point of the window at an angle of the arm, or on a control."""
    if isinstance(on, str):
        find = f"""const box = document.querySelector("{on}").getBoundingClientRect();
        return [box.x + box.width / 2, box.y + 0.6 * box.height];"""
    else:
        x, y = (-_GRIP * turn(math.radians(on)) for turn in (math.sin, math.cos))
        find = f"""const toWindow = document.getElementById("arm").getScreenCTM();
        const at = new DOMPoint({x}, {y}).matrixTransform(toWindow);
        return [at.x, at.y];"""
    right, down = browser.ask(f"(() => {{ {find} }})()")
    return right, down


def _arm_s(browser: Browser) -> float:
    """Return the time of the sample that the page shows."""
    return float(browser.ask("document.getElementById('arm').dataset.timeS"))


def _shots(browser: Browser, path: Sequence[Place]) -> list[Shot]:
    """Move the hand along its path, and return the shots from 0 on."""
    start_s = _arm_s(browser) - path[0].time_s

    def now_s() -> float:
        return _arm_s(browser) - start_s

    shots: list[Shot] = []
    last_s, pressed = path[0].time_s, False
    while last_s < LENGTH_S:
        time_s = now_s()
        for place in pointer.turns(path, last_s, time_s):
            pressed = place.pressed
            browser.mouse("mouseMoved", place.x, place.y)
            browser.mouse("mousePressed" if pressed else "mouseReleased", place.x, place.y)
        x, y = pointer.at(path, time_s)
        browser.mouse("mouseMoved", x, y)
        if time_s > -1.0:
            began_s = now_s()
            shot = browser.call("Page.captureScreenshot", optimizeForSpeed=True)
            png = base64.b64decode(shot["data"])
            shots.append(Shot((began_s + now_s()) / 2, png, (x, y), pressed))
        last_s = time_s
    return shots


def _picture(shot: Shot) -> Image.Image:
    """Return a shot with its pointer."""
    picture = Image.open(BytesIO(shot.png)).convert("RGB")
    x, y = (_WIDTH / _WINDOW[0] * side for side in shot.pointer)
    return pointer.drawn(picture, x, y, pressed=shot.pressed)


if __name__ == "__main__":
    main()
