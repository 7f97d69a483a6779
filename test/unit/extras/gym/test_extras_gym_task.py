from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from flexarm_core.errors import SettingError
from flexarm_daq.rigs.faulty import SENSOR_FAULTS, Fault
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_extras.gym.task import SensorFault, Task, draw_episode


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ({"payloads_kg": ()}, "payloads_kg must hold at least one payload"),
        ({"payloads_kg": (0.0, -0.2)}, "payload_kg"),
        ({"length_s": 0.0}, "length_s must be positive, got 0.0"),
        ({"rate_hz": np.inf}, "rate_hz must be positive, got inf"),
        ({"bound_v": 7.0}, "bound_v must be at most 6.86 V, got 7.0"),
        ({"set_points_v": (2.0, 1.0)}, "set_points_v must rise within bound_v = 6.0 V"),
        ({"set_points_v": (0.0, 6.0)}, "set_points_v must rise within bound_v = 6.0 V"),
        ({"set_points_v": (np.nan, 1.0)}, "set_points_v must rise"),
        ({"strain_weight": -1.0}, "strain_weight must not be negative, got -1.0"),
        ({"effort_weight": np.nan}, "effort_weight must not be negative, got nan"),
    ],
)
def test_task_without_sense___is_refused_by_its_field(
    figures: dict[str, Any], message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        Task(**figures)


@pytest.mark.parametrize(
    ("figures", "message"),
    [
        ({"fault": "late"}, "fault must be one of"),
        ({"fault": Fault.OPEN, "channel": "base"}, "channel must be one of position_v, "),
        ({"fault": Fault.OPEN, "after_samples": -1}, "after_samples must not be negative, got -1"),
    ],
)
def test_fault_without_sense___is_refused_by_its_field(
    figures: dict[str, Any], message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        SensorFault(**figures)


@pytest.mark.parametrize("fault", SENSOR_FAULTS)
def test_fault_by_name___is_the_fault(fault: Fault) -> None:
    assert SensorFault(fault.value) == SensorFault(fault)  # type: ignore[arg-type]


def test_drawn_episodes___cover_payloads_and_set_points_and_keep_the_rig() -> None:
    rig = RigParameters(motor_inertia_kg_m2=2e-4)
    task = Task(rig=rig, payloads_kg=(0.0, 0.1), set_points_v=(1.0, 2.0))
    random = np.random.default_rng(0)
    episodes = [draw_episode(task, random, None) for _ in range(200)]
    assert {each.rig.payload_kg for each in episodes} == {0.0, 0.1}
    set_points = [each.set_point_v for each in episodes]
    assert 1.0 <= min(set_points) < 1.1
    assert 1.9 < max(set_points) <= 2.0
    assert all(each.rig.motor_inertia_kg_m2 == 2e-4 for each in episodes)
    assert len({each.seed for each in episodes}) == 200


def test_options___do_not_change_what_else_is_drawn() -> None:
    options = {"set_point_v": 1.0, "payload_kg": 0.3, "fault": None}
    free, held = np.random.default_rng(1), np.random.default_rng(1)
    assert draw_episode(Task(), free, None).seed == draw_episode(Task(), held, options).seed
    assert draw_episode(Task(), free, None) == draw_episode(Task(), held, None)


def test_number_of_samples___is_length_times_rate_and_at_least_one() -> None:
    assert Task(length_s=2.0, rate_hz=250.0).samples == 500
    assert Task(length_s=1e-4).samples == 1
