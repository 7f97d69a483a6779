from __future__ import annotations

import hashlib
import math
from typing import TYPE_CHECKING

import pytest

from flexarm_live.page_files import page_files
from support.browser import wait_until
from support.live_page import asked, opened

if TYPE_CHECKING:
    from support.browser import Browser
    from support.live_mock import LiveMock

DEG_PER_V = 11.6667
MOST_BYTES = 200_000
# WCAG 2.1, level AA: text of usual size, and large or bold text.
CONTRAST, LARGE_CONTRAST = 4.5, 3.0
STAGES = ("record", "identify", "model", "tune", "step")

# Ratio of luminances of each visible text and what is behind it; the lowest with its text.
LOWEST_CONTRAST = """(() => {
  const parts = (text) => text.match(/[\\d.]+/g).map(Number).slice(0, 3);
  const light = (colour) => {
    const [r, g, b] = colour.map((part) => part / 255)
      .map((part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const opacity = (node) => (node === null ? 1 :
    getComputedStyle(node).opacity * opacity(node.parentElement));
  const ground = (node) => {
    const colour = getComputedStyle(node).backgroundColor;
    const clear = colour === "rgba(0, 0, 0, 0)" && node.parentElement !== null;
    return clear ? ground(node.parentElement) : colour;
  };
  const texts = [...document.querySelectorAll("body *")].filter((node) =>
    !node.closest("svg, .unseen, .uplot, :disabled") && node.checkVisibility()
    && [...node.childNodes].some((child) => child.nodeType === 3 && child.data.trim()));
  return texts.map((node) => {
    const style = getComputedStyle(node);
    const [behind, share] = [parts(ground(node)), opacity(node)];
    const seen = parts(style.color).map((part, at) => share * part + (1 - share) * behind[at]);
    const [dark, bright] = [light(seen), light(behind)].sort((a, b) => a - b);
    const large = parseFloat(style.fontSize) >= (style.fontWeight >= 700 ? 18.6 : 24);
    const ratio = (bright + 0.05) / (dark + 0.05);
    return [ratio / (large ? LARGE : USUAL), node.outerHTML.slice(0, 90)];
  }).sort((a, b) => a[0] - b[0])[0];
})()""".replace("LARGE", str(LARGE_CONTRAST)).replace("USUAL", str(CONTRAST))

# Controls that a person sees and may use; of tabs the chosen one, since arrows lead to the others.
CONTROLS = """[...document.querySelectorAll("button, select, input, summary, a[href], [tabindex]")]
  .filter((node) => !node.matches(":disabled") && node.tabIndex >= 0 && node.checkVisibility())"""


def drawn_angle_deg(browser: Browser) -> float:
    """Return the direction from the hub to the tip of the link that is drawn."""
    x, y = browser.ask(
        """(() => { const link = document.querySelector("#arm .link");
        const [hub, tip] = [0, link.getTotalLength()].map((at) => link.getPointAtLength(at));
        return [tip.x - hub.x, tip.y - hub.y]; })()"""
    )
    return math.degrees(math.atan2(-x, -y))


def test_page_files___together___are_small_and_of_known_origin() -> None:
    files = page_files()
    assert sum(len(file.content) for file in files.values()) <= MOST_BYTES
    origin = files["uplot_origin.txt"].content.decode()
    for name in ("uplot.js", "uplot.css"):
        assert hashlib.sha256(files[name].content).hexdigest() in origin
    assert b"MIT" in files["uplot_licence.txt"].content


def test_page___opens___without_complaint_or_foreign_request(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    browser.wait_for("document.querySelector('#traces canvas') !== null")
    assert browser.console == []
    host = mock.address.split("/")[2]
    foreign = [url for url in browser.requests if url.split("/")[2:3] != [host]]
    assert [url for url in foreign if not url.startswith(("data:", "about:"))] == []


def test_arm___is_drawn___at_the_angle_of_the_state(browser: Browser, mock: LiveMock) -> None:
    opened(browser, mock)
    for position_v in (0.0, 3.0, -5.5):
        mock.arm.fixed = (position_v, 0.0, 0.0, 0.0)
        label = f"{abs(position_v * DEG_PER_V):.1f}°"
        browser.wait_for(f"document.getElementById('angle').textContent.endsWith('{label}')")
        assert drawn_angle_deg(browser) == pytest.approx(position_v * DEG_PER_V, abs=0.5)


def test_arm___moving_at_500_hz___is_drawn_anew_in_nearly_every_frame(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    count = """new Promise((done) => {
      const link = document.querySelector("#arm .link");
      let [frames, drawn, last] = [0, 0, ""];
      const look = () => {
        const shape = link.getAttribute("d");
        drawn += Number(shape !== last);
        last = shape;
        frames += 1;
        if (frames < 60) requestAnimationFrame(look);
        else done(drawn);
      };
      requestAnimationFrame(look);
    })"""
    wait_until(lambda: browser.ask(count) >= 50, "50 of 60 frames with a new arm")


def test_arm___pressed_with_the_mouse___has_no_ring_and_has_one_for_keys(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    ring = "getComputedStyle(document.querySelector('#arm:focus')).outlineStyle"
    browser.click("#arm")
    assert browser.ask(ring) == "none"
    browser.press("ArrowLeft")
    assert browser.ask(ring) == "solid"


def test_space_bar___wherever_the_focus_is___sends_the_stop_within_the_key_event(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    places = ["body", "#pause", "#law", "#wave_period", "#setpoint"]
    sent = browser.ask(
        f"""(() => {{ const sent = [];
        const send = WebSocket.prototype.send;
        WebSocket.prototype.send = function (text) {{
          sent.push(JSON.parse(text).do);
          send.call(this, text);
        }};
        for (const place of {places}) {{
          const node = document.querySelector(place);
          node.focus();
          const press = {{ key: " ", code: "Space", bubbles: true, cancelable: true }};
          node.dispatchEvent(new KeyboardEvent("keydown", press));
          sent.push(place);
        }}
        return sent; }})()"""
    )
    assert sent == [each for place in places for each in ("stop", place)]


def test_stop___by_the_keyboard___is_latched_until_released(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    browser.press("Space")
    browser.wait_for("document.getElementById('badge').dataset.state === 'HELD'")
    assert len(asked(mock, "stop")) == 1
    browser.ask("document.getElementById('release').focus()")
    browser.press("Enter")
    browser.wait_for("document.getElementById('badge').dataset.state === 'OFF'")
    browser.ask("document.getElementById('activate').focus()")
    browser.press("Enter")
    browser.wait_for("document.getElementById('badge').dataset.state === 'DRIVING'")


USABLE = """[...document.querySelectorAll(
  "#power button, #release, fieldset button, fieldset select, fieldset input")]
  .filter((node) => !node.matches(":disabled")).length"""
MESSAGE = "document.getElementById('message').textContent"
# A message fades after four seconds, which a busy machine may not look at in time.
HEARD = """window.heard = [];
  new MutationObserver(() => heard.push(document.getElementById("message").textContent))
    .observe(document.getElementById("message"), { childList: true, subtree: true })"""
NOT_SENT = "NOT SENT: no connection, use the hardware stop"


def test_page___without_a_connection___has_no_control_and_a_stop_that_says_so(
    browser: Browser, mock: LiveMock
) -> None:
    mock.opens = False
    browser.open(mock.address)
    browser.wait_for("!document.getElementById('stop').disabled")
    assert browser.ask(USABLE) == 0
    assert browser.ask("document.getElementById('badge_name').textContent") == "UNKNOWN"
    browser.click("#stop")
    browser.wait_for(f"{MESSAGE} === '{NOT_SENT}'")
    assert asked(mock, "stop") == []
    mock.opens = True
    browser.wait_for(f"{USABLE} > 30")
    # The stop that was not sent comes before all else.
    assert asked(mock, "stop") != []


def test_page___whose_connection_is_lost___loses_its_controls(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    browser.wait_for(f"{USABLE} > 30")
    mock.opens = False
    mock.drop_pages()
    browser.wait_for(f"{USABLE} === 0")
    mock.opens = True
    browser.wait_for(f"{USABLE} > 30")


def test_page___before_its_greeting___has_no_control_and_stops(
    browser: Browser, mock: LiveMock
) -> None:
    mock.greets.clear()
    try:
        browser.open(mock.address)
        browser.wait_for("!document.getElementById('stop').disabled")
        assert browser.ask(USABLE) == 0
        browser.ask(HEARD)

        def is_acknowledged() -> bool:
            # It is not sent before its connection stands: a user presses again then, too.
            browser.click("#stop")
            return bool(browser.ask("heard.includes('stopped: the drive is held at zero')"))

        wait_until(is_acknowledged)
    finally:
        mock.greets.set()


def test_stop___that_nobody_acknowledges___says_so(browser: Browser, mock: LiveMock) -> None:
    opened(browser, mock)
    mock.acknowledges = False
    browser.press("Space")
    words = "not acknowledged in 2.5 s, use the hardware stop"
    browser.wait_for(f"{MESSAGE}.includes('{words}')")


def test_tab_key___pressed_on___reaches_every_control(browser: Browser, mock: LiveMock) -> None:
    opened(browser, mock)
    browser.ask("document.querySelector('details').open = true")
    controls = browser.ask(f"{CONTROLS}.length")
    browser.ask("window.reached = new Set()")
    for _ in range(controls + 2):
        browser.press("Tab")
        browser.ask("reached.add(document.activeElement)")
    assert (
        browser.ask(f"{CONTROLS}.filter((node) => !reached.has(node)).map((node) => node.id)") == []
    )
    assert controls > 30


def test_controls___each___have_an_accessible_name(browser: Browser, mock: LiveMock) -> None:
    opened(browser, mock)
    browser.ask(
        "for (const node of document.querySelectorAll('[role=tabpanel]')) node.hidden = false"
    )
    roles = {"button", "textbox", "spinbutton", "slider", "combobox", "tab", "link"}
    nodes = browser.call("Accessibility.getFullAXTree")["nodes"]
    controls = [node for node in nodes if node.get("role", {}).get("value") in roles]
    assert [node for node in controls if not node.get("name", {}).get("value")] == []
    assert len(controls) > 40


@pytest.mark.parametrize("dark", [False, True])
def test_page___400_pixels_wide___fits_and_is_readable(
    browser: Browser, mock: LiveMock, *, dark: bool
) -> None:
    opened(browser, mock, width=400, dark=dark)
    for stage in STAGES:
        browser.ask(f"document.getElementById('tab_{stage}').click()")
        assert browser.ask("document.documentElement.scrollWidth") <= 400
        ratio, text = browser.ask(LOWEST_CONTRAST)
        assert ratio >= 1.0, text
    bottom, top = browser.ask(
        """(({ bottom, top }) => [bottom, top])(
        document.getElementById("stop").getBoundingClientRect())"""
    )
    assert 0 < top < bottom <= browser.ask("innerHeight")
    luminous = browser.ask("getComputedStyle(document.documentElement).backgroundColor")
    assert (max(map(int, luminous[4:-1].split(","))) < 64) == dark


def test_set_point___by_keys_field_and_arm___is_sent(browser: Browser, mock: LiveMock) -> None:
    opened(browser, mock)
    browser.ask("document.getElementById('arm').focus()")
    browser.press("ArrowLeft")
    wait_until(lambda: mock.arm.reference_v == pytest.approx(1.0 / DEG_PER_V, abs=1e-3))
    mock.arm.fixed = (mock.arm.reference_v, 0.0, 0.0, 0.0)
    x, y, radius = browser.ask(
        """(() => { const matrix = document.getElementById("arm").getScreenCTM();
        return [matrix.e, matrix.f, matrix.a]; })()"""
    )
    browser.mouse("mousePressed", x, y - 0.7 * radius)
    for deg in (-10.0, -20.0, -30.0):
        across, ahead = math.sin(math.radians(-deg)), math.cos(math.radians(deg))
        browser.mouse("mouseMoved", x + 0.7 * radius * across, y - 0.7 * radius * ahead)
    browser.mouse("mouseReleased", x + 0.7 * radius * across, y - 0.7 * radius * ahead)
    wait_until(lambda: mock.arm.reference_v == pytest.approx(-30.0 / DEG_PER_V, abs=0.02))


def test_gain___out_of_bounds___is_refused_and_shown_as_it_was(
    browser: Browser, mock: LiveMock
) -> None:
    opened(browser, mock)
    typed = """(() => { const field = document.getElementById("controller_pdpc_kp");
    field.value = "VALUE"; field.dispatchEvent(new Event("change"));
    return [field.min, field.max]; })()"""
    assert browser.ask(typed.replace("VALUE", "7")) == ["0", "5"]
    browser.wait_for(
        "document.getElementById('message').textContent.includes('outside 0 to 5 V/V')"
    )
    browser.wait_for("document.getElementById('controller_pdpc_kp').value === '0.5935'")
    browser.ask(typed.replace("VALUE", "0.75"))
    wait_until(lambda: mock.arm.gains["pdpc.kp"] == pytest.approx(0.75))


def test_page_without_the_token___shows___and_commands_nothing(
    browser: Browser, mock: LiveMock
) -> None:
    browser.open(mock.address.partition("#")[0])
    browser.wait_for("document.getElementById('arm').dataset.angleDeg !== undefined")
    assert browser.ask("document.getElementById('stop').disabled")
    browser.press("Space")
    browser.wait_for("document.getElementById('message').textContent.includes('without the token')")
    assert {request["do"] for request in mock.requests} == {
        "bags",
        "signals",
        "identify_line",
        "tune_line",
    }


def test_traces___paused_and_in_volts___stand_still(browser: Browser, mock: LiveMock) -> None:
    opened(browser, mock)
    browser.press("p")
    browser.press("u")
    assert browser.ask("document.getElementById('pause').textContent") == "Live"
    reading = "document.querySelector('#traces .key output').textContent"
    assert browser.ask(reading).endswith(" V")
    box = "document.querySelector('#traces .u-over').getBoundingClientRect()"
    x, y, width = browser.ask(f"(({{ x, y, width }}) => [x, y, width])({box})")
    browser.mouse("mouseMoved", x + width - 2, y + 20)
    browser.wait_for("document.getElementById('at').textContent.startsWith('t = ')")
