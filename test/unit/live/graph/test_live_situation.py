"""State of the arm from the reports of its nodes."""

from __future__ import annotations

import math

import pytest

from flexarm_live.graph.situation import Situation

OK, WARN, ERROR = 0, 1, 2
HELD = "active: the drive is held at zero: "


def situation(level: int, message: str, drive: str, *, sampled_s: float = 10.0) -> Situation:
    found = Situation()
    found.hear("daq", level, message, {"drive": drive, "late p99 ms": "0.5"}, 10.0)
    found.sampled(sampled_s)
    return found


@pytest.mark.parametrize(
    ("level", "message", "drive", "badge"),
    [
        (OK, "not active", "off", ("OFF", "not sampling", "")),
        (OK, "active", "ready", ("READY", "no command in force", "")),
        (OK, "active", "driving", ("DRIVING", "", "")),
        (WARN, "active: no command in time", "ready", ("READY", "no command in time", "warning")),
        (ERROR, f"{HELD}emergency stop", "held", ("HELD", "emergency stop", "failure")),
        (ERROR, f"{HELD}position_v is stuck", "held", ("HELD", "position_v is stuck", "failure")),
        (ERROR, "not active: the loop has ended", "off", ("OFF", "the loop has ended", "failure")),
    ],
)
def test_badge___of_a_report___is_its_state_with_the_reason(
    level: int, message: str, drive: str, badge: tuple[str, str, str]
) -> None:
    assert tuple(situation(level, message, drive).badge(10.5)) == badge


@pytest.mark.parametrize(
    ("level", "message", "drive", "reason"),
    [
        (OK, "not active", "off", "Identifying a model"),
        (OK, "active", "driving", "Identifying a model"),
        (OK, "active", "ready", "no command in force"),
        (ERROR, f"{HELD}emergency stop", "held", "emergency stop"),
        (ERROR, "not active: the loop has ended", "off", "the loop has ended"),
    ],
)
def test_badge___with_a_task___says_it_where_nothing_is_wrong(
    level: int, message: str, drive: str, reason: str
) -> None:
    found = situation(level, message, drive)
    found.task = "Identifying a model"
    assert found.badge(10.5).reason == reason


ENDED = "not active: the loop has ended: law ilqr is made for 300 Hz"


@pytest.mark.parametrize(
    ("drive", "controller", "badge"),
    [
        ("ready", (ERROR, ENDED), ("READY", f"controller {ENDED}", "warning")),
        ("ready", (OK, "not active"), ("READY", "no command in force", "")),
        # An experiment drives in its place.
        ("driving", (ERROR, ENDED), ("DRIVING", "", "")),
    ],
)
def test_badge___controller_that_has_ended_by_an_error___is_reported_with_its_reason(
    drive: str, controller: tuple[int, str], badge: tuple[str, str, str]
) -> None:
    found = situation(OK, "active", drive)
    found.hear("controller", *controller, {}, 10.0)
    assert found.badge(10.5) == badge
    assert found.held(10.5) == ""


def test_badge___without_reports_or_samples___is_unknown() -> None:
    assert Situation().badge(0.0) == ("UNKNOWN", "the DAQ node has not reported yet", "warning")
    found = situation(OK, "active", "driving")
    assert found.badge(10.9).word == "DRIVING"
    assert found.badge(11.5) == ("UNKNOWN", "no samples come", "warning")
    found.sampled(20.0)
    assert "does not report" in found.badge(20.0).reason


def test_stop___before_it_is_reported___shows() -> None:
    found = situation(OK, "active", "driving")
    found.stopped(10.1)
    assert found.badge(10.2).word == "HELD"
    found.moved("daq", active=False, now_s=10.3)
    assert found.badge(10.4).word == "OFF"
    found.moved("daq", active=True, now_s=10.5)
    assert found.badge(10.6).word == "READY"


def test_state___has___the_figures_that_are_known() -> None:
    state = situation(OK, "active", "driving").state(10.5)
    assert state["late_ms"]["p99"] == 0.5
    assert math.isnan(state["reply_ms"]["p50"])
    assert state["nodes"] == {"daq": "active", "controller": "silent"}
    assert "histogram" not in state


def test_histogram___of_a_report___has_its_bars_between_the_edges() -> None:
    found = Situation()
    bars = " ".join(map(str, range(24)))
    values = {"late histogram": bars, "reply histogram": bars}
    found.hear("daq", OK, "active", values, 10.0)
    histogram = found.state(10.5)["histogram"]
    assert histogram["late"] == histogram["reply"] == list(range(24))
    assert len(histogram["edges_ms"]) == 25


def test_recording___is___the_folder_of_the_report() -> None:
    found = Situation()
    assert found.recording() is None
    found.hear("recorder", WARN, "recording to /a/b; state: 3 lost", {}, 1.0)
    assert found.recording() == "/a/b"
    found.hear("recorder", OK, "not recording", {}, 2.0)
    assert found.recording() is None


@pytest.mark.parametrize(
    ("message", "figures", "now_s", "may_be_new"),
    [
        ("active", {"samples": "400"}, 11.0, False),
        ("active", {"samples": "40"}, 11.0, True),
        ("active", {"answered samples": "3"}, 11.0, True),
        ("active", {"samples": "nan"}, 11.0, False),
        ("active", {"samples": "400"}, 14.0, True),
        ("not active", {"samples": "300"}, 11.0, False),
    ],
)
def test_report___after_a_silence_or_with_lower_counts___may_be_of_another_process(
    message: str, figures: dict[str, str], now_s: float, *, may_be_new: bool
) -> None:
    found = Situation()
    counts = {"samples": "300", "answered samples": "290"}
    assert not found.hear("daq", OK, "active", counts, 10.0)
    assert found.hear("daq", OK, message, figures, now_s) is may_be_new
    assert found.hear("daq", OK, "active", {}, now_s + 1.0) is (message == "not active")


def test_reports___older_than_an_answered_stop___say_that_the_drive_is_held() -> None:
    found = situation(OK, "active", "driving")
    found.stopped(10.1)
    reported = found.reports(10.2)["daq"]
    assert reported["message"] == f"{HELD}emergency stop"
    assert reported["values"]["drive"] == "held"
    found.hear("daq", OK, "not active", {"drive": "off"}, 11.0)
    assert found.reports(11.1)["daq"]["values"]["drive"] == "off"
    found.moved("daq", active=True, now_s=12.0)
    found.hear("daq", OK, "active", {"drive": "driving"}, 12.5)
    assert found.reports(12.6)["daq"]["values"]["drive"] == "driving"


def test_reports___of_a_node_that_has_ended___say_since_when_and_have_no_figures() -> None:
    found = situation(OK, "active", "driving")
    found.hear("controller", OK, "active", {"answered samples": "290"}, 10.0)
    found.hear("daq", OK, "active", {"drive": "ready"}, 18.0)
    reported = found.reports(18.2)
    assert reported["controller"] == {
        "message": "no report for 8 s, it hangs or has ended; before: active",
        "values": {},
    }
    assert reported["daq"]["message"] == "active"


def test_reports___of_a_recorder_that_has_ended_beside_the_laboratory___go_away() -> None:
    found = situation(OK, "active", "driving")
    found.hear("recorder_4711", OK, "recording to x", {}, 10.0)
    assert "no report" in found.reports(13.0)["recorder_4711"]["message"]
    assert "recorder_4711" not in found.reports(18.2)
