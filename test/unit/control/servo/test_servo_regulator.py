"""Servo design: margins beside python-control's, rest in closed form, refusals in one line."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest
from scipy.linalg import block_diag

from flexarm_control.servo.job import ServoRequest, Source, design_servo
from flexarm_control.servo.regulator import (
    FILTERS,
    Filter,
    _below,
    design_regulator,
    loop_plant,
    loop_radius,
    tracked_outputs,
)
from flexarm_control.servo.robustness import (
    BELOW_VIBRATION,
    Choice,
    attainable_hz,
    choose_bandwidth,
    loop_frequencies_hz,
    loop_margin,
    sensitivities,
    slowest_vibration_hz,
    variations,
    vibrations,
    with_modes,
)
from flexarm_control.servo.set_point import plan_for
from flexarm_core.errors import SettingError
from support.servo_plants import DT_S, bending_arm, sampled, two_joints

if TYPE_CHECKING:
    from collections.abc import Sequence


def test_design_regulator___bending_arm___is_stable_at_every_bandwidth() -> None:
    plant = loop_plant(bending_arm())

    for bandwidth_hz in (0.2, 1.0, 4.0):
        assert loop_radius(design_regulator(plant, (0,), bandwidth_hz), plant) < 1.0


def test_design_regulator___other_units___gives_the_same_loop() -> None:
    model = bending_arm()
    scaled = control.StateSpace(model.A, model.B * 1e3, model.C * 1e-4, 0.0, DT_S)

    one, other = (
        loop_margin(design_regulator(plant, (0,), 1.0), plant)
        for plant in (loop_plant(model), loop_plant(scaled))
    )

    assert other.disk == pytest.approx(one.disk, rel=1e-4)


def test_slowest_vibration___of_a_hub___is_that_with_the_hub_held() -> None:
    # 20 / s^2 + 0.8 * 60 / (s^2 + w^2) is zero at w sqrt(20 / 68).
    plant = bending_arm(outputs=1)
    assert slowest_vibration_hz(plant, [0]) == pytest.approx(8.0 * math.sqrt(20.0 / 68.0), rel=1e-2)
    assert slowest_vibration_hz(plant, []) == pytest.approx(8.0, rel=1e-6)
    choice = choose_bandwidth(
        {"arm": loop_plant(plant)}, [0], robustness=0.1, limits=np.array([np.inf])
    )
    assert choice.regulator.bandwidth_hz <= slowest_vibration_hz(plant, [0]) / BELOW_VIBRATION


def tip_of_an_arm() -> control.StateSpace:
    """Return the arm seen at its tip, where the vibration has the other sign."""
    arm = bending_arm(outputs=1)
    names = {"inputs": arm.input_labels, "outputs": ["tip"]}
    return control.StateSpace(arm.A, arm.B, [[1.0, 0.0, -1.0, 0.0]], 0.0, DT_S, **names)


def test_attainable___of_a_tip___is_half_of_its_zero_outside_the_circle() -> None:
    # 20 / s^2 - 60 / (s^2 + w^2) is zero at plus and minus w / sqrt(2).
    assert attainable_hz(tip_of_an_arm(), [0]) == pytest.approx(4.0 / math.sqrt(2.0), rel=2e-2)
    # A hub has none, nor have fewer set-points than inputs.
    assert attainable_hz(bending_arm(outputs=1), [0]) == math.inf
    assert attainable_hz(two_joints(), [0]) == math.inf


@pytest.mark.slow
def test_design_servo___tip___reports_what_is_attainable() -> None:
    limits = {"torque": 50.0}
    hub, tip = (
        design_servo([Source("arm", arm)], ServoRequest((track,), limits, 1.0))
        for arm, track in ((bending_arm(), "hub"), (tip_of_an_arm(), "tip"))
    )
    assert not any("non-minimum phase" in note for note in hub.notes)
    (note,) = (note for note in tip.notes if "non-minimum phase" in note)
    assert "tip first moves backwards" in note
    assert "zero outside the unit circle at 5.6" in note
    assert "about 2.8 Hz" in note
    # It does so on the twin as well, and comes to rest on its set-point.
    first = tip.run.y[: round(0.05 / DT_S), 0] / tip.steps[0]
    assert first.min() < -1e-4
    assert tip.results[0].steady_error == pytest.approx(0.0, abs=1e-3)


def test_plan___of_an_arm___neither_excites_its_vibration_nor_waits_a_period_too_long() -> None:
    """A mean over whole periods of a mode has no part at its frequency (Singer and Seering)."""
    plant = loop_plant(bending_arm(outputs=1))
    no_limit = np.array([np.inf])
    for bandwidth_hz in (0.3, 0.5, 3.0):
        found = design_regulator(plant, (0,), bandwidth_hz)
        long, _ = plan_for(found, no_limit, np.zeros(1)).windows
        poles = np.log(np.linalg.eigvals(found.following.A).astype(complex)) / DT_S
        slow = min(poles[poles.imag > -3.0 * poles.real], key=lambda pole: pole.imag)
        passed = np.mean(np.exp(1j * slow.imag * DT_S * np.arange(long)))
        assert abs(passed) < 0.02
        assert abs(long * DT_S - 0.7 / bandwidth_hz) < 1.01 * np.pi / slow.imag


def test_loop_margin___one_input___is_that_of_python_control() -> None:
    plant = loop_plant(bending_arm(outputs=1))
    found = design_regulator(plant, (0,), 2.0)
    loop = -found.controller * plant
    omega = 2.0 * np.pi * loop_frequencies_hz(found, plant)

    expected, *_ = control.disk_margins(control.ss(loop), omega)

    # One input and one output: both loops are the same one.
    assert loop_margin(found, plant).disk == pytest.approx(expected, rel=1e-6)


def test_loop_margin___two_inputs___holds_for_the_gains_that_it_allows() -> None:
    plant = loop_plant(two_joints())
    found = design_regulator(plant, (0, 1), 1.0)
    share = 0.5 * 0.99 * loop_margin(found, plant).disk

    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        gains = [(1.0 + sign * share) / (1.0 - sign * share) for sign in signs]
        changed = control.StateSpace(plant.A, plant.B * gains, plant.C, 0.0, DT_S)
        assert loop_radius(found, changed) < 1.0


def test_sensitivities___at_rest___leave_no_error_of_a_tracked_output() -> None:
    plant = loop_plant(two_joints())
    found = design_regulator(plant, (0, 1), 1.0)

    _, outer = sensitivities(found, plant, np.array([1e-4]))

    assert np.abs(outer[0, :2, :2]).max() < 1e-3


def test_controller___wrong_gain_and_a_bias___comes_to_rest_on_the_set_point() -> None:
    plant = loop_plant(bending_arm())
    found = design_regulator(plant, (0,), 2.0)
    law, goal, bias = found.controller, 0.7, np.array([0.0, 0.05])
    at_rest = np.append(found.rest[:, 0], np.zeros(len(found.A) - plant.nstates))
    planned = found.forward[0][:, 0] + (found.feedback - found.planning) @ at_rest
    x, z = np.zeros(plant.nstates), np.zeros(law.nstates)
    y = np.zeros(2)
    for _ in range(20_000):
        y = plant.C @ x
        # The filter moves with the whole command: the set-point enters behind its prediction.
        u = law.C @ z + law.D @ (y + bias) + planned * goal
        z = law.A @ z + law.B @ (y + bias) + found.B @ planned * goal
        x = plant.A @ x + 0.7 * plant.B @ (u + 0.3)

    assert y[0] == pytest.approx(goal, abs=1e-6)


def test_variations___bending_arm___move_its_vibration_alone() -> None:
    plant = bending_arm()

    found = variations("arm", plant)

    for name, factor in (("all vibrations +20 %", 1.2), ("the slowest vibration -20 %", 0.8)):
        poles = np.log(np.linalg.eigvals(found[f"arm, {name}"].A).astype(complex)) / DT_S
        assert np.abs(poles).max() == pytest.approx(factor * 2.0 * math.pi * 8.0, rel=1e-6)
        assert np.sort(np.abs(poles))[:2] == pytest.approx([0.0, 0.5], abs=1e-6)


def _refused(model: control.StateSpace, *track: str, **request: object) -> str:
    with pytest.raises(SettingError) as caught:
        design_servo([Source("plant", model)], ServoRequest(track, {}, **request))  # type: ignore[arg-type]
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_design_servo___unknown_output___names_the_nearest() -> None:
    assert "nearest: hub" in _refused(bending_arm(), "hubb")


def test_design_servo___unknown_limit___names_the_input() -> None:
    with pytest.raises(SettingError, match="torque"):
        design_servo([Source("plant", bending_arm())], ServoRequest(("hub",), {"torqe": 1.0}))


def test_design_servo___more_tracks_than_inputs___says_so() -> None:
    assert "1 input" in _refused(bending_arm(), "hub", "bend")


def test_design_servo___output_without_gain_at_rest___is_refused() -> None:
    assert "at rest" in _refused(bending_arm(), "bend")


def test_design_servo___output_that_no_input_moves___is_refused() -> None:
    model = bending_arm()
    apart = control.StateSpace(
        np.block([[model.A, np.zeros((4, 1))], [np.zeros((1, 4)), 0.9 * np.eye(1)]]),
        np.vstack([model.B, [[0.0]]]),
        np.block([[model.C, np.zeros((2, 1))], [np.zeros((1, 4)), np.eye(1)]]),
        0.0,
        DT_S,
        inputs=["torque"],
        outputs=["hub", "bend", "room"],
    )

    assert "at rest" in _refused(apart, "room")


def test_roll_off___takes_each_mode_by_a_low_pass() -> None:
    # It is an eigenvector of the map: the gain is Butterworth's at the frequency of Tustin.
    speed = 2.0 * math.pi * 40.0
    plant = sampled([[0.0, 1.0], [-(speed**2), 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    shape = np.linalg.eig(plant.A)[1][:, 0]

    passed = np.linalg.norm(_below(plant, 3.0) @ shape)

    tustin_hz = math.tan(math.pi * 40.0 * DT_S) / (math.pi * DT_S)
    assert passed == pytest.approx(1.0 / math.sqrt(1.0 + (tustin_hz / 3.0) ** 4), rel=1e-6)


@pytest.mark.slow
def test_choose_bandwidth___margin_that_none_has___gives_a_design_with_a_caution() -> None:
    plants = {"arm": loop_plant(bending_arm())}

    choice = choose_bandwidth(plants, [0], robustness=1.9, limits=np.array([3.0]))

    assert loop_radius(choice.regulator, plants["arm"]) < 1.0
    name, worst = choice.worst
    assert f"with {name} the largest is {worst.disk:.2f}" in choice.caution
    slower = design_regulator(plants["arm"], [0], 0.2)
    assert worst.disk >= 0.9 * min(
        loop_margin(slower, each).disk for each in variations("arm", plants["arm"]).values()
    )
    enough = choose_bandwidth(plants, [0], robustness=0.5, limits=np.array([3.0]))
    assert not enough.caution


@pytest.mark.slow
@pytest.mark.exhaustive
def test_choose_bandwidth___each_filter_alone___gives_no_larger_one() -> None:
    plants = {"arm": loop_plant(bending_arm(), 0.004)}

    def chosen(filters: Sequence[Filter]) -> Choice:
        limits = np.array([3.0])
        return choose_bandwidth(plants, [0], robustness=0.8, limits=limits, filters=filters)

    best, alone = chosen(FILTERS), [chosen((each,)) for each in FILTERS]

    assert best.worst[1].disk >= 0.8
    largest_hz = max(each.regulator.bandwidth_hz for each in alone if not each.caution)
    # The search halves an interval of half an octave three times.
    assert best.regulator.bandwidth_hz >= 0.95 * largest_hz
    assert len({each.regulator.bandwidth_hz for each in alone}) > 1


def test_forward___mode_that_creeps___changes_no_gain_of_a_move() -> None:
    # A lag, and beside it a time constant of hours that is hardly moved and hardly seen.
    A, B, C = np.diag([0.99, 1.0 - 1e-7]), np.array([[1.0], [1e-4]]), np.array([[1.0, 1e-4]])
    plants = (
        control.StateSpace(A[:n, :n], B[:n], C[:, :n], 0.0, DT_S, inputs=["u"], outputs=["y"])
        for n in (1, 2)
    )

    plain, creeping = (design_regulator(loop_plant(each), (0,), 1.0).forward for each in plants)

    np.testing.assert_allclose(creeping, plain, rtol=1e-4, atol=1e-9)


def test_design_servo___limit_that_hardly_moves_the_arm___is_reported() -> None:
    request = ServoRequest(("hub",), {"torque": 1e-9})
    with pytest.raises(SettingError, match=r"a step would take .* s within .*say larger ones"):
        design_servo([Source("arm", bending_arm())], request)


@pytest.mark.parametrize("side", ["input", "output"])
def test_design_servo___hidden_unstable_mode___is_refused_as_a_cancellation(side: str) -> None:
    B, C = ([[1.0], [0.0]], [[1.0, 1.0]]) if side == "input" else ([[1.0], [1.0]], [[1.0, 0.0]])
    model = control.StateSpace(np.diag([0.9, 1.02]), B, C, 0.0, DT_S, outputs=["y"])

    assert f"no {side}" in _refused(model, "y")


def test_design_servo___pole_that_a_zero_nearly_cancels___is_refused() -> None:
    # The loop is stable on paper; a gain that is .1 % off ends that.
    model = control.StateSpace(
        np.diag([0.9, 1.02]), [[1.0], [1e-3]], [[1.0, 1.0]], 0.0, DT_S, outputs=["y"]
    )

    assert "nearly cancels an unstable pole" in _refused(model, "y")


def test_design_servo___bandwidth_beyond_the_rate___is_refused() -> None:
    assert "half of the rate, 250 Hz" in _refused(bending_arm(), "hub", bandwidth_hz=300.0)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_design_servo___pair_slower_than_the_record___is_no_vibration() -> None:
    arm = bending_arm()
    drift = np.exp(2.0 * np.pi * 0.02 * DT_S * complex(-0.05, 1.0))
    model = control.StateSpace(
        block_diag(arm.A, [[drift.real, drift.imag], [-drift.imag, drift.real]]),
        np.vstack([arm.B, [[1e-4], [0.0]]]),
        np.hstack([arm.C, [[1.0, 0.0], [0.0, 0.0]]]),
        0.0,
        DT_S,
        inputs=arm.input_labels,
        outputs=arm.output_labels,
    )
    ends = {"input_low": [-1.0], "input_high": [1.0]}
    ends |= {"output_low": [-1.0, -1.0], "output_high": [1.0, 1.0]}

    source = Source("arm", model, facts={**ends, "record_s": [10.0]})
    design = design_servo([source], ServoRequest(("hub",), {}))

    # A record of 10 s has a fifth of a period, one of 1000 s has twenty.
    alone = slowest_vibration_hz(loop_plant(arm), [0])
    plant = loop_plant(model)
    assert slowest_vibration_hz(plant, [0], source.shown_hz) == pytest.approx(alone, rel=0.01)
    assert slowest_vibration_hz(plant, [0], 0.003) == pytest.approx(0.02, rel=0.1)
    assert design.gains.bandwidth_hz > 0.5


@pytest.mark.slow
def test_design_servo___several_models___have_the_margin_with_each() -> None:
    arm = bending_arm()
    (mode,) = vibrations(arm)
    slower = with_modes(arm, {mode: 0.7 + 0.0j})
    sources = [Source("empty", arm), Source("loaded", slower)]
    request = ServoRequest(("hub",), {"torque": 3.0})

    both, first = design_servo(sources, request), design_servo(sources[:1], request)

    found = both.choice.regulator
    for name, model in (("empty", arm), ("loaded", slower)):
        for said, plant in variations(name, loop_plant(model)).items():
            assert both.choice.margins[said].disk == pytest.approx(loop_margin(found, plant).disk)
            assert both.choice.margins[said].disk >= 0.5
    assert both.gains.disk_margin == pytest.approx(min(both.choice.ranked))
    assert both.gains.bandwidth_hz < first.gains.bandwidth_hz


@pytest.mark.slow
@pytest.mark.exhaustive
def test_design_servo___bandwidth_that_a_second_model_does_not_bear___is_refused() -> None:
    model = bending_arm()
    other = control.StateSpace(
        model.A, -model.B, model.C, 0.0, DT_S, inputs=["torque"], outputs=["hub", "bend"]
    )
    sources = [Source("one", model), Source("other", other)]

    with pytest.raises(SettingError, match="no stabilising design"):
        design_servo(sources, ServoRequest(("hub",), {}, bandwidth_hz=1.0))
    with pytest.raises(SettingError, match="no stabilising design"):
        design_servo(sources, ServoRequest(("hub",), {}))


def test_tracked_outputs___none___names_the_outputs() -> None:
    with pytest.raises(SettingError, match="hub, bend"):
        tracked_outputs(["torque"], ["hub", "bend"], ())


def test_loop_plant___feedthrough___becomes_a_state_of_the_input_in_force() -> None:
    model = sampled([[-1.0]], [[1.0]], [[1.0]], [[2.0]])

    plant = loop_plant(model)

    assert plant.nstates == 2
    assert not plant.D.any()
