"""Table 4-1: models of three types, judged by the PI law that each leads to (section 4.1).

The thesis does not say what compensated the friction when its PI laws were implemented. Its models
of type II know of none, and their laws would stop 1.7 V away from the set-point. So ours are
implemented with the compensation that the record was made with, as the laws of section 2.4.3; the
models of the other types have the friction in them, and their laws go without.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_control.design.tuning import tune_pi
from flexarm_control.laws.gains import Sampling
from flexarm_control.laws.law import Effort
from flexarm_control.laws.registry import Pi
from flexarm_control.simulation import simulate_loop
from flexarm_daq import RigParameters
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident.workflow.workflow import Request
from flexarm_ident.workflow.workflow import run as identify_record
from reproduction.framework.law_runs import RATE_HZ, STEP_S, step_to
from reproduction.framework.records import simulated_record

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_control.laws.law import Law

SETPOINT_V = 3.0
TYPE_WITHOUT_FRICTION = "II"


class ModelCode(NamedTuple):
    """How a model of Table 4-1 was made.

    Attributes
    ----------
    type
        I: open loop; II: closed loop, compensation removed; III: closed loop, left in.
    record
        Experiment; its first half is identified.
    order, reduced_order
        States of the identified and of the reduced model.
    flexible_modes
        Flexible modes that the reduction keeps, the lowest.
    """

    type: str
    record: str
    order: int
    reduced_order: int
    flexible_modes: int


CODES = {
    "Ao2r_9": ModelCode("I", "O_dat2", 19, 9, 3),
    "Ac3r_8": ModelCode("II", "C_dat3", 18, 8, 2),
    "Ac3r_10": ModelCode("II", "C_dat3", 18, 10, 3),
    "Ac3r_10c": ModelCode("III", "C_dat3", 22, 10, 3),
}


class _Compensated:
    """A law with the unconditional compensation of section 2.4.3 on top."""

    def __init__(self, law: Law, level_v: float) -> None:
        self._law, self._level_v = law, level_v

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        effort_v, _ = self._law.step(volts, reference_v)
        return Effort(effort_v, math.copysign(self._level_v, effort_v))

    def reset(self) -> None:
        self._law.reset()


@dataclass(frozen=True)
class PiCase:
    """One model, its PI law, and the step that the law makes on the model and on the rig.

    Attributes
    ----------
    order
        States of the reduced model.
    kp, ki, criterion
        Gains and J of (4-1).
    error_v, rise_s
        Steady-state error for a step of 1 V and rise time, both on the model.
    time_s, simulated_v, implemented_v : ndarray, (samples,)
        A step to 3 V: position on the model and on the rig.
    """

    order: int
    kp: float
    ki: float
    criterion: float
    error_v: float
    rise_s: float
    time_s: NDArray[np.float64]
    simulated_v: NDArray[np.float64]
    implemented_v: NDArray[np.float64]

    @property
    def mismatch(self) -> float:
        """Root mean square of the difference of the two steps over the set-point."""
        difference = np.nan_to_num(self.simulated_v, nan=np.inf) - self.implemented_v
        return float(np.sqrt(np.mean(np.square(difference))) / SETPOINT_V)

    @property
    def implemented_itae(self) -> float:
        """J of (4-1) of the step on the rig, for 1 V."""
        share = 1.0 - self.implemented_v / SETPOINT_V
        return float(np.sum(self.time_s * np.abs(share)) / RATE_HZ)


def pi_case(code: str, seed: int) -> PiCase:
    """Identify, reduce and update a model, tune the PI law on it, and step model and rig.

    Parameters
    ----------
    code
        A key of `CODES`.
    seed
        Of the record, and of the noise of the step.
    """
    made = CODES[code]
    entry = experiment(made.record)
    arm = RigParameters(payload_kg=entry.payload_kg)
    outcome = identify_record(
        simulated_record(made.record, seed),
        Request(
            method="orse_thesis",
            order=made.order,
            reduction="mrmc",
            reduced_order=made.reduced_order,
            known_modes_hz=tuple(natural_frequencies_hz(arm)[: made.flexible_modes].tolist()),
            update="b",
            remove_compensation=made.type != "III",
            friction=False,
        ),
    )
    tuned = tune_pi(outcome.model)

    law = Pi(tuned.gains, Sampling(RATE_HZ))
    level_v = entry.gains["compensation_v"] if made.type == TYPE_WITHOUT_FRICTION else 0.0
    on_rig = step_to(_Compensated(law, level_v), SETPOINT_V, arm=arm, seed=seed)
    on_model = simulate_loop(outcome.model, law, on_rig.reference_v)
    position_v = np.array(on_model.y[:, 0], dtype=float)
    figures = step_figures(on_model.time_s, position_v, SETPOINT_V)
    return PiCase(
        outcome.model.nstates,
        tuned.gains.kp,
        tuned.gains.ki,
        tuned.criterion,
        abs(figures.mean_error_v) / SETPOINT_V,
        min(figures.rise_s, STEP_S),
        on_rig.time_s,
        position_v,
        on_rig.measured_v[:, 0],
    )
