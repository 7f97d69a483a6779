"""Reactions: the stop by the space bar and from the terminal, and the other verbs."""

from __future__ import annotations

import subprocess
import sys
import time
from typing import TYPE_CHECKING

from bench.live.figures import Row, percentile_rows
from bench.live.laboratory import FLEXARM, following, now_s
from bench.live.pages import probed
from bench.tools import typed_environment
from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.live.laboratory import Follower, Laboratory
    from support.browser import Browser

STOP, VERBS = "stop", "verbs"
_MOST_KEY_MS = 50.0
_MOST_STOP_S = 0.3
_MOST_VERB_S = 0.5
_TAIL = 2.0
"""The 95th percentile may be so many times the line of the median."""
_DRIVE_S = 0.5
"""Time that the arm swings before it is stopped."""


def stop_part(lab: Laboratory, browser: Browser, times: int) -> list[Row]:
    """Stop a swinging arm from the terminal and by the space bar of the page."""
    key_ms = []
    with following(lab) as follower:
        alone_s, returned_s = _typed_stops(lab, follower, times)
        with probed(browser, lab):
            for _ in range(times):
                _drive(lab, follower)
                since_s = now_s()
                browser.press("Space")
                zero_s = follower.zero_s(since_s)
                key_ms.append(1e3 * (zero_s - browser.ask("probe.keysS.at(-1)")))
            beside_s, _ = _typed_stops(lab, follower, times)
        lab.release()
    key_lines = {50.0: _MOST_KEY_MS, 100.0: _MOST_KEY_MS}
    typed_lines = {50.0: _MOST_STOP_S, 95.0: _TAIL * _MOST_STOP_S}
    enter = "`./flexarm stop`, enter to"
    page = f"{enter} zero beside a page drawn without a graphics card"
    return [
        *percentile_rows(STOP, "space bar to zero at the drive", "ms", key_ms, key_lines),
        *percentile_rows(STOP, f"{enter} zero at the drive", "s", alone_s, typed_lines),
        *percentile_rows(STOP, f"{enter} its end", "s", returned_s, {50.0: None}),
        *percentile_rows(STOP, page, "s", beside_s, dict.fromkeys(typed_lines)),
    ]


def _typed_stops(
    lab: Laboratory, follower: Follower, times: int
) -> tuple[list[float], list[float]]:
    """Return how long typed stops take to the zero at the drive and to their end, s."""
    zero_s, returned_s = [], []
    for _ in range(times):
        _drive(lab, follower)
        since_s = now_s()
        returned_s.append(_typed(["stop"]))
        zero_s.append(follower.zero_s(since_s) - since_s)
    return zero_s, returned_s


def _drive(lab: Laboratory, follower: Follower) -> None:
    lab.release()
    follower.await_drive()
    time.sleep(_DRIVE_S)


def verbs_part(lab: Laboratory, times: int) -> list[Row]:
    """Time the verbs of another terminal, in turns with the start of a bare Python."""
    lab.ask("waveform", kind="none")
    gains = lab.ask("get", node="controller")["params"]
    kp = next(each["value"] for each in gains if each["name"] == "pdpc.kp")
    lines = {
        "set": ["set", "controller", f"pdpc.kp={kp}"],
        "reference": ["reference", "0.5"],
        "status": ["status"],
        "get": ["get"],
    }
    spent_s: dict[str, list[float]] = {name: [] for name in lines}
    bare_s = []
    for _ in range(times):
        bare_s.append(_took_s([sys.executable, "-c", "pass"]))
        for name, words in lines.items():
            spent_s[name].append(_typed(words))
    rows = percentile_rows(VERBS, "start of a bare Python", "s", bare_s, {50.0: None})
    most_s = {50.0: _MOST_VERB_S, 95.0: _TAIL * _MOST_VERB_S}
    for name, values in spent_s.items():
        rows += percentile_rows(VERBS, f"`./flexarm {name}`", "s", values, most_s)
    lab.swing()
    return rows


def _typed(words: Sequence[str]) -> float:
    """Return how long a verb takes that is typed in a fresh terminal, s."""
    return _took_s([FLEXARM, *words])


def _took_s(command: Sequence[str]) -> float:
    start_s = time.monotonic()
    done = subprocess.run(  # noqa: S603 - our own programs
        command, check=False, capture_output=True, text=True, env=typed_environment()
    )
    if done.returncode:
        raise LaunchError(f"{' '.join(command)}: {done.stdout}{done.stderr}")
    return time.monotonic() - start_s
