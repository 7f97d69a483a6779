from __future__ import annotations

import math

import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.loop.limiter import Limiter, LimiterSettings

PERIOD_S = 0.002


def gate(**settings: float) -> Limiter:
    return Limiter(LimiterSettings(**settings).limits())


def test_command___within_the_limits___passes_unchanged() -> None:
    assert gate().apply(1.5, 0.7, 2.0, PERIOD_S) == (2.2, 0.7, ())


def test_command___with_opposed_parts___passes_unchanged() -> None:
    assert gate().apply(-0.25, 0.75, 2.0, PERIOD_S) == (0.5, 0.75, ())


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_command___beyond_the_drive___is_clamped_at_the_cost_of_the_effort(sign: float) -> None:
    limited = gate().apply(sign * 12.0, sign * 0.75, 0.0, PERIOD_S)
    assert limited == (sign * 10.0, sign * 0.75, ("magnitude",))


def test_command___slewed___moves_from_the_last_applied_command() -> None:
    limiter = gate(max_slew_v_per_s=100.0)
    first = limiter.apply(5.0, 0.0, 0.0, 0.01)
    second = limiter.apply(5.0, 0.5, 0.0, 0.01)
    third = limiter.apply(-5.0, -0.5, 0.0, 0.01)
    assert first == (1.0, 0.0, ("slew",))
    assert second == (2.0, 0.5, ("slew",))
    # The command is still positive, so none of it is the negative compensation.
    assert third == (1.0, 0.0, ("slew",))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("part", [0.5, 0.999, 1.001, 1.1, 1.19, 1.21, 3.0])
def test_change___near_the_slew_limit___is_cut_to_it_from_there_on(
    sign: float, part: float
) -> None:
    limiter = gate(max_slew_v_per_s=100.0)
    allowed_v = 100.0 * 0.01
    for before in (0.0, 1.0):
        wanted_v = sign * (before + part) * allowed_v
        limited = limiter.apply(wanted_v, 0.0, 0.0, 0.01)
        assert limited.command == pytest.approx(sign * (before + min(part, 1.0)) * allowed_v)
        assert limited.reasons == (() if part < 1.0 else ("slew",))
        limiter.reset()
        limiter.apply(sign * allowed_v, 0.0, 0.0, 0.01)


def test_change___of_just_the_slew_limit___is_not_limited() -> None:
    limiter = gate(max_slew_v_per_s=128.0)
    assert limiter.apply(1.0, 0.0, 0.0, 1.0 / 128.0) == (1.0, 0.0, ())


def test_command___beyond_the_drive_and_too_fast___names_both_limits() -> None:
    limited = gate(max_slew_v_per_s=100.0).apply(12.0, 0.0, 0.0, 0.01)
    assert limited == (1.0, 0.0, ("magnitude", "slew"))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("wanted_v", "given_v"), [(9.99, 9.99), (10.0, 10.0), (10.01, 10.0)])
def test_command___near_the_largest___is_cut_to_it_from_there_on(
    sign: float, wanted_v: float, given_v: float
) -> None:
    limited = gate(max_slew_v_per_s=1e6).apply(sign * wanted_v, 0.0, 0.0, 1.0)
    assert limited.command == sign * given_v
    assert limited.reasons == (() if wanted_v <= 10.0 else ("magnitude",))


@pytest.mark.parametrize("outward_v", [1e-6, 0.1])
def test_command___a_little_outward_beyond_the_bound___is_refused_too(outward_v: float) -> None:
    assert gate().apply(outward_v, 0.0, 6.6, PERIOD_S) == (
        0.0,
        0.0,
        ("position_bound",),
    )


def test_no_command___beyond_the_bound___is_not_limited() -> None:
    assert gate().apply(0.0, 0.0, 6.6, PERIOD_S) == (0.0, 0.0, ())


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("position_v", "given_v"), [(6.49, 2.0), (6.5, 2.0), (6.51, 0.0)])
def test_command___near_the_bound___is_refused_from_there_on(
    sign: float, position_v: float, given_v: float
) -> None:
    assert gate().apply(sign * 2.0, 0.0, sign * position_v, PERIOD_S).command == sign * given_v


def test_compensation___larger_than_a_slewed_command___is_all_of_it() -> None:
    limiter = gate(max_slew_v_per_s=100.0)
    assert limiter.apply(1.0, 0.75, 0.0, 0.005) == (0.5, 0.5, ("slew",))


@pytest.mark.parametrize(("wanted_v", "limited_v"), [(8.0, 2.0), (-8.0, 2.0)])
def test_command___beyond_a_lowered_limit___comes_back_at_once_whatever_the_slew(
    wanted_v: float, limited_v: float
) -> None:
    limiter = gate(max_slew_v_per_s=100.0)
    for _ in range(8):
        limiter.apply(8.0, 0.0, 0.0, 0.01)
    limiter.limits = LimiterSettings(max_command_v=2.0, max_slew_v_per_s=100.0).limits()
    assert limiter.apply(wanted_v, 0.0, 0.0, 0.01).command == limited_v
    # From there on it slews again.
    assert limiter.apply(-8.0, 0.0, 0.0, 0.01).command == limited_v - 1.0


def test_reset___after_a_command___slews_from_zero() -> None:
    limiter = gate(max_slew_v_per_s=100.0)
    for _ in range(20):
        limiter.apply(5.0, 0.0, 0.0, 0.01)
    limiter.reset()
    assert limiter.apply(5.0, 0.0, 0.0, 0.01).command == 1.0


@pytest.mark.parametrize("interval_s", [0.0, -1.0])
def test_command___in_no_time___does_not_change(interval_s: float) -> None:
    limiter = gate()
    limiter.apply(3.0, 0.0, 0.0, PERIOD_S)
    assert limiter.apply(-3.0, 0.0, 0.0, interval_s) == (3.0, 0.0, ("slew",))


@pytest.mark.parametrize(("position_v", "outward_v"), [(6.6, 2.0), (-6.6, -2.0)])
def test_command___outward_beyond_the_bound___is_refused(
    position_v: float, outward_v: float
) -> None:
    assert gate().apply(outward_v, 0.0, position_v, PERIOD_S) == (
        0.0,
        0.0,
        ("position_bound",),
    )
    assert gate().apply(-outward_v, 0.0, position_v, PERIOD_S) == (
        -outward_v,
        0.0,
        (),
    )


def test_command___outward_only_by_its_slew___is_refused() -> None:
    limiter = gate(max_slew_v_per_s=100.0)
    for _ in range(10):
        limiter.apply(5.0, 0.0, 0.0, 0.01)
    limited = limiter.apply(-5.0, 0.0, 6.6, 0.01)
    assert limited == (0.0, 0.0, ("slew", "position_bound"))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("argument", range(4))
def test_anything___not_finite___gives_zero_at_once(bad: float, argument: int) -> None:
    limiter = gate(max_slew_v_per_s=100.0)
    for _ in range(10):
        limiter.apply(5.0, 0.0, 0.0, 0.01)
    arguments = [5.0, 0.5, 0.0, 0.01]
    arguments[argument] = bad
    assert limiter.apply(*arguments) == (0.0, 0.0, ("not_finite",))
    assert limiter.apply(5.0, 0.0, 0.0, 0.01).command == 1.0


@pytest.mark.parametrize("name", ["max_command_v", "max_slew_v_per_s", "position_bound_v"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_settings___not_a_positive_number___are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(SettingError, match=f"^{name} must be a positive number"):
        LimiterSettings(**{name: value})


@pytest.mark.parametrize("name", ["max_command_v", "max_slew_v_per_s", "position_bound_v"])
def test_settings___small_and_positive___are_taken(name: str) -> None:
    assert getattr(LimiterSettings(**{name: 1e-3}), name) == 1e-3


def test_settings___beyond_the_drive___are_refused() -> None:
    with pytest.raises(SettingError, match="max_command_v must not exceed the drive's 10 V"):
        LimiterSettings(max_command_v=10.1)


def test_zero_of_the_bound___is_where_the_next_command_slews_from() -> None:
    limiter = gate(max_slew_v_per_s=100.0)
    for _ in range(5):
        limiter.apply(5.0, 0.0, 0.0, 0.01)
    assert limiter.apply(5.0, 0.0, 6.6, 0.01).command == 0.0
    assert limiter.apply(5.0, 0.0, 0.0, 0.01).command == 1.0
