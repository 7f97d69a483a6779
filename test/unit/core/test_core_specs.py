"""Parameter tables: ranges, choices and their messages."""

from __future__ import annotations

import math

import pytest

from flexarm_core.errors import FlexarmError, SettingError
from flexarm_core.specs import ParameterSpec

RATE = ParameterSpec("rate_hz", 300.0, "sampling rate", 10.0, 2000.0, "Hz")
NOISE = ParameterSpec("noise", "low", "sensor noise", choices=("low", "none"))


@pytest.mark.parametrize("value", [9.999, 2000.001, math.nan, -math.inf, math.inf])
def test_check___number_out_of_range___is_refused_with_the_range(value: float) -> None:
    with pytest.raises(SettingError, match=r"^daq: rate_hz = .* is outside 10 to 2000 Hz; choose"):
        RATE.check(value, "daq")


def test_check___value_none_of_the_choices___is_refused_with_the_choices() -> None:
    with pytest.raises(FlexarmError, match=r"^daq: noise = 'loud': must be one of low, none$"):
        NOISE.check("loud", "daq")


@pytest.mark.parametrize(
    ("spec", "value"),
    [
        (RATE, 10.0),
        (RATE, 2000),
        (NOISE, "none"),
        (ParameterSpec("loop", default=False, description="again"), True),
        (ParameterSpec("topics", ["state"], "recorded"), ["state", "command"]),
        (ParameterSpec("offset_v", 0.0, "of any size"), 1e300),
    ],
)
def test_complaint___allowed_value___is_none(spec: ParameterSpec, value: object) -> None:
    assert spec.complaint(value) is None


@pytest.mark.parametrize(
    ("bounds", "unit", "text"),
    [
        ((0.1, 12345.0), "V", "0.1 to 12345 V"),
        ((-6.8571428, 6.8571428), "V", "-6.857 to 6.857 V"),
        ((0, 2**31 - 1), "", "0 to 2147483647"),
        ((None, 1.0), "kg", "-inf to 1 kg"),
    ],
)
def test_range_text___whole_numbers_and_fractions___is_exact_or_has_four_digits(
    bounds: tuple[float | None, float | None], unit: str, text: str
) -> None:
    assert ParameterSpec("x", 0.0, "anything", *bounds, unit).range_text == text
