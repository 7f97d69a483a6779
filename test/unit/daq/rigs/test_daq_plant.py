from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.rigs import plant as plant_module
from flexarm_daq.rigs.beam import arm_modes
from flexarm_daq.rigs.equations import ARM, MOTOR, POSITION, VELOCITY
from flexarm_daq.rigs.plant import Plant, simulate
from flexarm_daq.rigs.rig_parameters import RigParameters
from support.rig_physics import arm_angle_rad, arm_inertia_kg_m2, energy_j

RATE_HZ = 300.0
RIG = RigParameters(loop_delay_s=0.0)
FRICTIONLESS = replace(RIG, coulomb_friction_nm=0.0, viscous_friction_nm_s_per_rad=0.0)
CONSERVATIVE = replace(
    RIG,
    coulomb_friction_nm=0.0,
    backlash_deg=0.0,
    gear_damping_nm_s_per_rad=0.0,
    viscous_friction_nm_s_per_rad=0.0,
    mass_damping_per_s=0.0,
    stiffness_damping_s=0.0,
)


def momentum(plant: Plant) -> float:
    """Return the angular momentum about the axis; the flexible modes carry none."""
    rig = plant.parameters
    arm_inertia = arm_inertia_kg_m2(rig)
    motor = rig.motor_inertia_kg_m2 * plant.state[VELOCITY, MOTOR]
    return float(motor + math.sqrt(arm_inertia) * plant.state[VELOCITY, ARM])


def test_gauges___under_a_steady_push___read_positive_at_the_base_negative_in_the_middle() -> None:
    # Before the stop, over whole periods of the first mode.
    outputs_v = simulate(Plant(RIG), np.full(150, 2.0), RATE_HZ)
    assert outputs_v[:, 1].mean() > 0.5
    assert outputs_v[:, 2].mean() < -0.05
    assert outputs_v[-1, 0] > 0.0
    assert outputs_v[-1, 3] > 0.0


@pytest.mark.parametrize("command_v", [0.70, -0.70])
def test_motor___below_break_away___never_moves(command_v: float) -> None:
    plant = Plant(RIG)
    for _ in range(20):
        plant.advance(command_v, 3.0)
    assert not plant.state.any()


@pytest.mark.parametrize("command_v", [0.71, -0.71])
def test_motor___above_break_away___moves_its_way(command_v: float) -> None:
    plant = Plant(RIG)
    plant.advance(command_v, 1.0)
    assert arm_angle_rad(plant) * np.sign(command_v) > 0.05


def test_arm___on_a_slow_ramp___is_seen_to_break_away_at_three_quarters_of_a_volt() -> None:
    command_v = 0.2 * np.arange(0.0, 5.0, 1.0 / RATE_HZ)
    position_v = simulate(Plant(RIG), command_v, RATE_HZ)[:, 0]
    assert 0.74 <= command_v[np.argmax(position_v > 0.05)] <= 0.76


def test_motor___after_a_push___comes_to_rest_for_good() -> None:
    plant = Plant(RIG)
    plant.advance(1.5, 0.5)
    plant.advance(0.0, 60.0)
    rested_rad = plant.state[POSITION, MOTOR]
    plant.advance(0.0, 60.0)
    assert plant.state[POSITION, MOTOR] == rested_rad
    assert plant.state[VELOCITY, MOTOR] == 0.0


@pytest.mark.parametrize("backlash_deg", [0.0, 0.2, 1.0])
def test_energy___over_10_s_without_losses___is_conserved(backlash_deg: float) -> None:
    # Between teeth that hit each other, too.
    plant = Plant(replace(CONSERVATIVE, backlash_deg=backlash_deg))
    plant.state[VELOCITY, ARM : ARM + 3] = (0.02, 0.4, 0.2)
    start_j = energy_j(plant)
    history_j = []
    for _ in range(3000):
        plant.advance(0.0, 1.0 / RATE_HZ)
        history_j.append(energy_j(plant))
    np.testing.assert_allclose(history_j, start_j, rtol=2e-3)
    assert np.mean(history_j[-300:]) == pytest.approx(np.mean(history_j[:300]), rel=5e-4)


def test_energy___at_the_stop_without_losses___comes_back() -> None:
    plant = Plant(replace(CONSERVATIVE, stop_damping_nm_s_per_rad=0.0))
    plant.state[VELOCITY, ARM] = 0.5
    start_j = energy_j(plant)
    for _ in range(700):
        plant.advance(0.0, 1.0 / RATE_HZ)
    assert plant.state[VELOCITY, ARM] < 0.0
    assert energy_j(plant) == pytest.approx(start_j, rel=1e-3)


def test_energy___of_the_whole_rig_left_alone___never_grows() -> None:
    plant = Plant(RIG)
    plant.state[VELOCITY, ARM : ARM + 3] = (0.5, 0.4, 0.2)
    history_j = []
    for _ in range(1500):
        history_j.append(energy_j(plant))
        plant.advance(0.0, 1.0 / RATE_HZ)
    assert (np.diff(history_j) <= 1e-6 * history_j[0]).all()
    assert history_j[-1] < 0.5 * history_j[0]


@pytest.mark.parametrize("backlash_deg", [0.0, 0.2])
def test_momentum___without_friction___grows_by_the_torque(backlash_deg: float) -> None:
    rig = replace(
        FRICTIONLESS, mass_damping_per_s=0.0, stiffness_damping_s=0.0, backlash_deg=backlash_deg
    )
    plant = Plant(rig)
    plant.advance(1.5, 0.4)
    assert momentum(plant) == pytest.approx(0.55 * 1.5 * 0.4, rel=1e-9)


def test_momentum___of_a_sliding_motor___grows_by_the_torque_less_friction() -> None:
    rig = replace(CONSERVATIVE, coulomb_friction_nm=0.3, breakaway_ratio=1.0)
    plant = Plant(rig)
    plant.state[VELOCITY, MOTOR] = 3.0
    plant.state[VELOCITY, ARM:] = 3.0 * arm_modes(rig).hub_angle[0] ** -1 * np.eye(7)[0]
    start = momentum(plant)
    plant.advance(2.0, 0.2)
    assert momentum(plant) - start == pytest.approx((0.55 * 2.0 - 0.3) * 0.2, rel=1e-9)


def test_arm___driven_into_the_stop___rests_just_beyond_it() -> None:
    plant = Plant(RIG)
    plant.advance(2.0, 30.0)
    pushed_rad = math.radians(80.0) + 2.0 * RIG.motor_gain_nm_per_v / RIG.stop_stiffness_nm_per_rad
    assert math.radians(80.0) < arm_angle_rad(plant) < pushed_rad


def test_motor___within_the_gap___leaves_the_arm_alone() -> None:
    plant = Plant(RIG)
    plant.state[POSITION, MOTOR] = math.radians(0.09)
    plant.advance(0.0, 1.0)
    assert arm_angle_rad(plant) == 0.0


@pytest.mark.parametrize("interval_s", [0.0, 5e-324])
def test_advance___no_time___changes_nothing(interval_s: float) -> None:
    plant = Plant(RIG)
    plant.advance(2.0, 0.1)
    before = plant.state.copy()
    plant.advance(-5.0, interval_s)
    np.testing.assert_array_equal(plant.state, before)


def test_reset___after_motion___is_a_new_plant() -> None:
    plant = Plant(RIG)
    plant.advance(3.0, 0.3)
    plant.reset()
    assert not plant.outputs_v().any()
    assert energy_j(plant) == 0.0


@pytest.mark.parametrize(
    ("command_v", "interval_s", "message"),
    [
        (math.nan, 0.1, "command_v must be finite"),
        (math.inf, 0.1, "command_v must be finite"),
        (0.0, -0.1, "interval_s must be"),
        (0.0, math.nan, "interval_s must be"),
        (0.0, math.inf, "interval_s must be"),
    ],
)
def test_advance___bad_argument___is_refused(
    command_v: float, interval_s: float, message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        Plant(RIG).advance(command_v, interval_s)


@pytest.mark.parametrize("payload_kg", [0.05, 0.4])
def test_payload___put_on_a_moving_arm___leaves_it_where_it_is(payload_kg: float) -> None:
    plant = Plant(RIG)
    plant.advance(4.0, 0.15)
    before = plant.outputs_v()
    speed_rad_per_s = arm_modes(RIG).hub_angle @ plant.state[VELOCITY, ARM:]
    plant.change_payload(payload_kg)
    modes = arm_modes(plant.parameters)
    assert plant.parameters == replace(RIG, payload_kg=payload_kg)
    assert plant.outputs_v()[[0, 3]] == pytest.approx(before[[0, 3]], rel=1e-12)
    assert modes.hub_angle @ plant.state[VELOCITY, ARM:] == pytest.approx(speed_rad_per_s)
    # The gauges see the bending of a few modes only.
    assert plant.outputs_v()[1:3] == pytest.approx(before[1:3], abs=0.1)


def test_payload___taken_from_a_bent_arm___leaves_its_deflection() -> None:
    heavy = replace(RIG, payload_kg=0.4)
    plant = Plant(heavy)
    plant.advance(5.0, 0.1)
    before_m = arm_modes(heavy).shapes[1::2] @ plant.state[POSITION, ARM:]
    plant.change_payload(0.0)
    after_m = arm_modes(RIG).shapes[1::2] @ plant.state[POSITION, ARM:]
    assert np.ptp(before_m) > 0.01
    np.testing.assert_allclose(after_m, before_m, atol=1e-4)


def test_payload___added___takes_its_share_of_the_momentum() -> None:
    plant = Plant(replace(FRICTIONLESS, backlash_deg=0.0))
    rigid = arm_inertia_kg_m2(plant.parameters)
    plant.state[VELOCITY, ARM] = 2.0 * math.sqrt(rigid)
    plant.state[VELOCITY, MOTOR] = 2.0
    before = momentum(plant)
    plant.change_payload(0.3)
    assert momentum(plant) - before == pytest.approx(0.3 * 2.0, rel=1e-9)


def test_payload___changed_within_a_run___turns_as_the_heavier_arm() -> None:
    plant = Plant(replace(CONSERVATIVE, loop_delay_s=0.0))
    before_v = simulate(plant, np.full(30, 1.0), RATE_HZ)
    momentum_before = momentum(plant)
    plant.change_payload(0.4)
    momentum_after = momentum(plant)
    after_v = simulate(plant, np.full(30, 1.0), RATE_HZ)
    assert momentum_after > momentum_before
    assert momentum(plant) - momentum_after == pytest.approx(0.55 * 30 / RATE_HZ, rel=1e-6)
    # The step from the last row to the first one of the next run is one of those around it.
    steps = np.diff(np.concatenate([before_v, after_v])[:, 0])
    assert abs(steps[29] - steps[28]) < 0.2 * abs(steps[28])


@pytest.mark.parametrize("payload_kg", [-0.1, math.nan])
def test_payload___impossible___is_refused_and_nothing_changes(payload_kg: float) -> None:
    plant = Plant(RIG)
    with pytest.raises(SettingError, match="payload_kg must"):
        plant.change_payload(payload_kg)
    assert plant.parameters == RIG


@pytest.mark.slow
def test_package___with_ros_blocked___imports() -> None:
    script = (
        "import sys; sys.modules['rclpy'] = None\n"
        "import flexarm_daq.rigs.plant, flexarm_daq.rigs.rig_protocol\n"
        "import flexarm_daq.loop.limiter, flexarm_daq.loop.safety\n"
        "assert not [name for name in sys.modules if name.endswith('_msgs')]\n"
        "assert flexarm_daq.SimulatedRig and flexarm_daq.RigParameters\n"
    )
    path = plant_module.__file__.rsplit("/flexarm_daq/", 1)[0]
    code = f"import sys; sys.path.insert(0, {path!r})\n{script}"
    subprocess.run([sys.executable, "-c", code], check=True)  # noqa: S603 - our own script
