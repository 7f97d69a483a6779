from __future__ import annotations

import os

import pytest

from flexarm_bringup.graph.figures import Run
from flexarm_bringup.runs.pace import Pace, pace_text
from flexarm_node.process import PRIORITY


def test_pace___by_default___leaves_time_to_the_node_and_its_parameter_files() -> None:
    assert Pace.WALL_CLOCK.parameters() == {}
    assert Pace.FAST.parameters() == {"time": "virtual", "real_time_factor": 0.0}
    assert Pace.REAL.parameters() == {"time": "real"}


@pytest.mark.parametrize("pace", Pace)
def test_pace___that_never_rests___asks_for_no_priority(
    monkeypatch: pytest.MonkeyPatch, pace: Pace
) -> None:
    monkeypatch.setenv(PRIORITY, "15")
    pace.prepare()
    assert os.environ[PRIORITY] == ("0" if pace is Pace.FAST else "15")


def test_pace_text___says_what_was_reached_and_missed() -> None:
    assert pace_text(Run(12000, 0, 0.9684)) == "ran at 0.97 of real time"
    assert (
        pace_text(Run(11900, 100, 1.0)) == "ran at 1.00 of real time, 100 periods without a sample"
    )


def test_pace_text___says_a_rate_that_was_not_asked_for() -> None:
    reported = pace_text(
        Run(600, 0, 1.0, off_rate="313.9 Hz by the machine's clock, for rate_hz = 300")
    )
    assert reported.startswith(
        "ran at 1.00 of real time\n  warning: sampled at 313.9 Hz by the machine's clock, for "
        "rate_hz = 300: "
    )
    assert "docs/howto/own_rig.md" in reported
