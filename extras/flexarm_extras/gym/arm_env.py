"""Arm and vector of arms as Gymnasium's environments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from flexarm_core.errors import SettingError
from flexarm_extras.gym.episodes import LARGEST_V, OBSERVED, Episodes
from flexarm_extras.gym.task import Task

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    # Spaces of Gymnasium have arrays of any real type.
    Real = NDArray[np.floating[Any] | np.integer[Any]]

_ALL = np.array([True])


def _spaces() -> tuple[Box, Box]:
    observed = Box(-LARGEST_V, LARGEST_V, (len(OBSERVED),), np.float32)
    return observed, Box(-1.0, 1.0, (1,), np.float32)


class ArmEnv(gymnasium.Env["Real", "Real"]):
    """One simulated arm: bring it to a set-point, and to rest there.

    Observations are position, base strain, middle strain and speed as the converters read them,
    the set-point and the command in force, in V. The action is a share of the drive's range: 1 is
    10 V. `info` has what a policy does not see: `outputs_v` without noise, `payload_kg`.

    Parameters
    ----------
    task : Task, optional
        Task; by default 10 s episodes, set-points up to 3 V, payloads of 0, 200 and 400 g.

    Examples
    --------
    >>> env = ArmEnv()
    >>> observation, info = env.reset(seed=1, options={"set_point_v": 3.0, "payload_kg": 0.2})
    >>> observation.shape, float(info["payload_kg"])
    ((6,), 0.2)
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - declared so by Gymnasium

    def __init__(self, task: Task | None = None) -> None:
        self.observation_space, self.action_space = _spaces()
        self._episodes = Episodes(task or Task(), 1)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Real, dict[str, Any]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
            Seed of this and the following episodes.
        options : dict, optional
            `set_point_v`, `payload_kg`, `fault`: what is not drawn.

        Raises
        ------
        SettingError
            When an option is not known or has no sense.
        """
        super().reset(seed=seed)
        self._episodes.begin(0, self.np_random, options)
        return self._episodes.look(_ALL)[0], _of_one(self._episodes.info())

    def step(self, action: Real) -> tuple[Real, float, bool, bool, dict[str, Any]]:
        """Command the arm and look at it a period later.

        Raises
        ------
        SettingError
            When the action is not one finite number.
        """
        shape = np.shape(action)
        if shape != self.action_space.shape:
            raise SettingError(f"action must have shape {self.action_space.shape}, got {shape}")
        step = self._episodes.step(np.asarray(action), _ALL)
        return (
            step.observation[0],
            float(step.reward[0]),
            bool(step.terminated[0]),
            bool(step.truncated[0]),
            _of_one(step.info),
        )


class ArmVectorEnv(VectorEnv["Real", "Real", "NDArray[Any]"]):
    """Many arms of `ArmEnv` in one call, each with its own episodes.

    With seed s, arm i is an `ArmEnv` with seed s + i. An arm whose episode has ended begins the
    next one with the next step (Gymnasium's `AutoresetMode.NEXT_STEP`).

    Parameters
    ----------
    num_envs : int
        Number of arms.
    task : Task, optional
        Task, as of `ArmEnv`.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - declared so by Gymnasium
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(self, num_envs: int = 1, task: Task | None = None) -> None:
        self.num_envs = num_envs
        self.single_observation_space, self.single_action_space = _spaces()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._episodes = Episodes(task or Task(), num_envs)
        self._randoms = [np.random.default_rng() for _ in range(num_envs)]
        self._ended = np.zeros(num_envs, np.bool_)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Real, dict[str, Any]]:
        """Begin an episode on every arm.

        Parameters
        ----------
        seed : int or sequence of int, optional
            Seed of the first arm, or one for each.
        options : dict, optional
            As of `ArmEnv`, for all arms.

        Raises
        ------
        SettingError
            When seeds are too many or too few, or an option is not known or has no sense.
        """
        seeds = [seed + arm for arm in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is not None:
            if len(seeds) != self.num_envs:
                raise SettingError(f"seed must be one or {self.num_envs}, got {len(seeds)}")
            for arm, each in enumerate(seeds):
                if each is not None:
                    self._randoms[arm], _ = seeding.np_random(each)
        for arm, random in enumerate(self._randoms):
            self._episodes.begin(arm, random, options)
        self._ended[:] = False
        return self._episodes.look(~self._ended), self._episodes.info()

    def step(
        self, actions: Real
    ) -> tuple[Real, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Command every arm whose episode goes on, begin one on the others, and look at all.

        Raises
        ------
        SettingError
            When the actions are not one finite number for each arm.
        """
        shape = np.shape(actions)
        if shape != self.action_space.shape:
            raise SettingError(f"actions must have shape {self.action_space.shape}, got {shape}")
        for arm in np.flatnonzero(self._ended).tolist():
            self._episodes.begin(arm, self._randoms[arm])
        step = self._episodes.step(np.asarray(actions)[:, 0], ~self._ended)
        self._ended = step.terminated | step.truncated
        return step.observation, step.reward, step.terminated, step.truncated, step.info


def _of_one(info: dict[str, NDArray[np.float64]]) -> dict[str, Any]:
    return {name: values[0] for name, values in info.items()}
