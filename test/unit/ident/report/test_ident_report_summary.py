"""Vibrations in the report's summary."""

from __future__ import annotations

from dataclasses import replace

from flexarm_ident.models.modes import Mode
from flexarm_ident.report.summary import vibrations
from support.recurring_modes import NEIGHBOURS


def pair(frequency_hz: float, damping_ratio: float = 0.02) -> Mode:
    """Return a pair of any model: its place counts."""
    return Mode(0.9 + 0.1j, frequency_hz, damping_ratio, (0, 1), 1.0, 1.0, 1, 1)


def test_vibrations___modes_of_a_model___are_parted_as_the_table_parts_them() -> None:
    modes = [pair(45.3), pair(9.1), pair(43.3), pair(9.9), pair(50.0), pair(70.0, 0.9)]
    assert vibrations(modes, NEIGHBOURS) == [
        "Lightly damped mode at 9.10 Hz (damping ratio below 0.2).",
        "Lightly damped modes at 43.30 and 45.30 Hz: possibly a split pole.",
        (
            "Lightly damped modes at 9.90 and 50.00 Hz: not repeated over the orders, or hardly "
            "excited, possibly spurious."
        ),
    ]


def test_vibrations___one_mode_with_a_neighbour_at_other_orders___is_reported_as_that() -> None:
    assert vibrations([pair(43.3)], NEIGHBOURS) == [
        "Lightly damped mode at 43.30 Hz: possibly a split pole."
    ]


def test_vibrations___no_light_mode___is_reported() -> None:
    assert vibrations([pair(70.0, 0.9)], NEIGHBOURS) == [
        "No lightly damped mode (damping ratio below 0.2)."
    ]


def test_vibrations___equations_of_an_arm___need_not_recur_but_be_heard() -> None:
    faint, slow = replace(pair(30.0), mrm=0.01), replace(pair(1.7, 0.9), mrm=90.0)
    assert vibrations([pair(9.9), pair(31.0), faint, slow], NEIGHBOURS, is_arm=True) == [
        "Lightly damped modes at 9.90 and 31.00 Hz (damping ratio below 0.2).",
        "Lightly damped mode at 30.00 Hz: hardly excited, possibly spurious.",
    ]
