"""First motion of a record under a model with dry friction, and validation from there.

Where an arm comes to rest depends on how it began: under friction a wrong initial state moves the
whole simulation. The initial state of the linear model, which knows no friction, is only a start.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import Normal, minimise
from flexarm_ident.fitting.output_fit import fit_initial_states
from flexarm_ident.fitting.validation import (
    Dmv,
    about_mean,
    check_model,
    mean_error,
    relative_errors,
    rms,
)
from flexarm_ident.friction.dry_friction import simulate_with_friction
from flexarm_ident.records.signals import live_samples

if TYPE_CHECKING:
    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.friction.dry_friction import DryFriction
    from flexarm_ident.records.iodata import IoData

_STEP = 1e-3
_ITERATIONS = 30
# What a state of the outputs' size costs, in relative errors of one sample.
_REST = 0.3


def validate_with_friction(
    model: control.StateSpace, friction: DryFriction, data: IoData, x0: FloatArray | None = None
) -> Dmv:
    """Compare measured outputs with `simulate_with_friction` under the measured input (2-25).

    Parameters
    ----------
    model : control.StateSpace
        Discrete model from the net input.
    friction : DryFriction
        Friction at its inputs.
    data : IoData
        Record.
    x0 : ndarray, (states,), optional
        Initial state. None: the one that `fit_initial_state` finds.

    Raises
    ------
    IdentificationError
        If model and record differ in channels or sampling period.
    """
    check_model(model, data)
    start = fit_initial_state(model, friction, data) if x0 is None else x0
    y, _ = simulate_with_friction(model, friction, data.u, start)
    delta = relative_errors(data.y_measured, y)
    return Dmv(delta, mean_error(delta), about_mean(delta, data.y_measured), y, start)


def fit_initial_state(model: control.StateSpace, friction: DryFriction, data: IoData) -> FloatArray:
    """Return the initial state, (states,), whose simulation is nearest to the record.

    What the record does not tell, as where a sensor is dead at the beginning, stays at rest. The
    arguments are those of `validate_with_friction`.
    """
    size = rms(data.y_measured)
    weight = live_samples(data) / np.where(size > 0.0, size, 1.0)
    scale = np.abs(np.linalg.pinv(model.C) @ size)
    scale[scale == 0.0] = scale.max() or 1.0

    def residuals(part: FloatArray) -> FloatArray:
        y, _ = simulate_with_friction(model, friction, data.u, scale * part)
        return np.concatenate([(weight * (y - data.y)).ravel(), _REST * part])

    def cost(part: FloatArray) -> float:
        return float(np.sum(residuals(part) ** 2))

    def normal(part: FloatArray) -> Normal:
        missed = residuals(part)
        changed = [residuals(part + _STEP * way) for way in np.eye(len(part))]
        slopes = (np.stack(changed, axis=1) - missed[:, np.newaxis]) / _STEP
        return Normal(float(missed @ missed), slopes.T @ missed, slopes.T @ slopes)

    rest = np.zeros(model.nstates)
    starts = (rest, fit_initial_states(model, [data])[0] / scale)
    found = [minimise(start, cost, normal, iterations=_ITERATIONS) for start in starts]
    return np.asarray(scale * min(found, key=lambda each: each.cost).theta)
