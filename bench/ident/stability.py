"""Count of unstable models of our own estimators over many seeds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bench.ident.plant import DT_S, NOISES, trial
from flexarm_ident import IoData, identify
from flexarm_ident.models.state_space import is_stable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


@dataclass(frozen=True)
class Count:
    """Unstable models of one method for one kind of noise.

    `unstable` counts matrices A as estimated, before any policy; `after_policy` counts the models
    that `identify` hands out by default.
    """

    method: str
    noise: str
    k: int
    seeds: int
    unstable: int
    after_policy: int


def counted(
    methods: Sequence[str], samples: int, seeds: Sequence[int], *, order: int, block_rows: int
) -> Iterator[Count]:
    """Identify the synthetic arm from many records; yield a count for each method and noise."""
    for noise in NOISES:
        unstable, after = dict.fromkeys(methods, 0), dict.fromkeys(methods, 0)
        for seed in seeds:
            given = trial(samples, noise, seed)
            outputs = tuple(f"y{channel}" for channel in range(given.y.shape[1]))
            data = IoData(given.u, given.y, dt_s=DT_S, inputs=("u",), outputs=outputs)
            for method in methods:
                found = identify(
                    data, order=order, block_rows=block_rows, method=method, feedthrough=False
                )
                unstable[method] += found.moved_eigenvalues > 0
                after[method] += not is_stable(found.model.A)
        for method in methods:
            yield Count(method, noise, samples, len(seeds), unstable[method], after[method])
