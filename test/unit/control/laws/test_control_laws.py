"""Control laws: the truth table of (4-8), registry and ranges."""

from __future__ import annotations

import math
from typing import Any

import pytest

from flexarm_control import (
    LAWS,
    Compensation,
    ControlError,
    Coulomb,
    Effort,
    Pd,
    PdGains,
    Pdp,
    Pdpc,
    PdpGains,
    build_law,
)
from flexarm_control.laws.gains import CompensationLevel
from flexarm_control.laws.law_protocol import hearing

ONLY_POSITION = PdpGains(kp=1.0, kd=0.0, ksg=0.0)


def test_pd___step___weighs_error_and_speed_and_follows_the_sign() -> None:
    law = Pd(PdGains(kp=1.0, kd=2.8), Coulomb(0.8))

    forward = law.step((1.0, 9.0, 9.0, 0.5), 3.0)
    backward = law.step((3.0, 9.0, 9.0, 0.5), 3.0)

    assert forward == pytest.approx((0.6, 0.8))
    assert backward == pytest.approx((-1.4, -0.8))


def test_pd___no_effort___has_no_compensation() -> None:
    assert Pd().step((0.0, 0.0, 0.0, 0.0), 0.0) == Effort(0.0, 0.0)


def test_pi___step___adds_the_sum_of_the_errors() -> None:
    law = build_law("pi", {"kp": 0.4, "ki": 0.6, "rate_hz": 100.0})
    positions_v = (0.0, 1.0, 2.5, 3.5)
    errors_v = [3.0 - position_v for position_v in positions_v]

    efforts = [law.step((position_v, 0.0, 0.0, 0.0), 3.0) for position_v in positions_v]

    for count, effort in enumerate(efforts, start=1):
        integral_v_s = sum(errors_v[:count]) / 100.0
        assert effort == pytest.approx((0.4 * errors_v[count - 1] + 0.6 * integral_v_s, 0.0))


def test_pi___saturated___does_not_wind_up() -> None:
    law = build_law("pi", {"kp": 5.0, "ki": 2.0})
    for _ in range(3000):
        law.step((0.0, 0.0, 0.0, 0.0), 6.0)

    # Ten seconds of 6 V would have summed up to 60 V s.
    assert law.step((6.0, 0.0, 0.0, 0.0), 6.0) == pytest.approx((0.0, 0.0))


@pytest.mark.parametrize(("error_v", "sums"), [(2.0, False), (-2.0, True)])
def test_pi___cut_by_the_gate___sums_the_errors_that_lead_out_of_it(
    error_v: float, *, sums: bool
) -> None:
    law = build_law("pi", {"kp": 0.4, "ki": 0.6, "rate_hz": 100.0})

    hearing(law)(-0.7, 0.7)
    law.step((-error_v, 0.0, 0.0, 0.0), 0.0)
    hearing(law)(-0.7, 0.0)
    law.step((-1.0, 0.0, 0.0, 0.0), 0.0)

    # What was only late cuts nothing off.
    assert law.memory()["integral_v_s"] == pytest.approx([0.01 + (0.01 * error_v if sums else 0.0)])


def test_pdp___step___is_4_7_without_compensation() -> None:
    law = Pdp(PdpGains(kp=0.5, kd=4.0, ksg=0.25))

    assert law.step((1.0, 7.0, 2.0, 0.1), 3.0) == pytest.approx((1.0 - 0.4 - 0.5, 0.0))


@pytest.mark.parametrize(
    ("error_v", "speed_v", "compensation_v"),
    [
        # Boundaries of (4-8) belong to the compensated side.
        (0.05, 0.0, 0.7),
        (-0.05, 0.0, -0.7),
        (0.0499, 0.05, 0.7),
        (-0.0499, 0.05, -0.7),
        (0.0499, -0.05, 0.7),
        (0.0499, 0.0499, 0.0),
        (-0.0499, -0.0499, 0.0),
        (0.0, 0.0, 0.0),
        # The effort is exactly zero: (4-8) compensates upwards.
        (0.0, 0.05, 0.7),
        (1.0, 0.0, 0.7),
        (1.0, 1.0, 0.7),
        (-1.0, 0.0, -0.7),
    ],
)
def test_pdpc___step___follows_the_truth_table(
    error_v: float, speed_v: float, compensation_v: float
) -> None:
    # Position zero makes the error exactly the reference.
    effort = Pdpc(ONLY_POSITION).step((0.0, 0.0, 0.0, speed_v), error_v)

    assert effort == Effort(error_v, compensation_v)


@pytest.mark.parametrize("compensation", [Compensation(), CompensationLevel()])
def test_pdpc___effort___is_that_of_4_7(compensation: CompensationLevel) -> None:
    law = Pdpc(PdpGains(kp=0.5, kd=4.0, ksg=0.25), compensation)

    effort = law.step((1.0, 7.0, 2.0, 0.1), 3.0)

    assert effort.effort_v == pytest.approx(1.0 - 0.4 - 0.5)


def test_pdpc_unconditional___at_the_set_point___still_compensates() -> None:
    law = Pdpc(ONLY_POSITION, CompensationLevel(0.7))

    assert law.step((0.0, 0.0, 0.0, 0.0), 0.001).compensation_v == 0.7
    assert law.step((0.0, 0.0, 0.0, 0.0), -0.001).compensation_v == -0.7


def test_pdpc___thresholds___come_from_the_compensation() -> None:
    law = Pdpc(ONLY_POSITION, Compensation(0.3, error_threshold_v=0.5, speed_threshold_v=0.2))

    assert law.step((0.0, 0.0, 0.0, 0.1), 0.4).compensation_v == 0.0
    assert law.step((0.0, 0.0, 0.0, 0.2), 0.4).compensation_v == 0.3
    assert law.step((0.0, 0.0, 0.0, 0.1), 0.5).compensation_v == 0.3


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("name", "channel"),
    [
        (name, channel)
        for name in LAWS
        for channel in (0, 3, "reference")
        if channel == "reference" or channel in LAWS[name].uses_outputs
    ],
)
def test_law___input_not_finite___answers_zero(name: str, bad: float, channel: int | str) -> None:
    volts, reference_v = [0.1, 0.2, 0.3, 0.4], 1.0
    if isinstance(channel, int):
        volts[channel] = bad
    else:
        reference_v = bad

    assert build_law(name).step(volts, reference_v) == Effort(0.0, 0.0)


def test_pdpc___middle_strain_not_finite___answers_zero() -> None:
    assert Pdpc().step((0.0, 0.0, math.nan, 0.0), 1.0) == Effort(0.0, 0.0)


@pytest.mark.parametrize("name", LAWS)
def test_law___reset_and_repeat___gives_the_same_answer(name: str) -> None:
    law = build_law(name)
    first = law.step((0.5, 0.1, -0.2, 0.3), 3.0)
    law.step((2.5, 1.0, 1.0, 0.0), -3.0)

    law.reset()

    assert law.step((0.5, 0.1, -0.2, 0.3), 3.0) == pytest.approx(first, rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
def test_build_law___defaults___equal_the_table(name: str) -> None:
    defaults: dict[str, Any] = {spec.name: spec.default for spec in LAWS[name].parameters}
    left_out, given = build_law(name), build_law(name, defaults)

    for sample in range(5):
        volts = (0.1 * sample, 0.2, -0.3, 0.04 * sample)
        assert left_out.step(volts, 3.0) == pytest.approx(given.step(volts, 3.0), rel=1e-9)


def test_laws___defaults___are_those_of_the_thesis_or_tuned() -> None:
    tables = {
        name: {spec.name: spec.default for spec in law.parameters} for name, law in LAWS.items()
    }

    assert tables["pd"] == {"kp": 1.0, "kd": 2.8, "compensation_v": 0.8}
    assert tables["pdp"] == {"kp": 0.5935, "kd": 4.2664, "ksg": 0.2538}
    assert tables["pdpc"] == {
        "kp": 0.4903,
        "kd": 4.3328,
        "ksg": 0.005,
        "compensation_v": 0.7,
        "error_threshold_v": 0.025,
        "speed_threshold_v": 0.08,
    }
    # The reproduction takes the class, whose defaults are Table 4-2 and (4-8).
    assert Pdpc() == Pdpc(PdpGains(0.5935, 4.2664, 0.2538), Compensation(0.7, 0.05, 0.05))


def test_build_law___every_value___reaches_the_law() -> None:
    values = {"kp": 0.1, "kd": 0.2, "ksg": -0.3, "compensation_v": 0.4}

    assert build_law("pdpc_unconditional", values) == Pdpc(
        PdpGains(0.1, 0.2, -0.3), CompensationLevel(0.4)
    )
    assert build_law("pd", {"kp": 0.1, "kd": 0.2, "compensation_v": 0.4}) == Pd(
        PdGains(0.1, 0.2), Coulomb(0.4)
    )
    assert build_law("pdp", {"kp": 0.1, "kd": 0.2, "ksg": -0.3}) == Pdp(PdpGains(0.1, 0.2, -0.3))


@pytest.mark.parametrize("name", LAWS)
def test_build_law___value_out_of_range___is_refused_with_the_range(name: str) -> None:
    for spec in LAWS[name].parameters:
        least, most = spec.bounds
        for value in (least - 1e-3, most + 1e-3, math.nan):
            with pytest.raises(ControlError) as refused:
                build_law(name, {spec.name: value})
            assert f"{spec.name} = " in str(refused.value)
            assert spec.range_text in str(refused.value)


@pytest.mark.slow
def test_build_law___value_at_the_limit___is_accepted() -> None:
    for name, law in LAWS.items():
        for spec in law.parameters:
            for bound in spec.bounds:
                # The payloads of a schedule must increase as well, and a regulator without a weight
                # of the position does not hold the arm.
                if not spec.name.endswith("_kg") and (spec.name, bound) != ("position", 0.0):
                    build_law(name, {spec.name: bound})


def test_build_law___range_message___reads_well() -> None:
    with pytest.raises(ControlError, match=r"PdGains: kp = 7 is outside 0 to 5 V/V; choose"):
        build_law("pd", {"kp": 7.0})


def test_build_law___unknown_name___lists_the_known() -> None:
    with pytest.raises(ControlError, match="no law 'bang'; choose one of pd, pi, pdp, pdpc, "):
        build_law("bang")


@pytest.mark.parametrize("name", ["pd", "pdpc", "pdpc_unconditional", "pdpc_plus"])
def test_law___beyond_the_drive___keeps_the_compensation_and_cuts_the_effort(name: str) -> None:
    law = build_law(name, {"kp": 5.0, "compensation_v": 0.6})

    assert law.step((0.0, 0.0, 0.0, 0.0), 6.0) == pytest.approx((9.4, 0.6))
    assert law.step((6.0, 0.0, 0.0, 0.0), -6.0) == pytest.approx((-9.4, -0.6))


def test_build_law___unknown_parameter___lists_the_known() -> None:
    with pytest.raises(ControlError, match="pd has no parameter 'ksg'; it has kp, kd"):
        build_law("pd", {"ksg": 0.1})
