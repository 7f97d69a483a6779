"""The law that plays a trajectory: its answers, its memory, and the setup of the controller."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_control.laws.gains import PdpGains
from flexarm_control.laws.pdpc import Pdp
from flexarm_control.laws.registry import LAWS
from flexarm_control.learning.columns import write_trajectory
from flexarm_control.learning.trajectory import FollowingLaw, planned_trajectory
from flexarm_control.loop_setup import PARAMETERS, Setup
from flexarm_control.planning.flat_arm import ArmFigures
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from pathlib import Path

RATE_HZ = 300.0
MOVE = planned_trajectory(np.full(2, 1.0), ArmFigures().at(0.0), 6.0, RATE_HZ)
DEFAULTS = {spec.name: spec.default for spec in PARAMETERS}


def following(gains: PdpGains | None = None) -> FollowingLaw:
    return FollowingLaw(Pdp(gains or PdpGains()), MOVE, compensation_v=0.7, full_speed_v=0.06)


def asked_volts(sample: int) -> tuple[float, float, float, float]:
    """Return the outputs that are asked for."""
    if sample >= len(MOVE):
        return 1.0, 0.0, 0.0, 0.0
    columns = MOVE.position_v, MOVE.middle_strain_v, MOVE.speed_v
    position_v, strain_v, speed_v = (float(each[sample]) for each in columns)
    return position_v, 0.0, strain_v, speed_v


def test_law___on_an_arm_that_does_what_is_asked___sends_the_command_alone() -> None:
    law = following()

    for sample in range(len(MOVE) + 5):
        command_v = float(MOVE.command_v[sample]) if sample < len(MOVE) else 0.0
        position_v = law.asked_v(0.0)
        answer = law.step(asked_volts(sample), 9.0)
        assert position_v == pytest.approx(asked_volts(sample)[0])
        assert answer.effort_v == pytest.approx(command_v, abs=1e-9)
        assert abs(answer.compensation_v) <= 0.7
    moves = np.flatnonzero(np.abs(MOVE.speed_v) > 0.06)
    law.reset()
    compensations_v = [law.step(asked_volts(k), 0.0).compensation_v for k in range(len(MOVE))]
    assert compensations_v[moves[3]] == pytest.approx(0.7)


def test_law___on_an_arm_that_lags___feeds_the_differences_back() -> None:
    law, gains = following(), PdpGains()

    for sample in range(len(MOVE)):
        position_v, base_v, strain_v, speed_v = asked_volts(sample)
        answer = law.step((position_v - 0.1, base_v, strain_v - 0.2, speed_v - 0.3), 0.0)
        fed_back_v = 0.1 * gains.kp + 0.2 * gains.ksg + 0.3 * gains.kd
        assert answer.effort_v == pytest.approx(MOVE.command_v[sample] + fed_back_v, abs=1e-9)


def test_law___remembering_the_place_of_another___goes_on_as_it() -> None:
    first, second = following(), following()
    for sample in range(20):
        first.step(asked_volts(sample), 0.0)

    second.remember(first.memory())

    assert second.step(asked_volts(25), 0.0) == first.step(asked_volts(25), 0.0)


@pytest.mark.parametrize("name", [name for name, row in LAWS.items() if row.plays])
def test_setup___with_a_trajectory___plays_it_with_the_loop_of_the_law(
    tmp_path: Path, name: str
) -> None:
    file = tmp_path / "trajectory.csv"
    write_trajectory(file, MOVE)

    setup = Setup.of(DEFAULTS | {"law": name, "trajectory": str(file)})

    assert setup.rate_hz == pytest.approx(RATE_HZ)
    assert setup.profile is not None
    assert setup.profile(0.0) == pytest.approx(0.0, abs=1e-9)
    efforts_v = [setup.law.step(asked_volts(k), 0.0).effort_v for k in range(len(MOVE))]
    np.testing.assert_allclose(efforts_v, MOVE.command_v, atol=0.02)


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"trajectory": "/nowhere.csv"}, r"/nowhere\.csv: cannot be read: No such file"),
        ({"law": "ilqr"}, "law ilqr plays no trajectory; choose one of pdp, pdpc"),
        (
            {"reference": "square"},
            "place of the reference square: set reference to topic",
        ),
        ({"shaper": "zv"}, "not shaped: set shaper to none"),
    ],
)
def test_setup___with_a_trajectory_that_does_not_suit___is_refused(
    tmp_path: Path, changed: dict[str, Any], complaint: str
) -> None:
    file = tmp_path / "trajectory.csv"
    write_trajectory(file, MOVE)
    values = DEFAULTS | {"law": "pdpc", "trajectory": str(file)} | changed

    with pytest.raises(SettingError, match=complaint):
        Setup.of(values)
