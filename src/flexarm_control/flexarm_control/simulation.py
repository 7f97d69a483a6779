"""Closed loop of a law on a linear model of the arm, for design checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.models.arm_model import check_arm_model, check_no_feedthrough

if TYPE_CHECKING:
    import control

    from flexarm_control.laws.law import Law
    from flexarm_core.arrays import FloatArray


@dataclass(frozen=True)
class LoopRun:
    """Signals of one simulated run.

    Attributes
    ----------
    time_s
        Sample instants, s, shape (samples,).
    y
        Position, base strain, middle strain and speed, V, shape (samples, 4).
    effort
        Feedback effort u_e, V, shape (samples,).
    compensation
        Coulomb friction compensation u_c, V, shape (samples,).
    """

    time_s: FloatArray
    y: FloatArray
    effort: FloatArray
    compensation: FloatArray


def simulate_loop(model: control.StateSpace, law: Law, reference_v: FloatArray) -> LoopRun:
    """Run a law on a model from rest, sample by sample.

    The input of the model is the feedback effort alone. The models of the thesis leave the
    friction out (section 2.4.3), so the compensation, which cancels it on the arm, is recorded
    but does not act.

    Parameters
    ----------
    model
        Model of the arm; `flexarm_control.models.arm_model.delayed` gives it a loop delay.
    law
        The law; it is reset first.
    reference_v
        Reference at every sample, V, shape (samples,).

    Returns
    -------
    LoopRun
        Signals at every sample.

    Raises
    ------
    SettingError
        When the model is not one of the arm or its D is not zero.
    """
    check_arm_model(model)
    check_no_feedthrough(model)
    A, b, C = np.asarray(model.A), np.asarray(model.B)[:, 0], np.asarray(model.C)
    samples = len(reference_v)
    y, effort, compensation = np.empty((samples, len(C))), np.empty(samples), np.empty(samples)
    x = np.zeros(len(A))
    law.reset()
    for k, reference in enumerate(np.asarray(reference_v, dtype=float).tolist()):
        y[k] = C @ x
        effort[k], compensation[k] = law.step(y[k].tolist(), reference)
        x = A @ x + b * effort[k]
    return LoopRun(model.dt * np.arange(samples), y, effort, compensation)
