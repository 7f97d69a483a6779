"""Situation of the laboratory, from what its nodes report on `/diagnostics`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_node.parameter_files import LOOP
from flexarm_node.statistics import HISTOGRAM_EDGES_S

if TYPE_CHECKING:
    from collections.abc import Mapping

EXPERIMENT = "experiment"
"""Node that takes the controller's place in open loop; not in every graph."""
_LABORATORY = {*LOOP, "recorder", "ident", EXPERIMENT}
_REPORT_S = 4.0
"""Reports come once a second; older ones tell nothing."""
_USUAL_REPORT_S = 2.5
_SILENT_S = 1.0
_STOPPED_S = 2.0
"""A stop is shown at once, and reported within a second."""
_RECORDING = "recording to "
_HELD = "the drive is held at zero: "
_EMERGENCY = "emergency stop"
_FIGURES = ("p50", "p99", "max")
_DURATIONS = ("late", "reply")
_COUNTS = ("samples", "answered samples")
"""Figures that fall only where a run or a process begins."""
_ERROR = 2


class _Report(NamedTuple):
    """Newest report of a node."""

    heard_s: float
    is_error: bool
    message: str
    values: Mapping[str, str]

    @property
    def active(self) -> bool:
        """True when the node says that it is."""
        return self.message.startswith("active")

    @property
    def reason(self) -> str:
        """What the node complains of."""
        return self.message.partition(": ")[2]

    def figure(self, name: str) -> float:
        """Return a figure; NaN when the report has none."""
        try:
            return float(self.values[name])
        except (KeyError, ValueError):
            return math.nan

    def histogram(self) -> dict[str, Any]:
        """Return the histogram of the loop as a page gets it; nothing while there is none."""
        bars = {name: self.values.get(f"{name} histogram", "").split() for name in _DURATIONS}
        if not all(bars.values()):
            return {}
        counts = {name: list(map(int, words)) for name, words in bars.items()}
        return {"histogram": {"edges_ms": 1e3 * HISTOGRAM_EDGES_S, **counts}}


class Badge(NamedTuple):
    """State of the drive as docs/safety.md names it, with its reason and its tone."""

    word: str
    reason: str = ""
    tone: str = ""
    """Empty, "warning" or "failure"."""


def _held(reason: str) -> Badge:
    return Badge("HELD", reason, "failure")


def _unknown(reason: str) -> Badge:
    return Badge("UNKNOWN", reason, "warning")


class Situation:
    """What is known of the nodes; its caller states the time.

    Attributes
    ----------
    task : str
        What the laboratory is used for, as its program says; may be empty.
    """

    def __init__(self) -> None:
        self._reports: dict[str, _Report] = {}
        self._sampled_s = -math.inf
        self._stopped_s = -math.inf
        self.task = ""

    def hear(
        self, node: str, level: int, message: str, values: Mapping[str, str], now_s: float
    ) -> bool:
        """Take a report of a node; return whether it may come from another process than before."""
        before = self._reports.get(node)
        report = self._reports[node] = _Report(now_s, level >= _ERROR, message, values)
        if before is None:
            return False
        was_away = now_s - before.heard_s > _USUAL_REPORT_S
        begins = report.active and not before.active
        return was_away or begins or any(report.figure(n) < before.figure(n) for n in _COUNTS)

    def sampled(self, now_s: float) -> None:
        """Take note that samples have come."""
        self._sampled_s = now_s

    def stopped(self, now_s: float) -> None:
        """Take note that the drive was stopped: the report of it comes later."""
        self._stopped_s = now_s

    def moved(self, node: str, *, active: bool, now_s: float) -> None:
        """Take note of a transition: the report of it comes later."""
        before = self._reports.get(node)
        values = dict(before.values) if before else {}
        if node == "daq":
            self._stopped_s = -math.inf
            values["drive"] = "ready" if active else "off"
            self._sampled_s = now_s
        message = "active" if active else "not active"
        self._reports[node] = _Report(now_s, is_error=False, message=message, values=values)

    def badge(self, now_s: float) -> Badge:
        """Return the state of the arm."""
        daq = self._reports.get("daq")
        if daq is None:
            return _unknown("the DAQ node has not reported yet")
        if now_s - daq.heard_s > _REPORT_S:
            return _unknown("the DAQ node does not report: it hangs, or it has ended")
        if not daq.active:
            off = Badge("OFF", self.task or "not sampling")
            return Badge("OFF", daq.reason, "failure") if daq.is_error else off
        if now_s - self._stopped_s < _STOPPED_S:
            return _held(_EMERGENCY)
        return self._sampling(daq, now_s)

    def _failed_controller(self, now_s: float) -> str:
        """Return that the controller has ended by an error, and why; empty when it has not."""
        report = self._reports.get("controller")
        if report is None or now_s - report.heard_s > _REPORT_S:
            return ""
        return "" if report.active or not report.is_error else f"controller {report.message}"

    def _sampling(self, daq: _Report, now_s: float) -> Badge:
        """Return the state of an arm whose DAQ node is active."""
        drive = daq.values.get("drive", "off")
        if drive == "held":
            return _held(daq.reason.partition(_HELD)[2] or daq.reason)
        if now_s - self._sampled_s > _SILENT_S:
            return _unknown("no samples come")
        if drive == "driving":
            return Badge("DRIVING", self.task)
        if reason := self._failed_controller(now_s) or daq.reason:
            return Badge("READY", reason, "warning")
        return Badge("READY", "no command in force")

    def held(self, now_s: float) -> str:
        """Return why the drive is held at zero until it is released; empty when it is not."""
        badge = self.badge(now_s)
        return f"{_HELD}{badge.reason}" if badge.word == "HELD" else ""

    def state(self, now_s: float) -> dict[str, Any]:
        """Return the figures of the loop and the state, as a page gets them."""
        daq = self._reports.get("daq") or _Report(now_s, is_error=False, message="", values={})
        badge = self.badge(now_s)
        return {
            "badge": badge.word,
            "reason": badge.reason,
            "tone": badge.tone,
            "factor": daq.figure("real-time factor"),
            "missed": daq.figure("missed periods"),
            "unanswered": daq.figure("unanswered samples"),
            "rate_hz": daq.figure("rate Hz"),
            **{
                f"{duration}_ms": {name: daq.figure(f"{duration} {name} ms") for name in _FIGURES}
                for duration in _DURATIONS
            },
            "nodes": {name: self.word(name, now_s) for name in LOOP},
            **daq.histogram(),
        }

    def reports(self, now_s: float) -> dict[str, dict[str, Any]]:
        """Return message and figures of each node.

        Of one of the laboratory that is silent it says for how long; others come and go.
        """
        found: dict[str, dict[str, Any]] = {
            name: {"message": silence, "values": {}}
            if (silence := self.silence(name, now_s))
            else {"message": report.message, "values": dict(report.values)}
            for name, report in self._reports.items()
            if name in _LABORATORY or now_s - report.heard_s <= _REPORT_S
        }
        daq = found.get("daq", {"values": {}})
        if now_s - self._stopped_s < _STOPPED_S and daq["values"].get("drive") == "driving":
            # The report is older than the stop that the node has answered.
            daq["message"] = f"active: {_HELD}{_EMERGENCY}"
            daq["values"]["drive"] = "held"
        return found

    def silence(self, node: str, now_s: float) -> str:
        """Return since when a node is silent that has reported; empty when it is not."""
        report = self._reports.get(node)
        if report is None or now_s - report.heard_s <= _USUAL_REPORT_S:
            return ""
        return _silent(report, now_s)

    def word(self, node: str, now_s: float) -> str:
        """Return whether a node is active, or silent."""
        report = self._reports.get(node)
        if report is None or now_s - report.heard_s > _REPORT_S:
            return "silent"
        return "active" if report.active else "inactive"

    def recording(self) -> str | None:
        """Return the folder that the recorder writes to; None when it does not."""
        report = self._reports.get("recorder")
        if report is None or not report.message.startswith(_RECORDING):
            return None
        return report.message.removeprefix(_RECORDING).partition(";")[0]


def _silent(report: _Report, now_s: float) -> str:
    silent_s = now_s - report.heard_s
    return f"no report for {silent_s:.0f} s, it hangs or has ended; before: {report.message}"
