"""What comes of one example of chapter 3: its modes, its models and their errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from flexarm_core.arrays import FloatArray

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_ident.models.modes import Mode

Matrices: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""A, B and C of a model; a `StateSpace` cannot be pickled."""

LOW, THESIS, FILTERED = "low", "thesis", "filtered"
"""Records: with the noise of good sensors; with strong noise, as the thesis's errors of the gauges
suggest; and with strong noise and the input filtered as the outputs are."""
WAYS = ("mrm", "msv", "mrmc")
"""Stages that are reduced and not updated; all other reduced ones are updated."""
C_UPDATED = "_c"
"""Ends the name of a stage whose C was updated, not B."""
BENDING_NEAR = 0.25
"""A bending mode is found when a vibrating mode is within this of its frequency, as a log ratio:
the thesis's own models of C_dat3 have their first one at 9.0 and at 11.8 Hz."""
_VIBRATES = 0.3
SLOW = 0.5
"""Below this part of the first bending mode a pair belongs to the rigid motion."""


@dataclass(frozen=True, eq=False)
class Stage:
    """One model on the way.

    Attributes
    ----------
    order
        Number of states.
    kept
        Labels of the modes that it has of the full model; empty when they are not modes.
    bending_hz
        Frequencies of the bending modes that it has.
    dmv
        Errors of the four outputs by data matching, over the whole record.
    sfv
        Errors by set-point following; empty where the thesis has none, infinite when the loop
        with the model runs away.
    """

    order: int
    kept: tuple[str, ...]
    bending_hz: tuple[float, ...]
    dmv: tuple[float, ...]
    sfv: tuple[float, ...] = ()

    @property
    def dmv_mean(self) -> float:
        """Mean error by data matching."""
        return float(np.mean(self.dmv))

    @property
    def sfv_mean(self) -> float:
        """Mean error by set-point following."""
        return float(np.mean(self.sfv))


@dataclass(frozen=True, eq=False)
class Curves:
    """What the figures of one trial draw.

    Attributes
    ----------
    dt_s
        Sampling period.
    measured, dmv
        The record's outputs, and each stage's by data matching, (samples, 4).
    set_point, sfv
        The same for set-point following.
    """

    dt_s: float
    measured: NDArray[np.float32]
    dmv: Mapping[str, NDArray[np.float32]]
    set_point: NDArray[np.float32]
    sfv: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class ReductionTrial:
    """One model with its reduced ones.

    Attributes
    ----------
    seed
        Of the record.
    modes
        Modes of the full model, made stable, with both ranks.
    bending
        Labels of the bending modes among them, the slowest first.
    rigid
        Labels of those of the rigid motion: real modes and slow pairs.
    moved
        Eigenvalues that were outside the unit circle.
    stages
        Models by their name: ``initial``, ``balanced`` and those of the example. With each updated
        one comes a second, ending in `C_UPDATED`; with an unstable one its state before, called
        ``unstable``.
    realisation_difference
        How far the frequency response of the reduced model identified anew (3-10) is from its own.
    models
        A, B and C of each stage, for the seed that the figures show only. A `StateSpace` cannot be
        pickled.
    curves
        Signals of the same seed, with the thesis's noise.
    """

    seed: int
    modes: tuple[Mode, ...]
    bending: tuple[str, ...]
    rigid: tuple[str, ...]
    moved: tuple[complex, ...]
    stages: Mapping[str, Stage]
    realisation_difference: float
    models: Mapping[str, Matrices]
    curves: Curves | None

    def left_out_rank(self, stage: str) -> int:
        """Rank by MRM of the strongest mode that a reduced model does not have."""
        return min(
            mode.mrm_rank for mode in self.modes if mode.label not in self.stages[stage].kept
        )

    @property
    def order(self) -> int:
        """States of the full model."""
        return self.stages["initial"].order


def bending_modes(modes: Sequence[Mode], known_hz: Sequence[float]) -> list[Mode]:
    """Return the vibrating mode nearest to each known frequency, if one is near enough."""
    vibrating = [mode for mode in modes if mode.is_pair and abs(mode.damping_ratio) < _VIBRATES]
    chosen: list[Mode] = []
    for hz in known_hz:
        near = [
            (abs(np.log(mode.frequency_hz / hz)), mode.states, mode)
            for mode in vibrating
            if mode not in chosen
        ]
        if near and min(near)[0] < BENDING_NEAR:
            chosen.append(min(near)[2])
    return chosen


def is_rigid(mode: Mode, known_hz: Sequence[float]) -> bool:
    """Whether a mode belongs to the rigid motion: it is real, or slower than the beam bends."""
    return mode.frequency_hz < SLOW * min(known_hz)
