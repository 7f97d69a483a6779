"""Experiments and control laws on the simulated rig, without nodes: fast and by seed.

Each command acts at the sample that it answers, as in the node graph in virtual time without delay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_control.laws.registry import build_law
from flexarm_control.references import build_reference
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.experiments.excitation import EXCITATIONS
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V
from flexarm_ident import IoData

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_control.laws.law import Law
    from flexarm_daq.experiments.catalogue import Experiment

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
        Command to the drive.
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
    mean_error_v, overshoot, settling_s : float
        As in `flexarm_control.StepFigures`, from the measured position.
    gauge_v : float
        Root mean square of the base gauge at rest, as measured, V.
    vibration_v : float
        The same without the sensor's noise, V.
    """

    mean_error_v: float
    overshoot: float
    settling_s: float
    gauge_v: float
    vibration_v: float


def simulated_record(
    name: str, seed: int, noise_v: tuple[float, float, float, float] = LOW_NOISE_V
) -> IoData:
    """Run an experiment of the catalogue on the simulated rig; see `run_experiment`.

    Parameters
    ----------
    name : str
        An experiment of Tables A-1 to A-4.
    seed : int
        Seed of the sensor noise, and of what is random in the excitation or the reference.
    noise_v : tuple of float
        Standard deviation of the noise of each sensor, V.

    Raises
    ------
    CatalogueError
        When there is no such experiment.
    """
    entry = experiment(name)
    return run_experiment(entry, RigParameters(payload_kg=entry.payload_kg, noise_v=noise_v), seed)


def run_experiment(entry: Experiment, parameters: RigParameters, seed: int) -> IoData:
    """Run an experiment, one of the catalogue or a changed one, on a rig of its own.

    Parameters
    ----------
    entry : Experiment
        The experiment. Its payload says nothing here: the parameters do.
    parameters : RigParameters
        The rig.
    seed : int
        As in `simulated_record`.

    Returns
    -------
    IoData
        The record as it was sampled; with compensation and reference when a law made the commands.
    """
    rig = SimulatedRig(parameters, rate_hz=entry.rate_hz, seed=seed)
    rig.open()
    source = f"{entry.name}, seed {seed}"
    return (
        _controlled(rig, entry, seed, source) if entry.law else _excited(rig, entry, seed, source)
    )


def _excited(rig: SimulatedRig, entry: Experiment, seed: int, source: str) -> IoData:
    excitation = EXCITATIONS[entry.waveform](entry.magnitude_v, seed)
    y, u = np.empty((entry.samples, 4)), np.empty(entry.samples)
    for k in range(entry.samples):
        y[k] = rig.read().volts
        u[k] = excitation.step(k / entry.rate_hz, float(y[k, 0]))
        rig.write(float(u[k]))
    return IoData(u, y, dt_s=1.0 / entry.rate_hz, closed_loop=False, source=source)


def _controlled(rig: SimulatedRig, entry: Experiment, seed: int, source: str) -> IoData:
    profile = dict(entry.profile)
    if entry.reference == "varying_square":
        profile["seed"] = seed
    law, reference = build_law(entry.law, entry.gains), build_reference(entry.reference, profile)
    y, answers = np.empty((entry.samples, 4)), np.empty((entry.samples, 2))
    reference_v = np.array([reference(k / entry.rate_hz) for k in range(entry.samples)])
    for k in range(entry.samples):
        y[k] = rig.read().volts
        answers[k] = law.step(y[k].tolist(), float(reference_v[k]))
        rig.write(float(answers[k].sum()))
    return IoData(
        answers.sum(axis=1),
        y,
        dt_s=1.0 / entry.rate_hz,
        closed_loop=True,
        source=source,
        compensation=answers[:, 1],
        reference=reference_v,
    )


def run_law(law: Law, reference_v: NDArray[np.float64], *, arm: RigParameters, seed: int) -> LawRun:
    """Run a law on the rig from rest.

    Parameters
    ----------
    law : Law
        The law, as built.
    reference_v : ndarray, (samples,)
        Reference at every sample.
    arm : RigParameters
        The rig.
    seed : int
        Seed of the sensor noise.
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
    """Return the figures of a step."""
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
