"""Trials of the examples: from the record to reduced and updated models, with errors."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np

from flexarm_daq.experiments.catalogue import experiment
from flexarm_ident import IdentificationError, reduce_model
from flexarm_ident.models.state_space import stabilise
from flexarm_ident.records.preprocess import output_scale
from flexarm_ident.reduction.balanced import balanced_truncation, thesis_realisation
from reproduction.chapter2.order_survey import (
    fitted_half,
    followed,
    identified,
    matched,
    model_of,
    prepared,
    set_point_record,
)
from reproduction.chapter3.examples import (
    C_UPDATED,
    EXAMPLES,
    INITIAL,
    LOW,
    THESIS,
    WAYS,
    Curves,
    Records,
    ReductionTrial,
    Stage,
    bending_modes,
    is_rigid,
)
from reproduction.framework.findings import SEEDS, Call
from reproduction.framework.realisations import realisation_difference
from reproduction.framework.rig import simulated_record
from reproduction.framework.study_rig import choices

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident import Identification, IoData, Reduction
    from reproduction.chapter3.examples import Example, Kept, Matrices, Validation
    from reproduction.framework.findings import Results


SEARCHED = range(15, 37)
"""Orders among which an unstable model is looked for."""


def reduction_trial(code: str, noise: str, seed: int) -> ReductionTrial:
    """Identify, reduce and update one of the `EXAMPLES`, from a record of `LOW` and so on."""
    example = EXAMPLES[code]
    record = _record(example, noise, seed)
    trained = fitted_half(record)
    found = identified(trained)
    raw = _of_order(found, _order(example, found), stable=False)
    eigenvalues = np.linalg.eigvals(raw.model.A)
    moved = tuple(complex(each) for each in eigenvalues[np.abs(eigenvalues) >= 1.0])
    if example.unstable:
        full = replace(raw, model=_forced(raw.model))
    else:
        full = _of_order(found, raw.order, stable=True)
    models, reductions = _reduced(example, full, trained)
    models = {"initial": full.model, **models}
    if example.unstable:
        models = {"unstable": raw.model, **models}
    payload_kg = experiment(example.experiment).payload_kg
    set_point = set_point_record(1.0 / record.dt_s, payload_kg, seed)
    modes = reductions[next(iter(reductions))].modes
    validated = _Validation(record, set_point, models)
    known = example.known_modes_hz
    is_shown = seed == example.shown_seed
    stages = {}
    for name in models:
        kept = reductions[name].kept if name in reductions else ()
        has = [mode for mode in modes if mode.label in kept] if kept else modes
        stages[name] = Stage(
            order=models[name].nstates,
            kept=kept,
            bending_hz=tuple(mode.frequency_hz for mode in bending_modes(has, known)),
            dmv=validated.dmv_errors[name],
            sfv=validated.sfv_errors.get(name, ()),
        )
    smallest = min(reductions, key=lambda name: reductions[name].order)
    direct = reductions[smallest].model
    rebuilt = thesis_realisation(direct, trained, block_rows=choices().block_rows)
    return ReductionTrial(
        seed=seed,
        modes=tuple(replace(mode, kept=True) for mode in modes),
        bending=tuple(mode.label for mode in bending_modes(modes, known)),
        rigid=tuple(mode.label for mode in modes if is_rigid(mode, known)),
        moved=moved,
        stages=stages,
        realisation_difference=realisation_difference(direct, rebuilt, trained).frequency_response,
        models=_matrices(models) if is_shown else {},
        curves=validated.curves() if is_shown and noise == THESIS else None,
    )


def unstable_order(code: str, noise: str, seed: int) -> int:
    """Return the order of an unstable example's full model.

    Raises
    ------
    IdentificationError
        If no order has one unstable real eigenvalue.
    """
    example = EXAMPLES[code]
    return _order(example, identified(fitted_half(_record(example, noise, seed))))


def _record(example: Example, noise: str, seed: int) -> IoData:
    record = simulated_record(example.experiment, seed, calm=noise == LOW)
    return prepared(record, example.compensation)


def _order(example: Example, found: Identification) -> int:
    """Return the order of the full model, of an unstable one the nearest that is so."""
    if not example.unstable:
        return example.order
    for order in sorted(SEARCHED, key=lambda order: (abs(order - example.order), -order)):
        eigenvalues = np.linalg.eigvals(found.subspace.matrices(order).A)
        outside = eigenvalues[np.abs(eigenvalues) >= 1.0]
        # One that has no partner is real.
        if len(outside) == 1 and outside[0].real > 0.0:
            return order
    raise IdentificationError(f"{example.code}: no order has one unstable real eigenvalue")


def _of_order(found: Identification, order: int, *, stable: bool) -> Identification:
    model, _ = model_of(found, order, stable=stable)
    return replace(found, model=model, order=order)


def _forced(model: control.StateSpace) -> control.StateSpace:
    """Return a model whose unstable eigenvalues alone are moved (section 3.2, third example)."""
    names = {"inputs": list(model.input_labels), "outputs": list(model.output_labels)}
    return control.ss(stabilise(model.A, "clamp")[0], model.B, model.C, model.D, model.dt, **names)


def _reduced(
    example: Example, full: Identification, trained: IoData
) -> tuple[dict[str, control.StateSpace], dict[str, Reduction]]:
    reductions: dict[str, Reduction] = {}
    for name, kept in example.reduced.items():
        if name in WAYS:
            reductions[name] = _reduction(example, full, trained, kept, "none")
            continue
        for ending, update in (("", "b"), (C_UPDATED, "c")):
            reductions[name + ending] = _reduction(example, full, trained, kept, update)
    models = {name: reduction.model for name, reduction in reductions.items()}
    first = next(iter(reductions.values()))
    balanced = balanced_truncation(full.model, first.order, output_scale(trained))
    models["balanced"] = balanced.model
    return models, reductions


def _reduction(
    example: Example, full: Identification, trained: IoData, kept: Kept, update: str
) -> Reduction:
    known = example.known_modes_hz[: kept.bending_modes] if kept.ranking == "mrmc" else ()
    return reduce_model(
        full,
        trained,
        ranking=kept.ranking,
        order=kept.order,
        known_modes_hz=known,
        update=update,  # type: ignore[arg-type]
    )


class _Validation:
    """Both validations of all models of a trial."""

    def __init__(
        self, record: IoData, set_point: IoData, models: Mapping[str, control.StateSpace]
    ) -> None:
        self._record, self._set_point = record, set_point
        self._dmv: dict[str, FloatArray] = {}
        self._sfv: dict[str, FloatArray] = {}
        self.dmv_errors: dict[str, tuple[float, ...]] = {}
        self.sfv_errors: dict[str, tuple[float, ...]] = {}
        for name, model in models.items():
            dmv = matched(model, record)
            self._dmv[name], self.dmv_errors[name] = dmv.y, tuple(dmv.delta.tolist())
            if name in (*WAYS, "balanced", "unstable"):
                continue
            sfv = followed(model, set_point)
            self._sfv[name], self.sfv_errors[name] = sfv.y, tuple(sfv.delta.tolist())

    def curves(self) -> Curves:
        """Return what there is to draw."""
        return Curves(
            self._record.dt_s,
            _small(self._record.y),
            {name: _small(y) for name, y in self._dmv.items()},
            _small(self._set_point.y),
            {name: _small(y) for name, y in self._sfv.items()},
        )


def _matrices(models: Mapping[str, control.StateSpace]) -> dict[str, Matrices]:
    return {name: (model.A, model.B, model.C) for name, model in models.items()}


def _small(y: FloatArray) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):
        return np.asarray(y, dtype=np.float32)


RUNS_AWAY = 10.0
"""A simulation whose error is ten times its signal is of a loop that is not stable."""


def calls(code: str, noise: str) -> tuple[Call, ...]:
    """Return the computations of one example, one per seed."""
    return tuple(Call(reduction_trial, (code, noise, seed)) for seed in SEEDS)


def both_calls(code: str) -> tuple[Call, ...]:
    """Return those with little noise and with the thesis's."""
    return (*calls(code, LOW), *calls(code, THESIS))


def trials(results: Results, code: str, noise: str) -> tuple[ReductionTrial, ...]:
    """Look the results of `calls` up."""
    return tuple(results[call] for call in calls(code, noise))


def records_of(results: Results, code: str) -> Records:
    """Look up the results of `both_calls`."""
    return Records(EXAMPLES[code], trials(results, code, LOW), trials(results, code, THESIS))


def errors(
    found: Sequence[ReductionTrial], stage: str, validation: Validation = "dmv"
) -> NDArray[np.float64]:
    """Return the errors of a stage, (seeds, 4)."""
    return np.array([getattr(trial.stages[stage], validation) for trial in found])


def means(
    found: Sequence[ReductionTrial], stage: str, validation: Validation = "dmv"
) -> NDArray[np.float64]:
    """Return the mean errors of a stage, (seeds,)."""
    return np.asarray(errors(found, stage, validation).mean(axis=1))


def ratios(
    found: Sequence[ReductionTrial], stage: str, validation: Validation = "dmv"
) -> NDArray[np.float64]:
    """Return the mean errors of a stage over the full model's, where that is stable."""
    full = means(found, INITIAL, validation)
    steady = full < RUNS_AWAY
    if not steady.any():
        return np.array([np.inf])
    return np.asarray(means(found, stage, validation)[steady] / full[steady])


def error_text(value: float) -> str:
    """Return an error as text."""
    return f"{value:.3f}" if value < RUNS_AWAY else "runs away"


def ratio_text(values: NDArray[np.float64]) -> str:
    """Return the median of `ratios` as text."""
    middle = float(np.median(values))
    return f"{middle:.2f}" if middle < RUNS_AWAY else "runs away"


def errors_text(values: NDArray[np.float64]) -> str:
    """Return median and range of an error as text."""
    low, high = float(values.min()), float(values.max())
    return f"{error_text(float(np.median(values)))} ({error_text(low)} to {error_text(high)})"
