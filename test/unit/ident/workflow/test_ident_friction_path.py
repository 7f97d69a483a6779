"""Dry friction and refinement on the one way from a record to a model, a file and a report."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexarm_core.labels import with_deviation
from flexarm_ident import IoData, identify, load_friction, load_model, read_bag, validate_dmv
from flexarm_ident.estimation import simulation_fit
from flexarm_ident.friction.dry_friction import (
    Dependence,
    DryFriction,
    friction_fields,
    net_records,
    refer_friction,
    simulate_with_friction,
)
from flexarm_ident.friction.layout import Drive, arm_layout
from flexarm_ident.friction.levels import CoulombEstimate
from flexarm_ident.job import write_results
from flexarm_ident.models.files import EXPORTS
from flexarm_ident.models.model_parameters import flat_parameters
from flexarm_ident.models.state_space import simulate
from flexarm_ident.reduction.modal import truncate
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave, step_by_step
from support.project import BAGS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from flexarm_ident.workflow.outcome import Outcome

    Array = NDArray[np.float64]

BAG = BAGS / "quanser_2dsfl"
HUBS, DEFLECTIONS = [0, 2], [1, 3]


def controlled(level: float, samples: int = 2500) -> IoData:
    """Return a hub with dry friction, a bending link and its gauge, under a position loop."""
    drag, stiffness, loss, link = 0.8, 30.0, 0.4, 0.05
    hub, bend = np.zeros(2), np.zeros(2)
    u, y = np.empty(samples), np.empty((samples, 2))
    rng = np.random.default_rng(1)
    for k in range(samples):
        y[k] = (hub[0], bend[0]) + rng.normal(size=2) * (2e-3, 5e-5)
        reference = 1.0 if (k // 500) % 2 == 0 else -1.0
        reference *= 1.0 + 0.5 * np.sin(k / 210.0)
        u[k] = 3.0 * (reference - y[k, 0]) - 0.4 * hub[1]
        # Semi-implicit steps of half a millisecond and less; friction takes no more than all speed.
        for _ in range(8):
            h = DT_S / 8.0
            torque = u[k] - drag * hub[1] + stiffness * bend[0] + loss * bend[1]
            free = hub[1] + h * torque / 0.4
            after = np.sign(free) * max(abs(free) - h * level / 0.4, 0.0)
            push = (after - hub[1]) / h
            hub = np.array([hub[0] + h * after, after])
            bend[1] += h * (-push - (stiffness * bend[0] + loss * bend[1]) / link)
            bend[0] += h * bend[1]
    inputs, outputs = ("drive_a",), ("hub_rad", "bend_rad")
    return IoData(u, y, dt_s=DT_S, inputs=inputs, outputs=outputs, closed_loop=True)


@pytest.fixture(scope="module")
def real() -> Outcome:
    """Return what half of the measurement of a real arm gives."""
    return run(read_bag(BAG), Request(train_fraction=0.5, method="auto", refine=True))


@pytest.mark.slow
@pytest.mark.exhaustive
def test_real_two_link_arm___auto_with_friction___simulates_twice_the_record(real: Outcome) -> None:
    record, found = real.records[0], real.identification
    assert (found.method, real.fitted[0]) == ("arm", round(0.5 * len(record)))
    assert found.friction is not None
    y, _ = simulate_with_friction(found.model, found.friction, record.u, found.x0[0])
    # RMS error over the deviation of the whole record, dead sensors included.
    error = np.sqrt(np.mean((record.y - y) ** 2, axis=0)) / record.y.std(axis=0)
    assert real.dmv_errors == pytest.approx(error)
    assert error[HUBS].mean() <= 0.20
    assert error[DEFLECTIONS].mean() <= 0.50
    # The level of joint 2 is not determined by half of the record, and a note says so.
    assert found.friction.levels[0] > 3.0 * found.friction.level_deviations[0]
    assert "dead sensors" in found.notes[0]
    assert any("level of current2 is not determined" in note for note in found.notes[1:])


@pytest.mark.slow
@pytest.mark.exhaustive
def test_real_two_link_arm___arm___is_better_than_its_subspace_start(real: Outcome) -> None:
    found = real.identification
    assert found.start_error is not None
    assert np.all(found.fit_error < found.start_error)
    arm, _, others = found.choice.partition("; of the linear ones, ")
    assert arm.startswith(f"an arm with dry friction, order {found.order}, took the place")
    assert "was chosen" in others
    linear = run(read_bag(BAG), Request(train_fraction=0.5, friction=False)).dmv_errors
    assert real.dmv_errors.mean() < linear.mean()


@pytest.mark.slow
@pytest.mark.exhaustive
def test_real_two_link_arm___net_input___moves_the_linear_model_alike(real: Outcome) -> None:
    found = real.identification
    assert found.friction is not None
    (net,), (data,) = found.linear_records, found.records
    y, _ = simulate_with_friction(found.model, found.friction, data.u, found.x0[0])
    assert simulate(found.model, net.u, found.x0[0]) == pytest.approx(y, rel=1e-6, abs=1e-6)


@pytest.fixture(scope="module")
def reduced() -> Outcome:
    """Return what a record of an arm with a friction level of 0.5 A gives, reduced."""
    return run(
        controlled(0.5),
        Request(block_rows=15, train_fraction=1.0, reduction="mrm", reduced_order=4, update="b"),
    )


@pytest.mark.slow
def test_friction___known_level___is_found_with_its_drive(reduced: Outcome) -> None:
    found = reduced.identification
    assert found.method == "arm"
    assert found.friction is not None
    assert found.friction.levels == pytest.approx([0.5], rel=0.1)


@pytest.mark.slow
def test_arm_with_friction___files_and_report___hold_the_levels(
    reduced: Outcome, tmp_path: Path
) -> None:
    assert reduced.friction is not None
    parameters = write_results(
        tmp_path / "out", reduced, [controlled(0.5)], name="arm", exports=EXPORTS
    )
    content = json.loads((tmp_path / "out" / "model.json").read_text("utf-8"))
    for found in (parameters, flat_parameters(content)):
        assert found["models.arm.friction_level"] == reduced.friction.levels.tolist()
        deviations = reduced.friction.level_deviations.tolist()
        assert found["models.arm.friction_level_std"] == deviations
        assert found["models.arm.friction_speed"] == reduced.friction.speed.ravel().tolist()
    for suffix in ("yaml", "json", "mat"):
        file = tmp_path / "out" / f"model.{suffix}"
        assert load_model(file).A.tolist() == reduced.model.A.tolist()
        kept = load_friction(file)
        assert kept is not None
        assert friction_fields(kept) == friction_fields(reduced.friction)
    report = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "<h2>Dry friction</h2>" in report
    for level, deviation in zip(
        reduced.friction.levels, reduced.friction.level_deviations, strict=True
    ):
        assert with_deviation(level, deviation) in report
        assert f"{float(level)!r}" in (tmp_path / "out" / "model.yaml").read_text("utf-8")


@pytest.mark.parametrize("fields", [{"order": 6}, {"method": "orse"}])
def test_friction___order_or_method_given___is_reported_but_the_model_stays(
    fields: dict[str, int | str],
) -> None:
    data, given = controlled(0.5, 8000), {"method": "auto", "block_rows": 15, **fields}
    plain = identify(data, **given)  # type: ignore[arg-type]
    found = identify(data, friction=True, **given)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.model.A, plain.model.A, atol=1e-9)
    assert found.coulomb is not None
    assert found.coulomb.levels == pytest.approx([0.5], rel=0.2)
    assert "dry friction was found" in found.notes[-1]
    assert "A at drive" in found.notes[-1]


@pytest.mark.slow
def test_friction___none_there_or_compensated___linear_model_without_a_word() -> None:
    frictionless, rubbing = controlled(0.0), controlled(0.5)
    compensated = replace(rubbing, compensation=np.sign(rubbing.u))
    for data in (frictionless, compensated):
        found = identify(data, method="auto", block_rows=15, friction=True)
        assert found.friction is None
        assert not any("friction" in note for note in found.notes)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_friction___level_hidden_from_the_regression___is_found_where_errors_are_no_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hidden = CoulombEstimate(
        (Drive("drive_a", "hub_rad"),),
        *(np.array([-1.0]), np.array([1.0]), np.zeros(1), (500,), (False,)),
    )
    monkeypatch.setattr(simulation_fit, "estimate_coulomb", lambda *_: hidden)
    found = identify(controlled(0.5), block_rows=15, friction=True)
    assert found.friction is not None
    assert found.friction.levels == pytest.approx([0.5], rel=0.1)


def test_friction___nothing_left_but_noise___no_arm_is_fitted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A record that begins in motion: its levels are above their deviations, far from significant.
    data = record(arm_model(), 6000, 3, noise=0.02).rows(slice(2000, 4000))
    plain = identify(data)
    assert plain.likelihood is not None
    assert arm_layout([data]) is not None
    possible = CoulombEstimate(
        (Drive("u", "y"),), np.array([2.0]), np.array([1.0]), np.zeros(1), (500,), (False,)
    )
    monkeypatch.setattr(simulation_fit, "estimate_coulomb", lambda *_: possible)
    monkeypatch.setattr(simulation_fit, "fit_arm", pytest.fail)
    found = identify(data, friction=True)
    assert found.friction is None
    assert found.likelihood is not None


def test_workflow___compensation_recorded___keeps_the_way_of_the_thesis() -> None:
    rubbing = controlled(0.5)
    compensation = 0.3 * np.sign(rubbing.u)
    data = replace(rubbing, compensation=compensation)
    outcome = run(data, Request(block_rows=15, train_fraction=0.5))
    assert outcome.friction is None
    assert outcome.records[0].u == pytest.approx(data.u - compensation)
    assert outcome.request.friction


@pytest.mark.slow
def test_reduced_model___of_an_arm_with_friction___has_friction_too(reduced: Outcome) -> None:
    assert reduced.friction is not None
    assert reduced.reduction is not None
    assert reduced.friction.speed.shape == (1, 4)
    assert reduced.friction.levels == pytest.approx(reduced.identification.friction.levels)  # type: ignore[union-attr]
    assert np.all(reduced.dmv_errors < 0.2)


@pytest.mark.parametrize("depends", [False, True])
def test_refer_friction___same_model_in_other_coordinates___same_simulation(depends: bool) -> None:  # noqa: FBT001
    model, u = arm_model(), square_wave(1500, 2)
    n = model.nstates
    speed = np.random.default_rng(0).normal(size=(1, n))
    speed *= np.sign(speed @ model.B)
    nothing = np.zeros(1)
    rise, fading, load = np.array([[0.2], [0.5], [0.1]])
    more = Dependence(rise, fading, load, nothing, nothing) if depends else None
    friction = DryFriction(np.array([0.4]), np.array([0.1]), nothing, nothing, speed, more)
    x0 = np.random.default_rng(1).normal(size=n)
    y, _ = simulate_with_friction(model, friction, u, x0)
    data = IoData(u, y, dt_s=DT_S)
    other = truncate(model, range(n))
    start = validate_dmv(other, net_records(model, friction, [x0], [data])[0]).x0
    nets = net_records(model, friction, [x0], [data])
    referred = refer_friction(friction, (model, other), ([x0], [start]), nets)
    again, _ = simulate_with_friction(other, referred, u, start)
    assert again == pytest.approx(y, abs=1e-4 * np.abs(y).max())


def test_refine___noisy_record___lowers_the_simulation_error_of_the_whole() -> None:
    data = record(random_model(3), 1500, seed=1, noise=0.2)
    start = identify(data, order=4, block_rows=8, method="orse")
    refined = identify(data, order=4, block_rows=8, refine=True, method="orse")
    assert refined.start_error is not None
    assert refined.start_error == pytest.approx(start.fit_error, rel=1e-6)
    y = step_by_step(refined.model, data.u, refined.x0[0])
    error = np.linalg.norm(data.y - y, axis=0) / np.linalg.norm(data.y, axis=0)
    assert refined.fit_error == pytest.approx(error, rel=1e-6)
    assert np.sum(error**2) < np.sum(start.fit_error**2)


def test_arm_layout___real_and_simulated_arms___names_positions_and_speeds() -> None:
    real = arm_layout([read_bag(BAG)])
    assert real is not None
    assert real.drives == (Drive("current1_a", "hub1_deg"), Drive("current2_a", "hub2_deg"))
    assert real.slipping == real.drives
    simulated = arm_layout([read_bag(BAG.parent / "c_dat3_0g")])
    assert simulated is not None
    assert simulated.drives == (Drive("command_v", "position_v"),)
    assert simulated.slipping == (Drive("command_v", "speed_v", is_speed=True),)


@given(st.permutations(range(4)), st.permutations(range(2)))
def test_arm_layout___channels_in_any_order___finds_the_same_pairs(
    outputs: list[int], inputs: list[int]
) -> None:
    data = REAL_HEAD
    shuffled = replace(
        data,
        u=data.u[:, inputs],
        y=-3.0 * data.y[:, outputs],
        inputs=tuple(data.inputs[i] for i in inputs),
        outputs=tuple(data.outputs[i] for i in outputs),
    )
    layout = arm_layout([shuffled])
    assert layout is not None
    assert set(layout.drives) == {Drive("current1_a", "hub1_deg"), Drive("current2_a", "hub2_deg")}
    assert [drive.input for drive in layout.drives] == list(shuffled.inputs)


REAL_HEAD = read_bag(BAG).head(4000)


@pytest.mark.parametrize("seed", range(5))
def test_arm_layout___any_linear_system_under_noise___is_no_arm(seed: int) -> None:
    assert arm_layout([record(random_model(seed), 1000, seed=seed)]) is None
