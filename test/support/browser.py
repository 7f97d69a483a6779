"""Headless Chromium, driven through its DevTools protocol."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.request import urlopen

import pytest
from websockets.sync.client import connect

if TYPE_CHECKING:
    from types import TracebackType

    from typing_extensions import Self

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--remote-debugging-port=0",
)
DEADLINE_S = 300.0
CODES = {"Tab": 9, "Enter": 13, "Space": 32, "ArrowLeft": 37, "ArrowRight": 39}
KEYS = {"Space": " ", "Enter": "\r"}


class Browser:
    """Chromium with one page; `console` and `requests` hold what it said and fetched."""

    def __init__(self) -> None:
        self.console: list[str] = []
        self.requests: list[str] = []
        self._numbers = count(1)
        self._closing = ExitStack()
        self._folder = TemporaryDirectory(prefix="flexarm-chromium-", ignore_cleanup_errors=True)

    def __enter__(self) -> Self:
        profile = self._folder.name
        assert CHROMIUM is not None
        self._process = subprocess.Popen(  # noqa: S603 - the browser of this machine
            [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        port_file = Path(profile, "DevToolsActivePort")
        wait_until(lambda: port_file.exists() and port_file.read_text("utf-8").count("\n") > 0)
        port = port_file.read_text("utf-8").split("\n")[0]
        with urlopen(f"http://127.0.0.1:{port}/json/list") as listed:
            target = next(each for each in json.load(listed) if each["type"] == "page")
        address = target["webSocketDebuggerUrl"]
        self._socket = self._closing.enter_context(
            connect(address, max_size=None, proxy=None, ping_interval=None, open_timeout=DEADLINE_S)
        )
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._closing.close()
        self._process.terminate()
        self._process.wait(DEADLINE_S)
        self._folder.cleanup()

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """Call a method of the protocol and return its result."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(DEADLINE_S))
            if message.get("id") == number:
                assert "error" not in message, message
                result: dict[str, Any] = message["result"]
                return result
            self._note(message)

    def open(
        self, address: str, *, width: int = 1400, height: int = 900, dark: bool = False
    ) -> None:
        """Open an address in a window of a size."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        # Without motion: a colour on its way to another one is not looked at.
        wishes = {
            "prefers-color-scheme": "dark" if dark else "light",
            "prefers-reduced-motion": "reduce",
        }
        features = [{"name": name, "value": value} for name, value in wishes.items()]
        self.call("Emulation.setEmulatedMedia", features=features)
        # A fragment alone would not load the page anew.
        self.call("Page.navigate", url="about:blank")
        self.console.clear()
        self.requests.clear()
        self.call("Page.navigate", url=address)
        there = "['http:', 'file:'].includes(location.protocol)"
        self.wait_for(f"{there} && document.readyState === 'complete'")

    def ask(self, expression: str) -> Any:  # noqa: ANN401 - a value of JavaScript
        """Return the value of an expression; a promise is awaited."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, condition: str) -> None:
        """Wait until an expression is true in the page."""
        wait_until(lambda: bool(self.ask(condition)), condition)

    def press(self, key: str) -> None:
        """Press a key, as the keyboard does."""
        text = KEYS.get(key, key if len(key) == 1 else "")
        name = text if key == "Space" else key
        number = CODES.get(key, 0)
        for kind in ("keyDown", "keyUp"):
            event = {"type": kind, "key": name, "code": key, "text": text}
            self.call("Input.dispatchKeyEvent", windowsVirtualKeyCode=number, **event)

    def click(self, selector: str) -> None:
        """Click the middle of an element with the mouse."""
        self.wait_for(f"document.querySelector({json.dumps(selector)})?.checkVisibility()")
        self.click_at(
            *self.ask(
                f"""(() => {{ const node = document.querySelector({json.dumps(selector)});
                node.scrollIntoView({{ block: "center", behavior: "instant" }});
                const box = node.getBoundingClientRect();
                return [box.x + box.width / 2, box.y + box.height / 2]; }})()"""
            )
        )

    def click_at(self, x: float, y: float) -> None:
        """Click a point of the window."""
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, x, y)

    def mouse(self, kind: str, x: float, y: float) -> None:
        """Move, press or release the mouse at a point of the window."""
        self.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1
        )

    def photograph(self, file: Path, *, whole: bool = True) -> None:
        """Write a picture of the page."""
        shot = self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        file.write_bytes(base64.b64decode(shot["data"]))

    def _note(self, message: dict[str, Any]) -> None:
        about = message.get("params", {})
        match message.get("method"):
            case "Runtime.exceptionThrown":
                self.console.append(json.dumps(about["exceptionDetails"]))
            case "Log.entryAdded" if about["entry"]["level"] in {"error", "warning"}:
                self.console.append(about["entry"]["text"])
            case "Runtime.consoleAPICalled":
                self.console.append(json.dumps(about["args"]))
            case "Network.requestWillBeSent":
                self.requests.append(about["request"]["url"])
            case "Network.webSocketCreated":
                self.requests.append(about["url"])


def wait_until(condition: Any, words: str = "") -> None:  # noqa: ANN401
    """Wait for a condition until the deadline, which is far."""
    deadline_s = time.monotonic() + DEADLINE_S
    while not condition():
        if time.monotonic() > deadline_s:
            pytest.fail(f"it did not come about: {words}")
        time.sleep(0.02)
