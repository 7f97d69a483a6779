"""A control law on the simulated rig, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_daq import SimulatedRig

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_control.laws.law import Law
    from flexarm_daq import RigParameters

RATE_HZ = 300.0
STEP_S = 10.0
AT_REST_S = 8.0
"""From here on a step counts as over, and what moves is vibration."""


@dataclass(frozen=True)
class LawRun:
    """Signals of one run.

    Attributes
    ----------
    time_s : ndarray, (samples,)
        Sample instants.
    reference_v : ndarray, (samples,)
        Reference.
    measured_v, true_v : ndarray, (samples, 4)
        The four sensors, with noise and converters and without.
    command_v : ndarray, (samples,)
        What the drive was commanded.
    """

    time_s: NDArray[np.float64]
    reference_v: NDArray[np.float64]
    measured_v: NDArray[np.float64]
    true_v: NDArray[np.float64]
    command_v: NDArray[np.float64]


@dataclass(frozen=True)
class StepTrial:
    """Figures of one step of `STEP_S`.

    Attributes
    ----------
    mean_error_v, overshoot, settling_s
        As in `flexarm_control.StepFigures`, from the measured position.
    gauge_v
        Root mean square of the base gauge at rest, as measured, V.
    vibration_v
        The same without the sensor's noise, V.
    """

    mean_error_v: float
    overshoot: float
    settling_s: float
    gauge_v: float
    vibration_v: float


def run_law(law: Law, reference_v: NDArray[np.float64], *, arm: RigParameters, seed: int) -> LawRun:
    """Run a law on the rig from rest, each command acting at the sample that it answers.

    Parameters
    ----------
    law
        The law, as built.
    reference_v : ndarray, (samples,)
        Reference at every sample.
    arm
        The rig.
    seed
        Of the sensor noise.
    """
    rig = SimulatedRig(arm, rate_hz=RATE_HZ, seed=seed)
    rig.open()
    samples = len(reference_v)
    measured_v, true_v = np.empty((samples, 4)), np.empty((samples, 4))
    command_v = np.empty(samples)
    for k, reference in enumerate(reference_v.tolist()):
        measured_v[k] = rig.read().volts
        true_v[k] = rig.outputs_v()
        command_v[k] = sum(law.step(measured_v[k].tolist(), reference))
        rig.write(float(command_v[k]))
    return LawRun(np.arange(samples) / RATE_HZ, reference_v, measured_v, true_v, command_v)


def step_to(
    law: Law, setpoint_v: float, *, arm: RigParameters, seed: int, length_s: float = STEP_S
) -> LawRun:
    """Run a law to a constant set-point; see `run_law`."""
    reference_v = np.full(round(length_s * RATE_HZ), setpoint_v)
    return run_law(law, reference_v, arm=arm, seed=seed)


def step_trial(run: LawRun) -> StepTrial:
    """Figures of a step."""
    position_v = run.measured_v[:, 0]
    figures = step_figures(run.time_s, position_v, float(run.reference_v[0]))
    at_rest = run.time_s >= AT_REST_S
    gauge_v, vibration_v = (
        float(np.sqrt(np.mean(np.square(signals[at_rest, 1]))))
        for signals in (run.measured_v, run.true_v)
    )
    return StepTrial(
        figures.mean_error_v, figures.overshoot, figures.settling_s, gauge_v, vibration_v
    )
