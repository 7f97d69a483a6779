"""What a simulated record turns out to be: its length, its rate and how far it goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm_core.channels import POSITION_V_PER_RAD
from flexarm_daq.experiments.catalogue import catalogue
from flexarm_ident.fitting.validation import recover_gains
from reproduction.framework.records import simulated_record


@dataclass(frozen=True)
class RecordFacts:
    """Facts of one record, measured in it.

    Attributes
    ----------
    name
        The experiment.
    samples, rate_hz
        Length and sampling rate.
    command_v
        Largest magnitude of the command without compensation.
    position_deg
        Largest magnitude of the arm's angle.
    reference_v, compensation_v
        Largest magnitudes; zero in an open loop.
    kp, kd
        Gains of the PD law that the record itself shows; zero where there is none.
    """

    name: str
    samples: int
    rate_hz: float
    command_v: float
    position_deg: float
    reference_v: float = 0.0
    compensation_v: float = 0.0
    kp: float = 0.0
    kd: float = 0.0


def record_facts(kind: str, seed: int) -> tuple[RecordFacts, ...]:
    """Simulate every experiment of a kind and measure the records.

    Parameters
    ----------
    kind
        A key of `flexarm_daq.experiments.catalogue.KINDS`.
    seed
        Of noise and random excitations.
    """
    return tuple(_facts(name, seed) for name, entry in catalogue().items() if entry.kind == kind)


def _facts(name: str, seed: int) -> RecordFacts:
    record = simulated_record(name, seed)
    effort = record.effort[:, 0]
    gains = recover_gains(record)
    return RecordFacts(
        name=name,
        samples=len(record),
        rate_hz=1.0 / record.dt_s,
        command_v=float(np.abs(effort).max()),
        position_deg=float(np.degrees(np.abs(record.y[:, 0]).max() / POSITION_V_PER_RAD)),
        reference_v=_largest(record.reference),
        compensation_v=_largest(record.compensation),
        kp=gains.kp if gains else 0.0,
        kd=gains.kd if gains else 0.0,
    )


def _largest(values: np.ndarray | None) -> float:
    return 0.0 if values is None else float(np.abs(values).max())
