"""Screens of all sizes."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

from flexarm_bringup.watch.screen import History, Units, plain_line, screen
from flexarm_core.rig_description import load_rig
from flexarm_live.graph.about import about_arm, columns_of
from support.foreign_rigs import TWO_JOINTS

STATE: dict[str, Any] = {
    "badge": "DRIVING",
    "reason": "",
    "law": "pdpc",
    "payload_kg": 0.2,
    "rate_hz": 300.0,
    "factor": 1.0,
    "missed": 2,
    "unanswered": None,
    "late_ms": {"p50": 0.1, "p99": 0.25, "max": None},
}


@pytest.fixture
def units() -> Units:
    return Units(about_arm(load_rig("thesis"), simulated=True))


@pytest.fixture
def history() -> History:
    history = History()
    names = ("position_v", "base_strain_v", "middle_strain_v", "speed_v", "command_v")
    both = (*names, "reference_v", "compensation_v")
    history.add([0.1 * k for k in range(300)], {name: [3.0] * 300 for name in both})
    return history


@pytest.mark.parametrize(
    "size", [*itertools.product((1, 6, 11, 24, 60), (10, 35, 80, 200))], ids=str
)
def test_screen___of_any_size___stays_within_it(
    history: History, units: Units, size: tuple[int, int]
) -> None:
    rows, columns = size
    for piece in screen(STATE, history, units, "set-point +1.00 deg", size):
        assert 0 <= piece.row < rows
        assert piece.column + len(piece.text) < columns


def test_screen___of_80_by_24___says_state_loop_and_traces(history: History, units: Units) -> None:
    pieces = list(screen(STATE, history, units, "note", (24, 80)))
    lines = [
        " ".join(piece.text for piece in pieces if piece.row == row).rstrip() for row in range(24)
    ]
    assert lines[0].strip() == "DRIVING"
    assert lines[1] == "law pdpc  payload 0.2 kg  300 Hz  factor 1.00  missed 2  unanswered -"
    assert lines[2].startswith("late 0.10 / 0.25 / - ms  reply - / - / - ms")
    # 3 V are 35 deg, and 1.5 A.
    assert lines[4].split()[:3] == ["position", "+35.00", "deg"]
    assert lines[5].split()[:3] == ["set-point", "+35.00", "deg"]
    assert lines[16].split()[:3] == ["command", "+1.50", "A"]
    assert lines[23].startswith("space STOP")
    assert all(any("\u2800" < sign <= "\u28ff" for sign in lines[4 + 3 * k + 1]) for k in range(5))


def test_plain_line___says___state_values_and_loop(history: History, units: Units) -> None:
    line = plain_line(STATE, history, units)
    assert line.startswith("DRIVING; position +35.00 deg; ")
    assert "set-point +35.00 deg; law pdpc" in line
    assert plain_line({}, History(), units).endswith("missed -  unanswered -")


def test_screen___of_another_arm___has_its_signals_in_their_units() -> None:
    units = Units(about_arm(TWO_JOINTS, simulated=False))
    history = History()
    history.add([0.0], {name: [512.0] for name in columns_of(TWO_JOINTS)})
    texts = [piece.text.strip() for piece in screen({}, history, units, "", (60, 100))]
    shown = [" ".join(text.split()) for text in texts]
    assert "shoulder co +45.00 deg" in shown
    assert "elbow +29335.44 deg/s" in shown
    assert "light +512.00 lux" in shown
    assert shown.count("set-point +45.00 deg") == 1
    assert "of it comp. +1024.00 N m" in shown
