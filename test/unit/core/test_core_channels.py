from __future__ import annotations

import math

import pytest

from flexarm_core.channels import CHANNEL_NAMES, CHANNELS, COMMAND, MAX_COMMAND_V, TRAVEL_V


def test_channels___names___in_the_order_of_the_analogue_inputs() -> None:
    assert tuple(channel.name for channel in CHANNELS) == CHANNEL_NAMES
    assert CHANNEL_NAMES == ("position_v", "base_strain_v", "middle_strain_v", "speed_v")


def test_position___three_volts___is_thirty_five_degrees() -> None:
    assert math.degrees(CHANNELS[0].to_si(3.0)) == pytest.approx(35.0)
    assert CHANNELS[0].per_si == pytest.approx(4.911, abs=5e-4)


def test_command___full_scale___is_five_amperes() -> None:
    assert COMMAND.to_si(MAX_COMMAND_V) == pytest.approx(5.0)
    assert COMMAND.to_si(0.8) == pytest.approx(0.4)


def test_travel___in_volts___is_eighty_degrees_of_the_potentiometer() -> None:
    assert pytest.approx(3.0 * 80.0 / 35.0) == TRAVEL_V
