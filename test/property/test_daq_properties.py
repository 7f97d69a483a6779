from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.loop.limiter import Limiter, LimiterSettings
from flexarm_daq.loop.watchdog import Watchdog
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.plant import Plant
from support.rig_physics import arm_angle_rad, energy_j

ANY_FLOAT = st.floats(allow_nan=True, allow_infinity=True)
VOLTS = st.floats(-20.0, 20.0)
REQUESTS = st.lists(
    st.tuples(
        VOLTS | ANY_FLOAT,
        st.floats(-1.0, 1.0) | ANY_FLOAT,
        st.floats(-8.0, 8.0) | ANY_FLOAT,
        st.floats(0.0, 0.01) | ANY_FLOAT,
    ),
    min_size=1,
    max_size=20,
)
SETTINGS = st.builds(
    LimiterSettings,
    max_command_v=st.floats(0.1, 10.0),
    max_slew_v_per_s=st.floats(1.0, 1e4),
    position_bound_v=st.floats(0.1, 7.0),
)


@given(SETTINGS, REQUESTS)
def test_limiter___any_requests___stays_within_every_limit(
    limits: LimiterSettings, requests: list[tuple[float, float, float, float]]
) -> None:
    limiter = Limiter(limits.limits())
    last_v = 0.0
    for request in requests:
        _, _, position_v, interval_s = request
        command_v, compensation_v, reasons = limiter.apply(*request)
        assert math.isfinite(command_v)
        assert abs(command_v) <= limits.max_command_v
        if command_v != 0.0:
            allowed_v = limits.max_slew_v_per_s * max(interval_s, 0.0)
            assert abs(command_v - last_v) <= allowed_v + 1e-9
            assert not (abs(position_v) > limits.position_bound_v and command_v * position_v > 0.0)
        if reasons:
            assert abs(compensation_v) <= abs(command_v)
            assert compensation_v * command_v >= 0.0
        last_v = command_v


@given(st.floats(-4.0, 4.0), st.floats(-1.0, 1.0), st.floats(-6.5, 6.5))
def test_limiter___moderate_request___passes_untouched(
    effort_v: float, compensation_v: float, position_v: float
) -> None:
    limited = Limiter(LimiterSettings().limits()).apply(
        effort_v, compensation_v, position_v, 1.0 / 300.0
    )
    assert limited == (effort_v + compensation_v, compensation_v, ())


@given(st.lists(st.tuples(st.integers(0, 8), st.integers(1, 4)), max_size=40))
def test_watchdog___any_history___judges_by_the_sample_of_the_last_command(
    events: list[tuple[int, int]],
) -> None:
    """Each event is a period later than the one before and answers a sample that many back."""
    watchdog = Watchdog(1.0, max_age_periods=3)
    taken: list[int] = []
    answered: int | None = None
    for back, periods in events:
        now = (taken[-1] if taken else 0) + periods
        if answered is not None and now - answered >= 3:
            answered = None
        assert watchdog.stale(now, float(now)) is (answered is None)
        taken.append(now)
        wanted = taken[max(len(taken) - 1 - back, 0)]
        assert watchdog.in_time(wanted) is (now - wanted < 2)
        if now - wanted < 3:
            watchdog.fed(wanted)
            answered = wanted


@settings(max_examples=30)
@given(
    st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=60),
    st.floats(0.0, 0.5),
    st.floats(0.0, 0.01),
)
def test_plant___any_commands___stays_finite_and_near_its_travel(
    command_v: list[float], payload_kg: float, interval_s: float
) -> None:
    plant = Plant(RigParameters(payload_kg=payload_kg))
    for volts in command_v:
        plant.advance(volts, interval_s)
    assert np.isfinite(plant.state).all()
    assert math.isfinite(energy_j(plant))
    assert abs(arm_angle_rad(plant)) < math.radians(100.0)


@settings(max_examples=30)
@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=40))
def test_plant___mirrored_commands___mirror_the_motion(command_v: list[float]) -> None:
    plant, mirror = Plant(RigParameters()), Plant(RigParameters())
    for volts in command_v:
        plant.advance(volts, 0.01)
        mirror.advance(-volts, 0.01)
    np.testing.assert_array_equal(mirror.state, -plant.state)


@settings(max_examples=30)
@given(st.floats(0.0, 0.5), st.floats(0.01, 0.5))
def test_beam___heavier_payload___lowers_every_mode(payload_kg: float, added_kg: float) -> None:
    light = natural_frequencies_hz(RigParameters(payload_kg=payload_kg))
    heavy = natural_frequencies_hz(RigParameters(payload_kg=payload_kg + added_kg))
    assert (heavy < light).all()
    assert (np.diff(light) > 0.0).all()


@settings(max_examples=30)
@given(st.integers(0, 2**32), st.lists(VOLTS, max_size=30))
def test_rig___any_commands___reads_codes_within_the_range(
    seed: int, command_v: list[float]
) -> None:
    rig = SimulatedRig(seed=seed)
    rig.open()
    for volts in command_v:
        reading = rig.read().outputs
        assert (reading >= -10.0).all()
        assert (reading < 10.0).all()
        rig.write([volts])
