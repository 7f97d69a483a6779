"""The experiments of the catalogue on the simulated rig, without nodes: fast and by seed.

Each command acts at the sample that it answers, as in the node graph in virtual time without delay.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.registry import build_law
from flexarm_control.references import build_reference
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.experiments.excitation import EXCITATIONS
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V
from flexarm_ident import IoData

if TYPE_CHECKING:
    from flexarm_daq.experiments.catalogue import Experiment


def simulated_record(
    name: str, seed: int, noise_v: tuple[float, float, float, float] = LOW_NOISE_V
) -> IoData:
    """Run an experiment of the catalogue on the simulated rig.

    Parameters
    ----------
    name
        An experiment of Tables A-1 to A-4.
    seed
        Of the sensor noise, and of what is random in the excitation or the reference.
    noise_v
        Standard deviation of the noise of each sensor, V.

    Returns
    -------
    IoData
        The record as it was sampled; with compensation and reference when a law made the commands.

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
    entry
        The experiment. Its payload says nothing here: the parameters do.
    parameters
        Of the rig.
    seed
        Of the sensor noise, and of what is random in the excitation or the reference.

    Returns
    -------
    IoData
        As `simulated_record` gives it.
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
