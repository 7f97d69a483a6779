"""Gains learned by trial on many simulated arms, beside the law pdpc, without ROS."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control import build_law
from flexarm_extras.gym import ArmVectorEnv, Task

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_control import Law
    from flexarm_core.arrays import FloatArray

CANDIDATES, ARMS, BEST, ROUNDS, FULL_V = 32, 8, 6, 6, 10.0


def main() -> None:
    """Learn by the cross-entropy method on eight arms, then meet arms that are new."""
    env = ArmVectorEnv(CANDIDATES * ARMS, Task(length_s=4.0))
    random = np.random.default_rng(0)
    mean, spread = np.zeros(5), np.full(5, 0.5)
    for learned in range(1, 1 + ROUNDS):
        gains = mean + spread * random.standard_normal((CANDIDATES, len(mean)))
        # Every candidate meets the same arms, set-points and noise.
        gained = episodes(env, [*range(ARMS)] * CANDIDATES, partial(linear, gains.repeat(ARMS, 0)))
        score = gained.reshape(CANDIDATES, ARMS).mean(axis=1)
        best = gains[score.argsort()[-BEST:]]
        mean, spread = best.mean(axis=0), best.std(axis=0)
        print(f"round {learned}: best {score.max():.1f}, median {np.median(score):.1f}")

    new_arms = [1000 + arm for arm in range(env.num_envs)]
    laws = [build_law("pdpc") for _ in new_arms]
    print(f"learned: {episodes(env, new_arms, partial(linear, mean)).mean():.1f}")
    print(f"pdpc: {episodes(env, new_arms, partial(of_laws, laws)).mean():.1f}")


def episodes(env: ArmVectorEnv, seeds: list[int], asked: Callable[..., FloatArray]) -> FloatArray:
    """Return what an episode gives on each arm; `asked` commands volts for observations."""
    seen, _ = env.reset(seed=seeds)
    gained, going = np.zeros(env.num_envs), np.ones(env.num_envs, np.bool_)
    while going.any():
        action = np.clip(asked(seen.astype(float)) / FULL_V, -1.0, 1.0).astype(np.float32)
        seen, reward, terminated, truncated, _ = env.step(action[:, np.newaxis])
        gained += np.where(going, reward, 0.0)
        going &= ~(terminated | truncated)
    return gained


def linear(gains: FloatArray, seen: FloatArray) -> FloatArray:
    """Command by gains on the error, the strains, the speed, and the error's side for friction."""
    error_v = seen[:, 4] - seen[:, 0]
    felt = np.column_stack([error_v, seen[:, 1:4], np.tanh(error_v / 0.05)])
    return np.asarray((gains * felt).sum(axis=1))


def of_laws(laws: Sequence[Law], seen: FloatArray) -> FloatArray:
    """Command by a law on each arm."""
    rows = zip(laws, seen.tolist(), strict=True)
    return np.array([sum(law.step(row[:4], row[4])) for law, row in rows])


if __name__ == "__main__":
    main()
