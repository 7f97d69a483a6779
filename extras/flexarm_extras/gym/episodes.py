"""Episodes of a task on many simulated arms at once, in arrays.

Observations are the four sensors, the set-point and the command in force, in V. An action is a
share of the drive's range: 1 is 10 V.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from flexarm_core.channels import BOUND_V, CHANNEL_NAMES, INPUT_RANGE_V, MAX_COMMAND_V
from flexarm_core.errors import SettingError
from flexarm_daq.rigs.faulty import FaultySensor
from flexarm_extras.batch import RigBatch
from flexarm_extras.gym.task import draw_episode

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from flexarm_extras.gym.task import Task

OBSERVED: Final = (*CHANNEL_NAMES, "set_point_v", "command_v")
"""Names of an observation's entries."""
LARGEST_V: Final = max(INPUT_RANGE_V, MAX_COMMAND_V)
"""Largest magnitude of any of them, V."""
_SET_POINT, _COMMAND = OBSERVED.index("set_point_v"), OBSERVED.index("command_v")
_POSITION, _BASE_STRAIN = 0, 1


class Step(NamedTuple):
    """What a step gives, for each arm; `info` has outputs without noise and the payloads.

    Attributes
    ----------
    observation : ndarray of float32, (arms, 6)
        See `OBSERVED`.
    reward : ndarray, (arms,)
        Reward.
    terminated, truncated : ndarray of bool, (arms,)
        Ends by the bound of the position and by the length.
    info : dict of str to ndarray
        `outputs_v`, (arms, 4), and `payload_kg`, (arms,).
    """

    observation: NDArray[np.float32]
    reward: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    info: dict[str, NDArray[np.float64]]


class Episodes:
    """Episodes of a task, one on each arm.

    Parameters
    ----------
    task : Task
        Task.
    arms : int
        Number of arms; each needs `begin` before the first `step`.
    """

    def __init__(self, task: Task, arms: int) -> None:
        self.task = task
        self._batch = RigBatch(arms, rate_hz=task.rate_hz)
        self._set_point_v = np.zeros(arms)
        self._payload_kg = np.zeros(arms)
        self._faulty: dict[int, FaultySensor] = {}

    def begin(
        self, arm: int, random: np.random.Generator, options: Mapping[str, Any] | None = None
    ) -> None:
        """Begin an episode on an arm, which is at rest; see `draw_episode`.

        Raises
        ------
        SettingError
            When an option is not known or has no sense.
        """
        episode = draw_episode(self.task, random, options)
        self._batch.rest(arm, episode.rig, episode.seed)
        self._set_point_v[arm] = episode.set_point_v
        self._payload_kg[arm] = episode.rig.payload_kg
        self._faulty.pop(arm, None)
        if episode.fault is not None:
            self._faulty[arm] = FaultySensor(
                episode.fault.fault, episode.fault.channel, episode.fault.after_samples
            )

    def look(self, arms: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Return observations of the present sample, (arms, 6); faults advance on some arms."""
        volts = self._batch.read()
        for arm, faulty in self._faulty.items():
            if arms[arm]:
                volts[arm] = faulty.spoiled(volts[arm])
        shown = np.column_stack([volts, self._set_point_v, self._batch.command_v])
        return shown.astype(np.float32)

    def step(
        self, action: NDArray[np.floating[Any] | np.integer[Any]], moving: NDArray[np.bool_]
    ) -> Step:
        """Command the arms and look at them a period later.

        Parameters
        ----------
        action : ndarray, (arms,)
            Shares of the drive's range, -1 to 1; beyond it the converters clip.
        moving : ndarray of bool, (arms,)
            Arms whose episode goes on. The others begin one: they are looked at, and their reward
            is zero.

        Returns
        -------
        Step
            What it gives.

        Raises
        ------
        SettingError
            When an action is not finite.
        """
        task, batch = self.task, self._batch
        if not np.isfinite(action).all():
            raise SettingError("action must be finite")
        batch.write(MAX_COMMAND_V * action.astype(np.float64), moving)
        position_v = batch.outputs_v[:, _POSITION]
        left = task.samples - batch.samples
        terminated = moving & (np.abs(position_v) >= task.bound_v)
        truncated = moving & ~terminated & (left <= 0)
        cost = (
            self._error_cost(position_v)
            + task.strain_weight * batch.outputs_v[:, _BASE_STRAIN] ** 2
            + task.effort_weight * (batch.command_v / MAX_COMMAND_V) ** 2
        )
        at_bound = self._error_cost(np.copysign(task.bound_v, position_v))
        cost += np.where(terminated, left * at_bound, 0.0)
        return Step(
            self.look(np.ones_like(moving)),
            np.where(moving, -cost, 0.0),
            terminated,
            truncated,
            self.info(),
        )

    def info(self) -> dict[str, NDArray[np.float64]]:
        """Return what a policy does not see; see `Step`."""
        return {"outputs_v": self._batch.outputs_v.copy(), "payload_kg": self._payload_kg.copy()}

    def _error_cost(self, position_v: NDArray[np.float64]) -> NDArray[np.float64]:
        cost: NDArray[np.float64] = ((position_v - self._set_point_v) / BOUND_V) ** 2
        return cost
