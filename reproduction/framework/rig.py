"""Experiments and control laws on the simulated rig, without nodes: fast and by seed.

Each command acts at the sample that it answers, as in the node graph in virtual time without delay.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_control.laws.law_protocol import Effort
from flexarm_control.laws.registry import build_law
from flexarm_control.references import build_reference
from flexarm_control.simulation import simulate
from flexarm_daq import SimulatedRig
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.experiments.excitation import (
    EXCITATIONS,
    Bounded,
    Held,
    PeriodicRandom,
    Random,
)
from flexarm_ident import IoData
from reproduction.framework.study_rig import calm_rig, choices, study_rig

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_control.laws.law_protocol import Law
    from flexarm_control.simulation import LoopRun
    from flexarm_daq import RigParameters
    from flexarm_daq.experiments.catalogue import Experiment
    from flexarm_daq.experiments.excitation import Excitation

RATE_HZ = 300.0
STEP_S = 10.0
AT_REST_S = 8.0
"""From here on a step counts as over, and what moves is vibration."""


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


def simulated_record(name: str, seed: int, *, calm: bool = False) -> IoData:
    """Run an experiment of the catalogue on the rig of the study; see `run_experiment`.

    Parameters
    ----------
    name : str
        An experiment of Tables A-1 to A-4.
    seed : int
        Seed of the sensor noise and of a random excitation or reference.
    calm : bool
        Whether the sensors have little noise.

    Raises
    ------
    CatalogueError
        For an unknown experiment.
    """
    entry = experiment(name)
    rig = calm_rig if calm else study_rig
    return run_experiment(entry, rig(entry.payload_kg), seed)


def run_experiment(entry: Experiment, parameters: RigParameters, seed: int) -> IoData:
    """Run an experiment, of the catalogue or changed, on a rig of its own.

    The parameters determine the payload, not the experiment. The record has compensation and
    reference when a law made the commands.
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
        law = _OpenLoop(_excitation(entry, seed), entry.rate_hz)
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


def _excitation(entry: Experiment, seed: int) -> Excitation:
    magnitude_v, hold_s = entry.magnitude_v, choices().hold_s
    match entry.waveform:
        case "periodic_random":
            return PeriodicRandom(magnitude_v, seed, hold_s)
        case "random":
            return Random(magnitude_v, seed, hold_s)
        case "bounded_random":
            return Bounded(magnitude_v, Held(seed, hold_s))
    return EXCITATIONS[entry.waveform](magnitude_v, seed)


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


def run_law(
    law: Law, reference_v: NDArray[np.float64], *, arm: RigParameters, seed: int
) -> LoopRun:
    """Run a law on the rig from rest along a reference, V, (samples,)."""
    rig = SimulatedRig(arm, rate_hz=RATE_HZ, seed=seed)
    return simulate(rig, law, reference_v, true_outputs=rig.outputs_v)


def step_to(
    law: Law, setpoint_v: float, *, arm: RigParameters, seed: int, length_s: float = STEP_S
) -> LoopRun:
    """Run a law to a constant set-point; see `run_law`."""
    reference_v = np.full(round(length_s * RATE_HZ), setpoint_v)
    return run_law(law, reference_v, arm=arm, seed=seed)


def step_trial(run: LoopRun) -> StepTrial:
    """Return the figures of a step."""
    position_v = run.y[:, 0]
    figures = step_figures(run.time_s, position_v, float(run.reference_v[0]))
    at_rest = run.time_s >= AT_REST_S
    gauge_v, vibration_v = (
        float(np.sqrt(np.mean(np.square(signals[at_rest, 1])))) for signals in (run.y, run.true_y)
    )
    return StepTrial(
        figures.mean_error_v, figures.overshoot, figures.settling_s, gauge_v, vibration_v
    )
