"""Protocol of a control law: four signals and a reference in, an effort out, every sample.

A law answers with the feedback effort u_e and the Coulomb friction compensation u_c, kept apart
(4-6): the identification subtracts u_c.

Every law answers an effort that is not finite with zero effort and zero compensation. Such an
effort comes from a measurement or reference that is NaN, infinite or so large that the sum
overflows; all three are faults, and zero is the command that adds no energy. So the outputs are
finite for every input.

Every law knows where the drive saturates and asks for no more (`limited`).
"""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, NamedTuple, Protocol

from flexarm_core.channels import MAX_COMMAND_V

if TYPE_CHECKING:
    from collections.abc import Sequence


class Effort(NamedTuple):
    """Answer of a law: the parts of the command.

    Attributes
    ----------
    effort_v
        Feedback effort u_e, V.
    compensation_v
        Coulomb friction compensation u_c, V; the drive gets the sum (4-6).
    """

    effort_v: float
    compensation_v: float


NO_EFFORT = Effort(0.0, 0.0)
"""Answer to a fault, known by identity: `Handover` drops its fade at it, not at a zero effort."""


def limited(effort_v: float, compensation_v: float = 0.0) -> Effort:
    """Answer within the range of the drive.

    The effort takes the cut: the friction that the compensation stands for is there all the same.

    Parameters
    ----------
    effort_v
        Feedback effort u_e, V; one that is not finite gives `NO_EFFORT`.
    compensation_v
        Coulomb friction compensation u_c, V, finite and within the range of the drive.
    """
    if not isfinite(effort_v):
        return NO_EFFORT
    if -MAX_COMMAND_V <= effort_v + compensation_v <= MAX_COMMAND_V:
        return Effort(effort_v, compensation_v)
    rail_v = MAX_COMMAND_V if effort_v > 0.0 else -MAX_COMMAND_V
    return Effort(rail_v - compensation_v, compensation_v)


class Law(Protocol):
    """A control law as a pure stepper: one call per sample, all state inside the law."""

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample.

        Parameters
        ----------
        volts
            Position, base strain, middle strain and speed, V.
        reference_v
            Position reference, V.
        """

    def reset(self) -> None:
        """Forget the past, as before the first sample."""
