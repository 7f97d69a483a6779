"""Examples of chapter 3: the models that it reduces, their stages, and the rows of its tables."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from flexarm_core.arrays import FloatArray
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.beam import natural_frequencies_hz
from reproduction.framework.findings import thesis_table
from reproduction.framework.study_rig import study_rig

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_ident.models.modes import Mode


Validation: TypeAlias = Literal["dmv", "sfv"]
BENDING_MODES = 3
MEANING: Mapping[Validation, str] = {"dmv": "data matching", "sfv": "set-point following"}
"""Validations of the thesis by their short names."""


@dataclass(frozen=True)
class Kept:
    """A reduced model: the ranking that chose its modes, and its number of states."""

    ranking: Literal["mrm", "msv", "mrmc"]
    order: int
    bending_modes: int = BENDING_MODES


@dataclass(frozen=True)
class Example:
    """One model of the thesis and what becomes of it.

    Attributes
    ----------
    code
        The thesis's name of the full model.
    experiment
        Record that it is identified from, on the first half.
    order
        Number of states of the full model.
    reduced
        The reduced models by the stage's name, as the thesis lists them: ``mrm``, ``msv`` and
        ``mrmc`` are not updated, all others are.
    compensation
        Treatment of the Coulomb compensation in the input.
    unstable
        The slow real eigenvalue that is outside the unit circle, in a model that has one: its order
        is searched for.
    shown_seed
        The record that the figures show: the first one, or the first whose model of `order` is
        unstable.
    """

    code: str
    experiment: str
    order: int
    reduced: Mapping[str, Kept]
    compensation: Literal["remove", "keep"] = "remove"
    unstable: float = 0.0
    shown_seed: int = 1

    @property
    def known_modes_hz(self) -> tuple[float, ...]:
        """Bending modes of the arm with this payload, from the beam's equation."""
        arm = study_rig(experiment(self.experiment).payload_kg)
        return tuple(natural_frequencies_hz(arm)[:BENDING_MODES].tolist())


def _example(code: str, made: Mapping[str, Any]) -> Example:
    reduced = {}
    for stage, words in made["reduced"].items():
        ranking, *numbers = words.split()
        reduced[stage] = Kept(ranking, *map(int, numbers))
    return Example(code, **{**made, "reduced": MappingProxyType(reduced)})


TABLES: Mapping[str, str] = MappingProxyType(
    {"3-1": "Ac3_18", "3-2": "Ac11_26", "3-3": "Ac3_21u", "3-4": "Ao2_19", "3-5": "Ac11_18c"}
)
"""The examples with tables of their own."""

EXAMPLES: Mapping[str, Example] = MappingProxyType(
    {code: _example(code, made) for code, made in thesis_table("chapter_3_models").items()}
)
"""All of them by the thesis's code: the five of Tables 3-1 to 3-5, and those of Table 3-6."""


Matrices: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""A, B and C of a model; a `StateSpace` cannot be pickled."""

INITIAL = "initial"
LOW, THESIS = "low", "thesis"
"""Records: with the noise of good sensors, and with strong noise, as the thesis's errors of the
gauges suggest."""
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
    """One model on the way, with the labels of the modes that it has of the full model.

    Errors are of the four outputs; `sfv` is empty where the thesis has none, and infinite when the
    loop with the model runs away.
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
    """Curves in the figures of one trial: outputs, (samples, 4), measured and of each stage."""

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
        Distance of the frequency response of its realisation (3-10) from the reduced model's.
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


class Records(NamedTuple):
    """Trials of an example, one per record, with little noise and as strong as the thesis's."""

    example: Example
    low: Sequence[ReductionTrial]
    noisy: Sequence[ReductionTrial]

    def shown(self, *, noisy: bool) -> ReductionTrial:
        """Return the trial of the record that the figures show."""
        some = self.noisy if noisy else self.low
        return next(trial for trial in some if trial.seed == self.example.shown_seed)


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
    """Return whether a mode belongs to the rigid motion: real, or slower than the beam bends."""
    return mode.frequency_hz < SLOW * min(known_hz)


STAGES: Mapping[str, str] = {
    "unstable": "unstable",
    INITIAL: "initial",
    "mrm": "MRM",
    "msv": "MSV",
    "mrmc": "MRMC",
    "updated": "updated",
    "updated_mrmc": "updated, MRMC",
    "updated_msv": "updated, MSV",
    "further": "further reduced",
    "level": "updated, as few states as from Ac3_18",
    "balanced": "balanced truncation",
}


@dataclass(frozen=True)
class ThesisRow:
    """A row of a table: a stage, how it was validated and its errors."""

    stage: str
    validation: Validation
    modes: str
    delta: tuple[float, ...]
    mean: float


def thesis_rows(table: Sequence[Mapping[str, Any]]) -> tuple[ThesisRow, ...]:
    """Return the rows of a table of the thesis."""
    return tuple(
        ThesisRow(
            row["stage"], row["validation"], row.get("modes", ""), tuple(row["delta"]), row["mean"]
        )
        for row in table
    )
