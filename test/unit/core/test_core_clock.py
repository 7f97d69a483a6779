"""Rate of a record by its stamps."""

from __future__ import annotations

import pytest

from flexarm_core.clock import nominal_rate_hz


@pytest.mark.parametrize(
    ("rate_hz", "periods", "nominal_hz"),
    [
        # Half a period at the ends of 1000.
        (200.09, 1000.0, 200.0),
        (200.09, 6000.0, 200.09),
        # Two clocks, however long the record is.
        (199.985, 1e7, 200.0),
        (199.97, 1e7, 199.97),
        # No rate of few stamps is rounded further than a part in a thousand.
        (12.5, 1.0, 12.5),
        (0.0004, 10.0, 0.0004),
    ],
)
def test_nominal_rate___stamps_say_another_or_not(
    rate_hz: float, periods: float, nominal_hz: float
) -> None:
    assert nominal_rate_hz(rate_hz, periods) == pytest.approx(nominal_hz, rel=1e-12)
