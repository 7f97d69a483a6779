from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from flexarm_core.errors import SettingError
from flexarm_daq.rigs.faulty import Fault
from flexarm_daq.rigs.simulated import SimulatedRig
from flexarm_extras.gym import ArmEnv, ArmVectorEnv, Task
from flexarm_extras.gym.task import SensorFault, draw_episode

if TYPE_CHECKING:
    from numpy.typing import NDArray

SHORT = Task(length_s=0.1)
NOTHING = np.zeros(1, np.float32)
FULL = np.ones(1, np.float32)


def actions(samples: int, arms: int = 1) -> NDArray[np.float32]:
    """Return actions that swing the arms, (samples, arms, 1)."""
    return np.random.default_rng(3).uniform(-0.6, 0.6, (samples, arms, 1)).astype(np.float32)


def test_arm___passes_gymnasium_s_own_checker() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make("flexarm/Arm-v0").unwrapped)


def test_registered_names___make_one_arm_and_many() -> None:
    arm = gymnasium.make("flexarm/Arm-v0", task=SHORT)
    arms = gymnasium.make_vec("flexarm/Arm-v0", num_envs=3, task=SHORT)
    assert isinstance(arm.unwrapped, ArmEnv)
    assert isinstance(arms.unwrapped, ArmVectorEnv)
    assert arms.reset(seed=1)[0].shape == (3, 6)
    assert arms.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_observations___are_the_readings_of_the_rig_that_was_drawn() -> None:
    arm = ArmEnv()
    observation, info = arm.reset(seed=7)
    episode = draw_episode(Task(), seeding.np_random(7)[0], None)
    rig = SimulatedRig(episode.rig, seed=episode.seed)
    rig.open()
    assert info["payload_kg"] == episode.rig.payload_kg
    for action in actions(200)[:, 0]:
        np.testing.assert_allclose(observation[:4], rig.read().outputs, atol=1e-6)
        assert observation[4] == pytest.approx(episode.set_point_v)
        observation, *_, info = arm.step(action)
        rig.write([10.0 * float(action[0])])
    rig.read()
    np.testing.assert_allclose(info["outputs_v"], rig.outputs_v(), atol=1e-9)


def test_arms___are_single_arms_with_following_seeds_through_their_episodes() -> None:
    task = replace(SHORT, length_s=0.5, bound_v=3.5, set_points_v=(-3.0, 3.0))
    arms = ArmVectorEnv(4, task)
    singles = SyncVectorEnv([lambda: ArmEnv(task)] * 4, autoreset_mode=AutoresetMode.NEXT_STEP)
    first, first_info = arms.reset(seed=5)
    expected, expected_info = singles.reset(seed=5)
    np.testing.assert_allclose(first, expected)
    np.testing.assert_allclose(first_info["payload_kg"], expected_info["payload_kg"])
    ends = np.zeros(2)
    # Two arms are driven to the bound, two swing in the middle until their time is out.
    for action in np.abs(actions(400, 4)) * [[2.0], [2.0], [0.1], [0.1]]:
        found, expected_step = arms.step(action), singles.step(action)
        for one, other in zip(found[:4], expected_step[:4], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)
        for name in ("outputs_v", "payload_kg"):
            np.testing.assert_allclose(found[4][name], expected_step[4][name], atol=1e-9)
        ends += [found[2].sum(), found[3].sum()]
    assert (ends >= 4).all()


def test_same_seed___gives_the_same_episode_and_another_seed_another() -> None:
    first, again, other = (ArmVectorEnv(2, SHORT).reset(seed=seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert not np.array_equal(first[0], first[1])


def test_episode_with_options___has_them_and_draws_the_rest() -> None:
    arm = ArmEnv(SHORT)
    drawn, _ = arm.reset(seed=4)
    observation, info = arm.reset(seed=4, options={"payload_kg": 0.123})
    assert info["payload_kg"] == 0.123
    assert observation[4] == drawn[4]
    observation, _ = arm.reset(seed=4, options={"set_point_v": -1.5})
    assert observation[4] == -1.5


def test_arm_at_rest_at_its_set_point___costs_nothing() -> None:
    arm = ArmEnv(SHORT)
    arm.reset(seed=0, options={"set_point_v": 0.0})
    assert arm.step(NOTHING)[1] == pytest.approx(0.0, abs=1e-12)


def test_drive_below_break_away___costs_error_and_effort() -> None:
    arm = ArmEnv(replace(SHORT, effort_weight=0.5, strain_weight=0.0))
    arm.reset(seed=0, options={"set_point_v": 1.5, "payload_kg": 0.0})
    # 0.1 V do not move the motor: the error stays 1.5 V, half of 3 V.
    reward = arm.step(np.array([0.01], np.float32))[1]
    assert reward == pytest.approx(-(0.25 + 0.5 * 0.01**2), rel=1e-3)


def test_strain___costs_by_its_square() -> None:
    free, strict = (ArmEnv(replace(SHORT, strain_weight=weight)) for weight in (0.0, 2.0))
    for arm in (free, strict):
        arm.reset(seed=3, options={"set_point_v": 1.0})
    for _ in range(20):
        reward, (_, dear, _, _, info) = free.step(FULL)[1], strict.step(FULL)
        assert reward - dear == pytest.approx(2.0 * info["outputs_v"][1] ** 2)


def test_episode___is_truncated_at_its_length() -> None:
    arm = ArmEnv(SHORT)
    arm.reset(seed=0)
    ends = [arm.step(NOTHING)[2:4] for _ in range(30)]
    assert ends == [(False, False)] * 29 + [(False, True)]


def test_leaving_the_bound___ends_the_episode_and_pays_for_the_rest_of_it() -> None:
    task = Task(length_s=4.0)
    arm, lazy = ArmEnv(task), ArmEnv(task)
    for each in (arm, lazy):
        each.reset(seed=0, options={"set_point_v": 3.0, "payload_kg": 0.0})
    rewards, terminated = [], False
    while not terminated:
        _, reward, terminated, truncated, info = arm.step(FULL)
        assert not truncated
        rewards.append(reward)
    assert info["outputs_v"][0] >= task.bound_v
    left = task.samples - len(rewards)
    # Error at the bound: 3 V of 3 V.
    assert rewards[-1] == pytest.approx(-left, rel=0.01)
    assert sum(rewards) < sum(lazy.step(NOTHING)[1] for _ in range(task.samples))


@pytest.mark.parametrize("options", [None, {"fault": SensorFault(Fault.OPEN, "base_strain_v", 5)}])
def test_sensor_fault___spoils_the_observation_and_not_the_arm(
    options: dict[str, Any] | None,
) -> None:
    task = SHORT if options else replace(SHORT, fault=SensorFault(Fault.OPEN, "base_strain_v", 5))
    faulty, healthy = ArmEnv(task), ArmEnv(SHORT)
    seen = [faulty.reset(seed=2, options=options)[0]]
    good = [healthy.reset(seed=2)[0]]
    for action in actions(20)[:, 0]:
        observation, reward, *_, info = faulty.step(action)
        expected, expected_reward, *_, expected_info = healthy.step(action)
        np.testing.assert_allclose(info["outputs_v"], expected_info["outputs_v"])
        assert reward == pytest.approx(expected_reward)
        seen.append(observation)
        good.append(expected)
    different = np.array(seen) != np.array(good)
    assert different[:, 1].tolist() == [False] * 5 + [True] * 16
    assert not np.delete(different, 1, axis=1).any()


def test_fault_of_one_episode___is_gone_in_the_next() -> None:
    arm = ArmEnv(SHORT)
    healthy, _ = arm.reset(seed=2)
    arm.reset(seed=2, options={"fault": SensorFault(Fault.OPEN)})
    np.testing.assert_array_equal(arm.reset(seed=2)[0], healthy)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"payload": 0.2}, "option payload is not known: use set_point_v, "),
        ({"set_point_v": 6.0}, "set_point_v must be within 6.0 V, got 6.0"),
        ({"set_point_v": np.nan}, "set_point_v must be within 6.0 V, got nan"),
        ({"payload_kg": -0.1}, "payload_kg"),
    ],
)
def test_option_without_sense___is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        ArmEnv().reset(seed=0, options=options)
    with pytest.raises(SettingError, match=message):
        ArmVectorEnv(2).reset(seed=0, options=options)


@pytest.mark.parametrize("action", [0.5, [0.5, 0.5], [np.nan]])
def test_action_that_is_no_command___is_refused(action: float | list[float]) -> None:
    arm, arms = ArmEnv(), ArmVectorEnv(3)
    arm.reset(seed=0)
    arms.reset(seed=0)
    with pytest.raises(SettingError, match="action"):
        arm.step(np.asarray(action, np.float32))
    with pytest.raises(SettingError, match="action"):
        arms.step(np.broadcast_to(np.asarray(action, np.float32), (3, *np.shape(action))))


def test_seeds_for_other_arms___are_refused() -> None:
    arms = ArmVectorEnv(2)
    with pytest.raises(SettingError, match="seed must be one or 2, got 3"):
        arms.reset(seed=[1, 2, 3])


def test_arm_with_its_own_seed___is_the_arm_of_that_seed() -> None:
    arms = ArmVectorEnv(2, SHORT)
    observation, _ = arms.reset(seed=[None, 9])
    np.testing.assert_array_equal(observation[1], ArmEnv(SHORT).reset(seed=9)[0])


def test_without_gymnasium___the_import_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(sys.modules, "flexarm_extras.gym")
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(ModuleNotFoundError, match=r"needs gymnasium: pip install"):
        import_module("flexarm_extras.gym")
