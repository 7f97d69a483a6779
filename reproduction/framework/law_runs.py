"""Runs of a control law on the simulated rig, and their figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_control.simulation import simulate
from flexarm_daq import SimulatedRig

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_control.laws.law_protocol import Law
    from flexarm_control.simulation import LoopRun
    from flexarm_daq import RigParameters

RATE_HZ = 300.0
STEP_S = 10.0
AT_REST_S = 8.0
"""From here on a step counts as over, and what moves is vibration."""


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


def run_law(
    law: Law, reference_v: NDArray[np.float64], *, arm: RigParameters, seed: int
) -> LoopRun:
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
    return simulate(rig, law, reference_v, true_outputs=rig.outputs_v)


def step_to(
    law: Law, setpoint_v: float, *, arm: RigParameters, seed: int, length_s: float = STEP_S
) -> LoopRun:
    """Run a law to a constant set-point; see `run_law`."""
    reference_v = np.full(round(length_s * RATE_HZ), setpoint_v)
    return run_law(law, reference_v, arm=arm, seed=seed)


def step_trial(run: LoopRun) -> StepTrial:
    """Figures of a step."""
    position_v = run.y[:, 0]
    figures = step_figures(run.time_s, position_v, float(run.reference_v[0]))
    at_rest = run.time_s >= AT_REST_S
    gauge_v, vibration_v = (
        float(np.sqrt(np.mean(np.square(signals[at_rest, 1])))) for signals in (run.y, run.true_y)
    )
    return StepTrial(
        figures.mean_error_v, figures.overshoot, figures.settling_s, gauge_v, vibration_v
    )
