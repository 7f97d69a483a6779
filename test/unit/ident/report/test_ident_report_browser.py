"""A report of a real bag in a real browser: what it shows, and what it asks the network for."""

from __future__ import annotations

import html
import json
import re
import shutil
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_ident.job import report_bags
from flexarm_ident.workflow.request import Request
from support.project import BAGS

if TYPE_CHECKING:
    from pathlib import Path

BAG = BAGS / "c_dat3_0g"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next(filter(None, map(shutil.which, BROWSERS)), None)
# Told before the report is made, which takes long.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        BROWSER is None, reason=f"no browser: none of {', '.join(BROWSERS)} is installed"
    ),
]
DEADLINE_S = 90.0
WIDTH_PX = 400
SMALLEST_TEXT_PX = 11.0
LARGEST_BYTES = 1e6

# A window may not be narrower than 500 pixels, a frame may.
PROBE = """<!DOCTYPE html><html><head><link rel="icon" href="data:,"></head><body>
<iframe id="frame" style="width: 400px; height: 800px; border: 0" srcdoc="%s"></iframe>
<script>
const frame = document.getElementById("frame");
const shown = (node) => node.getClientRects().length > 0;
function texts(page) {
  const walker = page.createTreeWalker(page.body, NodeFilter.SHOW_TEXT);
  const found = [];
  while (walker.nextNode()) {
    const node = walker.currentNode, parent = node.parentElement;
    if (!node.data.trim() || !shown(parent)) continue;
    const size = parseFloat(page.defaultView.getComputedStyle(parent).fontSize);
    const matrix = parent.ownerSVGElement ? parent.getScreenCTM() : null;
    const scale = matrix ? Math.hypot(matrix.a, matrix.b) : 1;
    found.push({text: node.data.trim().slice(0, 40), px: size * scale});
  }
  return found;
}
function cutOff(view) {
  const box = view.closest("figure").getBoundingClientRect();
  return [...view.querySelectorAll("i, p")].filter((text) => {
    if (!text.textContent.trim() || !shown(text)) return false;
    const its = text.getBoundingClientRect();
    return its.left < box.left - 1 || its.right > box.right + 1
      || its.top < box.top - 1 || its.bottom > box.bottom + 1;
  }).map((text) => text.textContent);
}
function used(page) {
  const key = page.querySelector(".wide .keys input");
  if (!key) return null;
  const chart = key.closest(".chart"), view = chart.querySelector(".view");
  const area = view.querySelector(".area");
  const rect = area.getBoundingClientRect(), svg = area.querySelector("svg");
  const box = () => svg.getAttribute("viewBox");
  const send = (type, part) => area.dispatchEvent(new page.defaultView.PointerEvent(type, {
    bubbles: true, button: 0, clientX: rect.left + part * rect.width, clientY: rect.top + 5,
  }));
  // No real pointer is down.
  area.setPointerCapture = () => {};
  const found = {whole: box()};
  send("pointermove", 0.5);
  found.read = view.querySelector(".read").textContent;
  send("pointerdown", 0.25);
  send("pointermove", 0.75);
  send("pointerup", 0.75);
  found.zoomed = box();
  found.ticks = [...area.querySelectorAll("i.x")].map((tick) => tick.textContent);
  view.querySelector(".whole").click();
  found.again = box();
  const mark = chart.querySelector(".view ." + key.className.replace("k", "m"));
  const display = () => page.defaultView.getComputedStyle(mark).display;
  found.before = display();
  key.click();
  found.after = display();
  return found;
}
/** The bars of a mode shape: still, a quarter of a period on, and still again. */
function moved(page) {
  const shape = page.querySelector(".shape"), found = [];
  if (!shape) return found;
  const bars = shape.querySelector(".area .band");
  const play = shape.querySelector(".play"), path = () => bars.getAttribute("d");
  found.push(path());
  let draw = null;
  page.defaultView.requestAnimationFrame = (next) => { draw = next; return 1; };
  play.click();
  draw(500);
  found.push(path());
  play.click();
  return [...found, path()];
}
function measured(page) {
  const root = page.documentElement, all = (selector) => [...page.querySelectorAll(selector)];
  return {
    width: page.defaultView.innerWidth,
    scrollWidth: root.scrollWidth,
    texts: texts(page),
    headings: all("h2").map((node) => node.textContent),
    headers: Object.fromEntries(all("table").map(
      (node) => [node.className, [...node.tHead.rows[0].cells].map((cell) => cell.textContent)]
    )),
    plots: all("[role=group]").filter(shown).map((view) => ({
      label: view.getAttribute("aria-label") || "",
      caption: view.closest("figure").querySelector("figcaption")?.textContent || "",
      ratio: view.getBoundingClientRect().height / view.getBoundingClientRect().width,
      cutOff: cutOff(view),
    })),
    used: used(page),
    wide: all("main *").filter(
      (node) => !node.closest("svg, .scroll")
        && node.getBoundingClientRect().right > root.clientWidth + 1
    ).map((node) => node.outerHTML.slice(0, 80)),
    lost: all("nav a").filter((node) => !page.getElementById(node.hash.slice(1))).length,
    downloads: all("a[download]").map((node) => node.download),
    words: page.body.innerText,
  };
}
frame.addEventListener("load", () => {
  const page = frame.contentDocument, folded = page.documentElement.scrollHeight;
  page.querySelectorAll("details").forEach((each) => { each.open = true; });
  const figures = JSON.stringify({...measured(page), folded, shapes: moved(page)});
  frame.remove();
  const answer = document.createElement("pre");
  answer.id = "answer";
  answer.textContent = figures;
  document.body.append(answer);
});
</script></body></html>
"""
LEAK = '<img src="http://leak.example/pixel.png"><script>console.error("as a test")</script>'


@dataclass(frozen=True)
class Visit:
    """What a browser found: figures of the page, messages of its console, addresses it asked."""

    figures: dict[str, Any]
    console: list[str]
    requests: list[str]


def visit(text: str, folder: Path) -> Visit:
    assert BROWSER is not None
    page, log = folder / "page.html", folder / "net.json"
    page.write_text(PROBE.replace("%s", html.escape(text)), encoding="utf-8")
    command = [
        *(BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"),
        *(f"--user-data-dir={folder / 'profile'}", "--no-first-run", "--disable-extensions"),
        *("--disable-background-networking", "--host-resolver-rules=MAP * ~NOTFOUND"),
        *("--enable-logging=stderr", "--v=0", f"--log-net-log={log}"),
        *("--window-size=1000,900", "--dump-dom", page.as_uri()),
    ]
    done = subprocess.run(  # noqa: S603 - the browser of this machine
        command, capture_output=True, timeout=DEADLINE_S, check=True, cwd=folder
    )
    answer = re.search(r'<pre id="answer">(.*?)</pre>', done.stdout.decode(), re.DOTALL)
    assert answer is not None, done.stderr.decode()[-2000:]
    messages = re.findall(r":CONSOLE[^\]]*\] (.*)", done.stderr.decode(errors="replace"))
    return Visit(json.loads(html.unescape(answer[1])), messages, requests_of_pages(log))


def requests_of_pages(log: Path) -> list[str]:
    """Return the addresses that pages asked for; what the browser asks for itself has no origin."""
    events = json.loads(log.read_text("utf-8"))["events"]
    asked = [event.get("params", {}) for event in events]
    return [
        each["url"]
        for each in asked
        if each.get("initiator", "not an origin") != "not an origin" and "url" in each
    ]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("report") / "report.html"
    known_hz = (9.4, 24.1, 45.6)
    request = Request(
        order=14, reduction="mrmc", reduced_order=9, known_modes_hz=known_hz, update="b"
    )
    report_bags([BAG], file, request)
    return file


@pytest.fixture(scope="module")
def seen(report: Path, tmp_path_factory: pytest.TempPathFactory) -> Visit:
    return visit(report.read_text("utf-8"), tmp_path_factory.mktemp("browser"))


def test_report___in_a_browser___is_silent_and_asks_for_nothing(seen: Visit, report: Path) -> None:
    assert seen.console == []
    assert seen.requests == []
    assert report.stat().st_size < LARGEST_BYTES
    assert [each.name for each in report.parent.iterdir()] == ["report.html"]


def test_report___with_a_leak___is_caught(report: Path, tmp_path: Path) -> None:
    page = report.read_text("utf-8")
    head = re.sub(r"<meta http-equiv[^>]*>", "", page[: page.index("<section")])
    leaking = head + LEAK + "</main></body></html>"
    found = visit(leaking, tmp_path)
    assert "http://leak.example/pixel.png" in found.requests
    assert any("as a test" in message for message in found.console)


def test_report___at_400_pixels___does_not_scroll_sideways(seen: Visit) -> None:
    assert seen.figures["width"] == WIDTH_PX
    assert seen.figures["scrollWidth"] <= WIDTH_PX
    assert seen.figures["wide"] == []


def test_report___at_400_pixels___begins_folded_on_a_few_screens(seen: Visit) -> None:
    assert 1000 < seen.figures["folded"] <= 6000


def test_report___at_400_pixels___has_no_small_and_no_cut_text(seen: Visit) -> None:
    texts = seen.figures["texts"]
    assert len(texts) > 500
    small = [each for each in texts if each["px"] < SMALLEST_TEXT_PX]
    assert small == []
    assert {plot["label"]: plot["cutOff"] for plot in seen.figures["plots"] if plot["cutOff"]} == {}


def test_mode_shape___played___moves_its_bars_and_stands_still_again(seen: Visit) -> None:
    still, moving, again = seen.figures["shapes"]
    assert still == again != moving
    # Four outputs, a bar of four corners each.
    assert moving.count("M") == 4


def test_report___in_a_browser___shows_every_part(seen: Visit) -> None:
    figures = seen.figures
    parts = ["Data", "Order", "Modes", "Mode shapes", "Poles", "Reduction", "Fit and errors"]
    galleries = ["Simulation", "Closed-loop simulation", "Residuals", "Frequency response"]
    assert figures["headings"] == [*parts, *galleries, "Step response", "The model"]
    assert figures["lost"] == 0
    assert set(figures["headers"]) == {
        *(
            "records",
            "channels",
            "clusters",
            "modes",
            "shapes",
            "costs",
            "ranks",
            "errors",
            "residuals",
        )
    }
    assert figures["headers"]["ranks"][1::3] == ["By MRM: states", "By MSV: states"]
    errors = ["Full, DMV", "Full, 5-fold CV", "Reduced, DMV", "Reduced, SFV"]
    assert figures["headers"]["errors"] == ["Output", "Fit, %", *errors]
    assert figures["downloads"] == [f"c_dat3_0g{each}" for each in (".yaml", ".json", ".mat", ".h")]
    for words in ("Closed loop", "chi-square", "Data checks", "SHA-256 of its samples"):
        assert words in figures["words"]


def test_report___in_a_browser___zooms_reads_out_and_hides(seen: Visit) -> None:
    used = seen.figures["used"]
    assert used["whole"] == used["again"] == "0 0 10000 2000"
    left, top, width, height = map(float, used["zoomed"].split())
    assert (left, width) == pytest.approx((2500.0, 5000.0), rel=0.01)
    assert (top, height) == (0.0, 2000.0)
    # A record of 40 s.
    assert used["ticks"][:4] == ["10", "15", "20", "25"]
    assert used["read"].startswith("20 | measured ")
    assert "simulated" in used["read"]
    assert "deg" in used["read"]
    assert (used["before"], used["after"]) == ("inline", "none")


def test_report___in_a_browser___names_every_plot(seen: Visit) -> None:
    plots = seen.figures["plots"]
    # The card's, an input, two each for order and poles, one for the reduction; one for each mode
    # that oscillates; for each output its poles and zeros, one gain, two correlations, and
    # twice the whole record with a part of it.
    shapes = sum(plot["label"].startswith("shape of the mode") for plot in plots)
    assert shapes >= 3
    assert len(plots) == 1 + 1 + 2 + shapes + 2 + 1 + 4 * (1 + 1 + 1 + 2 + 2 * 2)
    assert all(plot["label"] and plot["caption"] for plot in plots)
    flat = {plot["label"]: plot["ratio"] for plot in plots if not 0.3 < plot["ratio"] < 1.5}
    assert flat == {}
