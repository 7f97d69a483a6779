"""The experiments of the catalogue on the simulated rig, without nodes: fast and by seed.

Each command acts at the sample that it answers, as in the node graph in virtual time without delay.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.laws.law_protocol import Effort
from flexarm_control.laws.registry import build_law
from flexarm_control.references import build_reference
from flexarm_control.simulation import simulate
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.experiments.excitation import EXCITATIONS
from flexarm_daq.rigs.rig_parameters import LOW_NOISE_V
from flexarm_ident import IoData

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.laws.law_protocol import Law
    from flexarm_daq.experiments.catalogue import Experiment
    from flexarm_daq.experiments.excitation import Excitation


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
    time_s = [k / entry.rate_hz for k in range(entry.samples)]
    law: Law
    if entry.law:
        profile = dict(entry.profile)
        if entry.reference == "varying_square":
            profile["seed"] = seed
        reference = build_reference(entry.reference, profile)
        law, reference_v = build_law(entry.law, entry.gains), [reference(each) for each in time_s]
    else:
        law = _OpenLoop(EXCITATIONS[entry.waveform](entry.magnitude_v, seed), entry.rate_hz)
        reference_v = [0.0] * entry.samples
    run = simulate(rig, law, np.array(reference_v))
    return IoData(
        run.command_v,
        run.y,
        dt_s=1.0 / entry.rate_hz,
        closed_loop=entry.closed_loop,
        source=f"{entry.name}, seed {seed}",
        compensation=run.compensation if entry.law else None,
        reference=run.reference_v if entry.law else None,
    )


class _OpenLoop:
    """An excitation as a law: it follows time and no reference."""

    def __init__(self, excitation: Excitation, rate_hz: float) -> None:
        self._excitation = excitation
        self._rate_hz = rate_hz

    def step(self, volts: Sequence[float], _: float) -> Effort:
        """Answer one sample; see `flexarm_control.laws.law_protocol.Law.step`."""
        time_s = self._samples / self._rate_hz
        self._samples += 1
        return Effort(self._excitation.step(time_s, volts[0]), 0.0)

    def reset(self) -> None:
        """Begin the experiment anew."""
        self._samples = 0
        self._excitation.reset()
