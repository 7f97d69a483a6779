"""What holds for every law, reference and step response."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, reject
from hypothesis import strategies as st

from flexarm_control import (
    LAWS,
    REFERENCES,
    Pdp,
    Pdpc,
    build_law,
    build_reference,
    step_figures,
)
from flexarm_control.laws.switching import FADE_V, Handover
from flexarm_core.channels import TRAVEL_V
from flexarm_core.errors import SettingError
from flexarm_daq.loop.limiter import LimiterSettings

if TYPE_CHECKING:
    from flexarm_control.laws.law_protocol import LawWithMemory

FINITE = st.floats(allow_nan=False, allow_infinity=False)
ANY = st.floats()
VOLTS = st.floats(-10.0, 10.0)
WITH_REST = {"lqg", "pdpc_plus", "planned"}
"""Laws whose compensation is not a switch of one level: at the set-point they help the bent arm."""


def _values(table: dict[str, object], names: st.SearchStrategy[str]) -> st.SearchStrategy[object]:
    def values_of(name: str) -> st.SearchStrategy[tuple[str, dict[str, float]]]:
        parameters = table[name].parameters  # type: ignore[attr-defined]
        values = {
            spec.name: st.integers(spec.minimum, spec.maximum)
            if isinstance(spec.default, int)
            else st.floats(spec.minimum, spec.maximum)
            for spec in parameters
        }
        return st.tuples(st.just(name), st.fixed_dictionaries(values))

    return names.flatmap(values_of)


def built(name: str, values: dict[str, float]) -> LawWithMemory:
    """Return a law; one that refuses its values, in a clear error, is not an example."""
    try:
        return build_law(name, values)
    except SettingError:
        reject()


LAW_VALUES = _values(dict(LAWS), st.sampled_from(sorted(LAWS)))
SIMPLE_REFERENCES = _values(
    dict(REFERENCES), st.sampled_from(["constant", "step", "square", "sine", "triangle"])
)


@given(LAW_VALUES, st.tuples(ANY, ANY, ANY, ANY), ANY)
def test_law___any_input_at_all___has_finite_outputs(
    law: tuple[str, dict[str, float]], volts: tuple[float, ...], reference_v: float
) -> None:
    effort = built(*law).step(volts, reference_v)

    assert math.isfinite(effort.effort_v)
    assert math.isfinite(effort.compensation_v)


@given(LAW_VALUES, st.lists(st.tuples(FINITE, FINITE, FINITE, FINITE, FINITE), max_size=8))
def test_law___any_finite_sequence___stays_finite_and_within_the_drive(
    law: tuple[str, dict[str, float]], samples: list[tuple[float, ...]]
) -> None:
    stepper = built(*law)
    for *volts, reference_v in samples:
        effort = stepper.step(volts, reference_v)

        assert math.isfinite(effort.effort_v)
        assert math.isfinite(effort.compensation_v)
        assert abs(sum(effort)) <= 10.0 + 1e-9


@given(
    st.tuples(LAW_VALUES, LAW_VALUES),
    st.lists(st.tuples(VOLTS, VOLTS, VOLTS, VOLTS, st.floats(-6.0, 6.0)), min_size=2, max_size=12),
    st.integers(1, 11),
)
def test_switch___any_two_laws___moves_the_command_by_no_more_than_the_slew_limit(
    laws: tuple[tuple[str, dict[str, float]], ...], samples: list[tuple[float, ...]], at: int
) -> None:
    handover, alone = Handover(built(*laws[0])), built(*laws[1])
    before_v, alone_before_v = 0.0, 0.0
    for number, (*volts, reference_v) in enumerate(samples):
        if number == at:
            handover.replace(built(*laws[1]))
        command_v = sum(handover.step(volts, reference_v))
        if number == at:
            # Whatever either law wants: the command stays where it was.
            assert abs(command_v - before_v) <= 1e-9
        if number >= at:
            alone_v = sum(alone.step(volts, reference_v))
            if number > at:
                # From then on it moves with the new law, and fades.
                allowed_v = abs(alone_v - alone_before_v) + FADE_V + 1e-9
                assert abs(command_v - before_v) <= allowed_v
            alone_before_v = alone_v
        before_v = command_v
    assert LimiterSettings().max_slew_v_per_s >= FADE_V * 300.0


@given(
    _values(dict(LAWS), st.sampled_from(sorted(set(LAWS) - WITH_REST))),
    st.tuples(VOLTS, VOLTS, VOLTS, VOLTS),
    VOLTS,
)
def test_law___any_measurement___compensates_along_the_effort(
    law: tuple[str, dict[str, float]], volts: tuple[float, ...], reference_v: float
) -> None:
    effort = built(*law).step(volts, reference_v)

    level_v = law[1].get("compensation_v", 0.0)
    assert abs(effort.compensation_v) in (0.0, level_v)
    assert effort.compensation_v * effort.effort_v >= 0.0


@given(
    _values(dict(LAWS), st.sampled_from(["lqg", "pdpc_plus"])),
    st.tuples(VOLTS, VOLTS, VOLTS, VOLTS),
    VOLTS,
)
def test_law_with_a_rest___any_measurement___compensates_along_the_effort_or_helps_the_bent_arm(
    law: tuple[str, dict[str, float]], volts: tuple[float, ...], reference_v: float
) -> None:
    effort = built(*law).step(volts, reference_v)

    _, values = law
    help_v = -math.copysign(values["release_v"], volts[1])
    if effort.compensation_v * effort.effort_v < 0.0:
        assert 0.0 < effort.compensation_v / help_v <= 1.0
    assert abs(effort.compensation_v) <= max(values["compensation_v"], values["release_v"])


@given(st.tuples(VOLTS, VOLTS, VOLTS, VOLTS), VOLTS)
def test_pdpc___any_measurement___is_4_8_in_words(
    volts: tuple[float, ...], reference_v: float
) -> None:
    effort = Pdpc().step(volts, reference_v)

    moving = abs(reference_v - volts[0]) >= 0.05 or abs(volts[3]) >= 0.05
    expected_v = (0.7 if effort.effort_v >= 0 else -0.7) if moving else 0.0
    assert effort.compensation_v == expected_v
    total_v = Pdp().step(volts, reference_v).effort_v + expected_v
    assert math.isclose(sum(effort), min(10.0, max(-10.0, total_v)), abs_tol=1e-9)


@given(SIMPLE_REFERENCES, st.floats(0.0, 1e6))
def test_reference___any_time___stays_within_the_travel(
    reference: tuple[str, dict[str, float]], time_s: float
) -> None:
    name, values = reference
    amplitude_v, offset_v = abs(values["amplitude_v"]), values.get("offset_v", 0.0)
    if amplitude_v + abs(offset_v) > TRAVEL_V:
        with pytest.raises(SettingError, match="leaves the travel"):
            build_reference(name, values)
        return

    value_v = build_reference(name, values)(time_s)

    assert abs(value_v) <= TRAVEL_V * (1.0 + 1e-12)
    distance_v = abs(value_v - offset_v)
    assert distance_v <= amplitude_v * (1.0 + 1e-12) + 1e-12
    if name in {"constant", "step", "square"}:
        assert min(distance_v, abs(distance_v - amplitude_v)) <= 1e-12


@given(
    st.floats(-6.0, 6.0),
    st.tuples(st.floats(0.1, 10.0), st.floats(0.1, 10.0)),
    st.integers(0, 2**31 - 1),
    st.floats(0.0, 1e6),
)
def test_varying_square___same_seed___gives_the_same_value(
    amplitude_v: float, lengths_s: tuple[float, float], seed: int, time_s: float
) -> None:
    values = {
        "amplitude_v": amplitude_v,
        "shortest_s": min(lengths_s),
        "longest_s": max(lengths_s),
        "seed": seed,
    }

    value_v = build_reference("varying_square", values)(time_s)

    assert value_v == build_reference("varying_square", values)(time_s)
    assert abs(value_v) == abs(amplitude_v)


@given(
    st.lists(st.floats(-2.0, 2.0), min_size=2, max_size=40),
    st.floats(0.1, 5.0),
    st.floats(-3.0, 3.0),
    st.sampled_from([-1.0, 1.0]),
)
def test_step_figures___scaled_and_shifted___keep_their_ratios(
    progress: list[float], height_v: float, start_v: float, direction: float
) -> None:
    # A sixteenth keeps the bands' comparisons away from rounding.
    steps = np.round(np.array(progress) * 16) / 16
    time_s = 0.1 * np.arange(len(steps))
    plain = step_figures(time_s, steps, 1.0)

    reference_v = start_v + direction * height_v
    moved = step_figures(time_s, start_v + direction * height_v * steps, reference_v, start_v)

    assert math.isclose(moved.overshoot, plain.overshoot, abs_tol=1e-9)
    assert moved.settling_s == plain.settling_s
    assert moved.rise_s == plain.rise_s
    error_v = direction * height_v * plain.mean_error_v
    assert math.isclose(moved.mean_error_v, error_v, abs_tol=1e-9)
