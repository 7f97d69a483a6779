"""Protocol of a control law: four signals and a reference in, an effort out, every sample.

A law returns the feedback effort u_e and the Coulomb friction compensation u_c separately (4-6):
the identification subtracts u_c.

Every law answers an effort that is not finite with zero effort and zero compensation. Such an
effort comes from a measurement or reference that is NaN, infinite or too large for the sum. All
three are faults, and zero is the command that adds no energy. The outputs are therefore finite for
every input.

Every law limits its command to the range of the drive (`limited`). The gate of the DAQ node may cut
more: a law whose memory follows from its commands gets what was sent (`HearingLaw`).
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from flexarm_core.channels import MAX_COMMAND_V

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import TypeAlias

    Memory: TypeAlias = Mapping[str, Sequence[float]]
    """Numbers that a law has in memory, by the name of their group."""


class Effort(NamedTuple):
    """Answer of a law: the parts of the command (4-6).

    Attributes
    ----------
    effort_v, compensation_v : float
        Feedback effort u_e and Coulomb friction compensation u_c, V; the drive gets their sum.
    """

    effort_v: float
    compensation_v: float


NO_EFFORT = Effort(0.0, 0.0)
"""Answer to a fault, known by identity: `Handover` drops its fade at it, not at a zero effort."""


def limited(effort_v: float, compensation_v: float = 0.0) -> Effort:
    """Return an answer within the range of the drive.

    The effort is cut, since the friction that the compensation stands for is present in any case.

    Parameters
    ----------
    effort_v : float
        Feedback effort u_e, V; one that is not finite gives `NO_EFFORT`.
    compensation_v : float
        Coulomb friction compensation u_c, V, finite and within the range of the drive.
    """
    if not isfinite(effort_v):
        return NO_EFFORT
    if -MAX_COMMAND_V <= effort_v + compensation_v <= MAX_COMMAND_V:
        return Effort(effort_v, compensation_v)
    rail_v = MAX_COMMAND_V if effort_v > 0.0 else -MAX_COMMAND_V
    return Effort(rail_v - compensation_v, compensation_v)


def winds_up(error_v: float, cut_v: float, last_cut_v: float) -> bool:
    """Return whether an error drives an effort further, of which this or the last one was cut."""
    # Written so that NaN winds up too.
    return not (cut_v * error_v <= 0.0 and last_cut_v * error_v <= 0.0)


class DriveCommand(NamedTuple):
    """Command that was in force while a sample was taken, as `ArmState` has it.

    Attributes
    ----------
    command_v, compensation_v : float
        Command of the drive behind all limits, and the part of it that compensates friction, V.
    """

    command_v: float
    compensation_v: float


class Law(Protocol):
    """Control law as a pure stepper: one call per sample, with all state inside the law."""

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample.

        Parameters
        ----------
        volts : sequence of float
            Position, base strain, middle strain and speed, V.
        reference_v : float
            Position reference, V.
        """

    def reset(self) -> None:
        """Return to the state before the first sample."""


class LawWithMemory(Law, Protocol):
    """Law whose state can be recorded and restored: every law of the registry."""

    def memory(self) -> Memory:
        """Return what the next answers follow from, beside gains, samples and references.

        The groups and their sizes are always the same.
        """

    def remember(self, memory: Memory) -> None:
        """Go on from a memory of the same law; `memory` may have further groups."""


@runtime_checkable
class HearingLaw(Protocol):
    """Law whose memory follows from its commands: an observer, or a sum of errors."""

    def hear(self, missing_v: float, cut_v: float) -> None:
        """Hear before a sample what became of the last answer; both are zero when it was sent.

        Parameters
        ----------
        missing_v : float
            Effort in force at the sample, less the effort that was answered, V.
        cut_v : float
            Effort that was asked for in vain, since a limit has cut it off, V; zero when the
            answer is only late, and the one before was in force.
        """


def hearing(law: Law) -> Callable[[float, float], None]:
    """Return the `hear` of a law; of one that has none, what does nothing."""
    return law.hear if isinstance(law, HearingLaw) else _ignore


def _ignore(missing_v: float, cut_v: float) -> None:
    """Do nothing: the law does not remember its commands."""


class Memoryless:
    """Base of the laws without a state."""

    def reset(self) -> None:
        """Do nothing: the law has no state."""

    def memory(self) -> Memory:
        """Return nothing: the law has no state."""
        return {}

    def remember(self, memory: Memory) -> None:
        """Do nothing: the law has no state."""
