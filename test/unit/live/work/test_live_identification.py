"""What a page is told of the modes of a model."""

from __future__ import annotations

import pytest

from flexarm_ident.models.modes import Mode
from flexarm_live.work.identification import kind_of
from support.recurring_modes import NEIGHBOURS


def pair(frequency_hz: float, damping_ratio: float) -> Mode:
    """Return a pair of any model: its place counts."""
    return Mode(0.9 + 0.1j, frequency_hz, damping_ratio, (0, 1), 1.0, 1.0, 1, 1)


@pytest.mark.parametrize(
    ("frequency_hz", "damping_ratio", "kind"),
    [
        (9.1, 0.02, "physical"),
        (43.3, 0.02, "split"),
        (45.3, 0.02, "split"),
        (50.0, 0.01, "noise"),
        (70.0, 0.01, "rare"),
        (70.0, 0.9, "damped"),
    ],
)
def test_kind_of_a_mode___is_that_of_the_report(
    frequency_hz: float, damping_ratio: float, kind: str
) -> None:
    assert kind_of(pair(frequency_hz, damping_ratio), NEIGHBOURS) == kind
