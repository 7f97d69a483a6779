from __future__ import annotations

import click
import pytest

from flexarm_bringup.console.quantity import (
    FREQUENCY_HZ,
    MASS_KG,
    TIME_S,
    Quantity,
    units_of_channel,
)
from flexarm_core.channels import CHANNELS, TRAVEL_V

POSITION_V = units_of_channel(CHANNELS[0])


@pytest.mark.parametrize(
    ("units", "text", "expected"),
    [
        (MASS_KG, "0.2", 0.2),
        (MASS_KG, "200g", 0.2),
        (MASS_KG, "2e2 g", 0.2),
        (MASS_KG, ".2kg", 0.2),
        # 35 deg are 3 V (section 2.4.2).
        (POSITION_V, "35deg", 3.0),
        (POSITION_V, "-17.5deg", -1.5),
        (POSITION_V, "35°", 3.0),
        (POSITION_V, "0.6108652rad", 3.0),
        (POSITION_V, "-3", -3.0),
        (POSITION_V, "1500mV", 1.5),
        (TIME_S, "10min", 600.0),
        (TIME_S, "0.5ms", 0.0005),
        (FREQUENCY_HZ, "0.3kHz", 300.0),
    ],
)
def test_quantity___number_with_or_without_unit___is_in_the_first_unit(
    units: dict[str, float], text: str, expected: float
) -> None:
    assert Quantity(units).convert(text, None, None) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("200lb", "'200lb' has a unit that is not known here: use kg, g."),
        ("2 00g", "'2 00g' is not a number: write one in kg, or with its unit (kg, g)."),
        ("1500g", "1500 g is not in the range 0 to 1000 g."),
        ("1.5kg", "1.5 kg is not in the range 0 to 1 kg."),
        ("1.5", "1.5 kg is not in the range 0 to 1 kg."),
        ("-1g", "-1 g is not in the range 0 to 1000 g."),
        ("nan", "nan is not a finite number"),
        ("1e999g", "1e999g is not a finite number"),
        ("g", "'g' is not a number: write one in kg"),
    ],
)
def test_quantity___text_that_is_none___is_refused_with_the_way_out(text: str, words: str) -> None:
    with pytest.raises(click.BadParameter) as refusal:
        Quantity(MASS_KG, 0.0, 1.0).convert(text, None, None)
    assert words in refusal.value.message


@pytest.mark.parametrize("text", ["80deg", "-80deg", "1.396263402rad"])
def test_quantity___end_of_the_range_in_another_unit___is_in_it(text: str) -> None:
    assert abs(Quantity(POSITION_V, -TRAVEL_V, TRAVEL_V).convert(text, None, None)) <= TRAVEL_V


def test_quantity___open_range___is_reported_by_its_one_end() -> None:
    with pytest.raises(click.BadParameter) as refusal:
        Quantity(TIME_S, 0.0).convert("-2min", None, None)
    assert refusal.value.message == "-2 min is not in the range 0 min up."
