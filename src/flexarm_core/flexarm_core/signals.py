"""Samples and commands as they pass through the loop, of any number of inputs and outputs."""

from __future__ import annotations

from typing import NamedTuple


class Sample(NamedTuple):
    """Outputs at one instant, with the command in force while they were sampled.

    Attributes
    ----------
    taken_ns : int
        Instant, nanoseconds since the epoch.
    sequence : int
        Number of the sampling period, from 1.
    outputs : tuple of float
        Readings, in the order and the units of the rig's description.
    commands, compensations : tuple of float
        Commands of the inputs behind all limits, and the part of each that compensates friction.
    command_sequence : int
        Number of the command in force; 0 for none.
    """

    taken_ns: int
    sequence: int
    outputs: tuple[float, ...]
    commands: tuple[float, ...]
    compensations: tuple[float, ...]
    command_sequence: int


class Command(NamedTuple):
    """Request of a controller in answer to one sample.

    Attributes
    ----------
    sequence, state_sequence : int
        Number of the command, and of the sample that it answers.
    efforts, compensations : tuple of float
        Feedback efforts u_e and friction compensations u_c (4-6) of the inputs; each drive gets
        their sum.
    stamp_ns : int
        Instant of the sample that it answers, nanoseconds since the epoch.
    """

    sequence: int
    state_sequence: int
    efforts: tuple[float, ...]
    compensations: tuple[float, ...]
    stamp_ns: int = 0
