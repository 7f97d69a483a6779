from __future__ import annotations

from dataclasses import dataclass

import pytest

from flexarm_core.errors import SettingError
from flexarm_core.rig_description import RigDescription, described
from flexarm_daq.drivers.settings import require_count, settings_of


@dataclass(frozen=True)
class Wiring:
    """Settings of every kind."""

    port: str
    pins: tuple[str, ...]
    gains: tuple[float, ...] = (1.0,)
    gain: float = 1.0
    count: int = 1
    inverted: bool = False
    rate_hz: float = 0.0


def rig(settings: str) -> RigDescription:
    return described(
        "name: mine\nrate_hz: 100\ninputs: {u: {unit: x, limits: 1}}\noutputs: {a: {unit: x}}\n"
        f"driver: wires\nsettings: {settings}\n"
    )


def test_settings___of_every_kind___are_taken_with_the_rest_at_its_defaults() -> None:
    found = settings_of(
        Wiring,
        rig("{port: a, pins: [b, c], gains: [2, 0.5], gain: 3, count: 4, inverted: true}"),
        rate_hz=100.0,
    )
    assert found == Wiring("a", ("b", "c"), (2, 0.5), 3, 4, inverted=True, rate_hz=100.0)
    assert settings_of(Wiring, rig("{port: a, pins: []}")) == Wiring("a", ())


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ("{prt: a}", r"settings.prt is not a setting of the driver wires \(nearest: port\)"),
        ("{rate_hz: 5}", r"settings.rate_hz is not a setting of the driver wires"),
        ("{port: a}", r"settings.pins is missing: the driver wires needs it"),
        ("{port: 5, pins: [b]}", r"settings.port = 5 must be a text"),
        ("{port: a, pins: b}", r"settings.pins = .*b.* must be a list of names"),
        ("{port: a, pins: [b, 1]}", r"settings.pins = .* must be a list of names"),
        ("{port: a, pins: [b], gains: [x]}", r"settings.gains = .* must be a list of numbers"),
        ("{port: a, pins: [b], gain: .inf}", r"settings.gain = inf must be a number"),
        ("{port: a, pins: [b], gain: true}", r"settings.gain = True must be a number"),
        ("{port: a, pins: [b], count: 1.5}", r"settings.count = 1.5 must be a whole number"),
        ("{port: a, pins: [b], inverted: 1}", r"settings.inverted = 1 must be true or false"),
    ],
)
def test_settings___that_do_not_fit___are_refused_in_a_line(settings: str, said: str) -> None:
    with pytest.raises(SettingError, match=said):
        settings_of(Wiring, rig(settings), rate_hz=100.0)


def test_count___other_than_that_of_the_signals___names_them() -> None:
    require_count("pins", ("p", "q"), ("a", "b"))
    with pytest.raises(SettingError, match=r"settings.pins has 1 entries, and .* 2 .*: a, b"):
        require_count("pins", ("p",), ("a", "b"))
