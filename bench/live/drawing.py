"""Drawing of the page: frames, the angle that is drawn, and the age of what is seen."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from bench.live.figures import Row, drawn_errors_deg, percentile_rows
from bench.live.laboratory import following, now_s
from bench.live.pages import empty_frames_per_s, probed

if TYPE_CHECKING:
    from bench.live.laboratory import Laboratory
    from support.browser import Browser

DRAWING = "drawing"
_LEAST_FRAMES_PER_S = 50.0
_MOST_DEG = 0.5
_MOST_AGE_MS = 80.0
_SETTLE_S = 3.0
_EMPTY_S = 3.0
_CLEAR = "void Object.assign(probe, {armS: [], tracesS: [], angles: [], frames: 0, drawn: 0})"


def drawing_part(lab: Laboratory, browser: Browser, length_s: float) -> list[Row]:
    """Watch the page draw a swinging arm."""
    empty = empty_frames_per_s(browser, _EMPTY_S)
    lab.swing()
    with following(lab) as follower, probed(browser, lab):
        time.sleep(_SETTLE_S)
        since_s = now_s() - _SETTLE_S
        browser.ask(_CLEAR)
        start_s = time.monotonic()
        time.sleep(length_s)
        seen = browser.ask("probe")
        elapsed_s = time.monotonic() - start_s
        stamps_s, positions_v, _ = follower.samples(since_s)
    errors_deg = drawn_errors_deg(np.array(seen["angles"]), stamps_s, positions_v)
    rows = [
        Row(DRAWING, "frames of an empty page", empty, "/s"),
        Row(DRAWING, "frames of the page", seen["frames"] / elapsed_s, "/s"),
        Row(
            DRAWING,
            "frames in which the arm is drawn anew",
            seen["drawn"] / elapsed_s,
            "/s",
            least=_LEAST_FRAMES_PER_S,
        ),
        *percentile_rows(
            DRAWING,
            "drawn angle against the sample's",
            "°",
            errors_deg.tolist(),
            {100.0: _MOST_DEG},
        ),
    ]
    for what, name in (("arm", "armS"), ("traces", "tracesS")):
        ages_ms = [1e3 * age_s for age_s in seen[name]]
        lines = {50.0: None, 99.0: _MOST_AGE_MS}
        rows += percentile_rows(DRAWING, f"sample to {what}", "ms", ages_ms, lines)
    return rows
