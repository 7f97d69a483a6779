"""Dry friction: closed forms of sliding and sticking, and levels recovered from records."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident import IdentificationError, IoData, load_friction, save_model
from flexarm_ident.friction.dry_friction import (
    Dependence,
    DryFriction,
    friction_fields,
    simulate_with_friction,
)
from flexarm_ident.friction.layout import Drive, joints
from flexarm_ident.friction.levels import estimate_coulomb
from flexarm_ident.models.model_parameters import ModelFileError
from flexarm_ident.models.state_space import simulate
from flexarm_ident.models.stick_slip import friction_force
from flexarm_ident.records.signals import dead_stretches, live_samples
from support.exhaustive import first_of
from support.ident_systems import DT_S, arm_model, named

if TYPE_CHECKING:
    from pathlib import Path

    import control
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MASS = 0.4


def sledge() -> control.StateSpace:
    """Return a mass pushed by its input: position and speed."""
    return named(
        np.array([[1.0, DT_S], [0.0, 1.0]]),
        np.array([[0.5 * DT_S**2 / MASS], [DT_S / MASS]]),
        np.eye(2),
        np.zeros((2, 1)),
    )


def test_joints___tip_that_moves_as_the_hub_and_is_slower___is_not_the_joint() -> None:
    rng = np.random.default_rng(7)
    samples, hub_kg, tip_kg, spring, loss = 8000, 0.1, 0.3, 30.0, 0.3
    x, v = np.zeros(2), np.zeros(2)
    u, y = np.empty(samples), np.empty((samples, 3))
    push = np.repeat(rng.choice([-2.0, 2.0], samples // 5), 5)
    for k in range(samples):
        y[k] = x[1], x[0], x[1] - x[0]
        goal = 1.0 if (k // 800) % 2 == 0 else -1.0
        u[k] = 2.0 * (goal - x[0]) - 1.5 * v[0] + push[k]
        bend = spring * (x[1] - x[0]) + loss * (v[1] - v[0])
        v = v + DT_S * np.array([(u[k] + bend) / hub_kg, -bend / tip_kg])
        x = x + DT_S * v
    record = IoData(u, y, dt_s=DT_S, inputs=("drive",), outputs=("tip", "hub", "bend"))

    pace = np.diff(y, axis=0).std(axis=0) / y.std(axis=0)
    assert pace[0] < pace[1] < pace[2]
    assert joints([record]) == (Drive("drive", "hub"),)


def dry(level: float, offset: float = 0.0) -> DryFriction:
    nothing = np.zeros(1)
    return DryFriction(
        np.array([level]), np.array([offset]), nothing, nothing, np.array([[0.0, 1.0]])
    )


def clinging(rise: float = 0.0, rise_speed: float = 0.0, load: float = 0.0) -> DryFriction:
    """Return friction of level 0.5 that depends on speed and load."""
    nothing = np.zeros(1)
    rises, rise_speeds, loads = (np.array([value]) for value in (rise, rise_speed, load))
    dependence = Dependence(rises, rise_speeds, loads, nothing, nothing)
    return replace(dry(0.5), dependence=dependence)


def moved_record(level: float, *, noise: float = 0.0, seed: int = 0) -> IoData:
    """Return a sledge with friction and viscous drag under a position controller."""
    rng = np.random.default_rng(seed)
    samples, drag, gain = 6000, 0.8, DT_S / MASS
    x, v = 0.0, 0.0
    u, y = np.empty(samples), np.empty(samples)
    for k in range(samples):
        y[k] = x + noise * rng.normal()
        reference = 1.0 if (k // 600) % 2 == 0 else -1.0
        u[k] = 6.0 * (reference - y[k]) - 2.5 * v
        free = v + gain * (u[k] - drag * v)
        v_next = np.sign(free) * max(abs(free) - gain * level, 0.0)
        x, v = x + 0.5 * DT_S * (v + v_next), v_next
    return IoData(u, y, dt_s=DT_S, inputs=("force_n",), outputs=("place_m",), closed_loop=True)


def test_simulation___no_friction___is_the_linear_one() -> None:
    model = arm_model()
    u = np.random.default_rng(0).normal(size=(500, 1))
    x0 = np.random.default_rng(1).normal(size=model.nstates)
    none = np.zeros(1)
    friction = DryFriction(none, none, none, none, np.eye(1, model.nstates, 1))
    y, forces = simulate_with_friction(model, friction, u, x0)
    assert y == pytest.approx(simulate(model, u, x0), rel=1e-9, abs=1e-9)
    assert not forces.any()


def test_simulation___force_below_level___stands_still() -> None:
    u = 0.99 * np.sin(np.arange(400) / 20.0)[:, np.newaxis]
    y, forces = simulate_with_friction(sledge(), dry(1.0), u, np.array([0.3, 0.0]))
    assert y[:, 0] == pytest.approx(np.full(400, 0.3))
    assert forces == pytest.approx(u)


def test_simulation___sliding_mass___stops_after_the_closed_form_distance() -> None:
    level, speed = 0.7, 1.5
    y, _ = simulate_with_friction(sledge(), dry(level), np.zeros((900, 1)), np.array([0.0, speed]))
    distance = 0.5 * MASS * speed**2 / level
    assert y[-1, 0] == pytest.approx(distance, rel=1e-4)
    assert y[-1, 1] == pytest.approx(0.0, abs=1e-12)


def test_simulation___net_input___moves_the_linear_model_alike() -> None:
    u = 2.0 * np.random.default_rng(2).normal(size=(600, 1))
    x0 = np.array([0.1, -0.2])
    y, forces = simulate_with_friction(sledge(), dry(0.8, 0.1), u, x0)
    assert simulate(sledge(), u - 0.1 - forces, x0) == pytest.approx(y, rel=1e-9, abs=1e-9)


def test_friction_force___coupled_drives___meets_the_conditions_of_coulomb() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        root = rng.normal(size=(3, 3))
        gain = root @ root.T + 0.1 * np.eye(3)
        levels, free = rng.uniform(0.1, 1.0, 3), 2.0 * rng.normal(size=3)
        force = friction_force(free, gain, levels)
        after = free - gain @ force
        held = np.abs(force) < levels * (1.0 - 1e-9)
        assert np.abs(after[held]).max(initial=0.0) < 1e-4
        assert np.all(np.abs(force) <= levels)
        assert np.all((force * after)[~held] >= -1e-4)


def test_simulation___slow_push_against_a_rise___breaks_away_at_their_sum() -> None:
    u = np.linspace(0.0, 1.0, 2000)[:, np.newaxis]
    y, _ = simulate_with_friction(sledge(), clinging(0.3, 0.05), u, np.zeros(2))
    assert u[np.flatnonzero(y[:, 1])[0], 0] == pytest.approx(0.8, abs=2e-3)


def test_simulation___speed_far_above_that_of_the_rise___slides_with_the_coulomb_level() -> None:
    u = np.zeros((30, 1))
    y, forces = simulate_with_friction(sledge(), clinging(0.3, 0.05), u, np.array([0.0, 3.0]))
    assert y[-1, 1] > 2.0
    assert forces == pytest.approx(np.full((30, 1), 0.5))


def test_simulation___speed_of_the_rise___leaves_one_part_in_e_of_it() -> None:
    _, forces = simulate_with_friction(
        sledge(), clinging(0.3, 0.2), np.ones((1, 1)), np.array([0.0, 0.2])
    )
    assert forces[0, 0] == pytest.approx(0.5 + 0.3 * math.exp(-1.0))


@pytest.mark.parametrize("push", [2.0, -2.0])
def test_simulation___friction_under_load___takes_its_part_of_the_push(push: float) -> None:
    u = np.full((50, 1), push)
    y, forces = simulate_with_friction(sledge(), clinging(load=0.2), u, np.zeros(2))
    assert forces == pytest.approx(np.sign(push) * np.full((50, 1), 0.5 + 0.2 * 2.0))
    speed = (push - forces[0, 0]) / MASS * 49 * DT_S
    assert y[-1, 1] == pytest.approx(speed)


@pytest.mark.parametrize("friction", [dry(0.4, 0.1), clinging(0.3, 0.05, 0.2)])
@pytest.mark.parametrize("suffix", first_of(["yaml", "json", "mat"]))
@pytest.mark.slow
def test_load_friction___file_of_save_model___has_it_back(
    friction: DryFriction, suffix: str, tmp_path: Path
) -> None:
    file = tmp_path / f"sledge.{suffix}"
    save_model(file, sledge(), name="sledge", provenance=friction_fields(friction))
    kept = load_friction(file)
    assert kept is not None
    assert kept.laws.tolist() == friction.laws.tolist()
    assert (kept.dependence is None) == (friction.dependence is None)
    assert friction_fields(kept) == friction_fields(friction)


def test_load_friction___part_of_the_dependence___names_what_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "sledge.yaml"
    fields = friction_fields(clinging(0.3, 0.05, 0.2))
    del fields["friction_rise_speed"]
    save_model(file, sledge(), name="sledge", provenance=fields)
    with pytest.raises(ModelFileError, match="friction_rise_speed is missing"):
        load_friction(file)


@pytest.mark.parametrize("level", [0.3, 1.0])
def test_estimate___position_loop___finds_the_level(level: float) -> None:
    found = estimate_coulomb(moved_record(level, noise=1e-4), [Drive("force_n", "place_m")])
    assert found.levels == pytest.approx([level], rel=0.1)
    assert found.present
    assert abs(found.offsets[0]) < 0.1 * level


def test_estimate___no_friction___is_not_present() -> None:
    found = estimate_coulomb(moved_record(0.0, noise=1e-4), [Drive("force_n", "place_m")])
    assert not found.present


def test_estimate___speed_output___is_not_differentiated() -> None:
    data = moved_record(0.5)
    speed = np.gradient(data.y[:, 0], DT_S)
    by_speed = IoData(data.u, speed, dt_s=DT_S, inputs=("force_n",), outputs=("speed_m_s",))
    found = estimate_coulomb(by_speed, [Drive("force_n", "speed_m_s", is_speed=True)])
    assert found.levels == pytest.approx([0.5], rel=0.1)


def test_estimate___unknown_channel___names_it() -> None:
    with pytest.raises(IdentificationError, match="no channel 'torque'"):
        estimate_coulomb(moved_record(0.3), [Drive("torque", "place_m")])


def test_estimate___single_short_move___raises() -> None:
    y = np.zeros(400)
    y[200:203] = (0.2, 0.8, 1.0)
    y[203:] = 1.0
    u = np.random.default_rng(0).normal(size=400)
    data = IoData(u, y, dt_s=DT_S, inputs=("force_n",), outputs=("place_m",))
    with pytest.raises(IdentificationError, match="slips in"):
        estimate_coulomb(data, [Drive("force_n", "place_m")])


def test_live_samples___dead_gauge_and_resting_encoder___marks_the_gauge_only() -> None:
    rng = np.random.default_rng(0)
    gauge = rng.normal(size=500)
    gauge[:60] = 0.0
    encoder = np.round(np.sin(np.arange(500) / 60.0), 1)
    encoder[300:400] = encoder[300]
    data = IoData(
        rng.normal(size=500),
        np.stack([gauge, encoder], axis=1),
        dt_s=DT_S,
        inputs=("u",),
        outputs=("gauge", "encoder"),
    )
    live = live_samples(data)
    assert np.flatnonzero(live[:, 0] == 0.0).tolist() == list(range(60))
    assert live[:, 1].all()


def test_live_samples___filled_hole_between_two_equal_values___is_no_dead_sensor() -> None:
    rng = np.random.default_rng(1)
    y = rng.normal(size=(500, 2))
    y[260] = y[199]
    y[200:260] = np.nan
    data = IoData(rng.normal(size=500), y, dt_s=DT_S, inputs=("u",), outputs=("a", "b"))
    assert dead_stretches(data, 0) == ()
    assert np.flatnonzero(live_samples(data)[:, 1] == 0.0).tolist() == list(range(200, 260))
