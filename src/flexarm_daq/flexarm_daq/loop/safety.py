"""State machine of the drive: states in which a command may act, and states with the drive at zero.

`docs/safety.md` has the drawing; `TRANSITIONS` is the same as a table.
"""

from __future__ import annotations

from collections import Counter
from enum import Enum
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping


class DriveState(Enum):
    """State of the drive."""

    OFF = "off"
    """Not sampling, the drive is at zero."""
    READY = "ready"
    """Sampling, the drive is at zero: no command is in force."""
    DRIVING = "driving"
    """Sampling, the last command is in force."""
    HELD = "held"
    """Sampling, the drive is at zero until the node is deactivated."""


class Event(Enum):
    """Event that may change the state of the drive."""

    START = "start"
    """The rig was opened."""
    COMMAND = "command"
    """A command was accepted."""
    STALE = "stale"
    """The command in force is too old."""
    EMERGENCY_STOP = "emergency stop"
    """A user or a program asked for it."""
    SENSOR_FAULT = "sensor fault"
    """A sensor cannot be trusted."""
    TWO_COMMANDERS = "two commanders"
    """Commands come from more than one commander."""
    FAILURE = "failure"
    """The rig or the loop failed."""
    END = "end"
    """Deactivation, a signal, or the last sample."""


_HOLDING = (Event.EMERGENCY_STOP, Event.SENSOR_FAULT, Event.TWO_COMMANDERS)

TRANSITIONS: Final[Mapping[tuple[DriveState, Event], DriveState]] = {
    (DriveState.OFF, Event.START): DriveState.READY,
    (DriveState.READY, Event.COMMAND): DriveState.DRIVING,
    (DriveState.DRIVING, Event.STALE): DriveState.READY,
    **{
        (state, event): DriveState.HELD
        for state in (DriveState.READY, DriveState.DRIVING)
        for event in _HOLDING
    },
    **{
        (state, event): DriveState.OFF
        for state in (DriveState.READY, DriveState.DRIVING, DriveState.HELD)
        for event in (Event.FAILURE, Event.END)
    },
}
"""Next state by state and event; a pair that is not listed changes nothing."""

COUNTED: Final = (Event.STALE, *_HOLDING)
"""Events that diagnostics count."""


class Safety:
    """State machine of one run, with the reason of its state.

    Attributes
    ----------
    state : DriveState
        Present state.
    reason : str
        First cause of a drive held at zero or of a failed run; empty otherwise.
    counts : Counter of Event
        Number of times that each event changed the state.
    """

    def __init__(self) -> None:
        self.state = DriveState.OFF
        self.reason = ""
        self.counts: Counter[Event] = Counter()

    @property
    def driving(self) -> bool:
        """True while a command may act."""
        return self.state is DriveState.DRIVING

    def on(self, event: Event, reason: str = "") -> None:
        """Take an event, with its reason in words for the user."""
        following = TRANSITIONS.get((self.state, event), self.state)
        if following is self.state:
            return
        self.state = following
        self.counts[event] += 1
        self.reason = self.reason or reason
