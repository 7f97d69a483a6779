"""Protocol of a rig: one sample in, one command out.

Reading and writing are two calls, because a command acts when it arrives: within the sampling
period, after the controller has answered. A rig that applied it with the next sample would delay
the loop by a full period. PD and PDP control would then be unstable at 300 Hz.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, Protocol

from flexarm_core.errors import FlexarmError
from flexarm_core.signals import RigSample

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray


__all__ = ["OFF_RATE", "DriveNotStoppedError", "Rig", "RigError", "RigSample"]

OFF_RATE: Final = 0.005
"""A rate that is off by more than this part makes every identified frequency wrong."""


class RigError(FlexarmError):
    """Failure to open, read or write a rig; the message states a remedy."""


class DriveNotStoppedError(RigError):
    """Failure to set the drive to zero: only the emergency stop is left."""


class Bodies(Protocol):
    """Bodies of an open rig, to be drawn."""

    def solids(self) -> list[dict[str, Any]]:
        """Return what the bodies are made of, as JSON takes it.

        A solid has the number of its `body`, `kind` (box, sphere, ellipsoid, capsule, cylinder),
        `size_m` (half widths along x, y and z; radius and half length of the last two, whose axis
        is z), `place_m` and `turn` (a quaternion w, x, y, z) in the body's frame, and `rgba`.
        """

    def poses(self) -> FloatArray:
        """Return the newest pose of each body, (bodies, 7): place in m, quaternion w, x, y, z."""


class Rig(Protocol):
    """Interface between the system and its hardware.

    The node paces the sampling: it reads once a period of its own clock. A rig whose hardware has a
    sample clock says so by an attribute `has_own_clock` that is true, and its `read` blocks until
    the next sample of that clock.

    A simulated rig whose time stands still between its samples says so by an attribute
    `has_virtual_time` that is true. It has an attribute `clock`, None in virtual time, by which it
    moves in real time.

    A text `about` is what an open rig says of its hardware; `rig check` prints it.

    A rig that lacks a sensor reads a constant in its place, and names the channel in an attribute
    `absent_channels`, a tuple: neither self-test nor sensor check asks anything of that channel.

    A rig that knows where its bodies are has them in an attribute `bodies`, which the page draws.
    """

    def open(self) -> None:
        """Open the hardware, with the drive at zero.

        Raises
        ------
        RigError
            If the hardware is missing or in use.
        """

    def read(self) -> RigSample:
        """Sample all channels now, or return the next sample of the rig's own clock.

        `time_s` is the instant of the sample, also after a period that was skipped.

        Raises
        ------
        RigError
            If the rig is not open or the reading failed.
        """

    def write(self, commands: Sequence[float]) -> None:
        """Command the drives; the commands act at once and until the next write.

        Parameters
        ----------
        commands : sequence of float, (inputs,)
            Commands in the order of the rig's description, within its limits.

        Raises
        ------
        RigError
            If the rig is not open, a command is not finite or the writing failed.
        """

    def safe_stop(self) -> None:
        """Set the drive to zero; works in any state, any number of times, and never raises.

        Another thread may call it, though never beside a call of this or another method, and
        `write` may follow.
        """

    def close(self) -> None:
        """Set the drive to zero and release the hardware; does nothing on a closed rig.

        Raises
        ------
        DriveNotStoppedError
            If the hardware did not take the zero; the rig is closed all the same.
        """


METHODS = ("open", "read", "write", "safe_stop", "close")
"""Methods of a rig."""


def has_own_clock(rig: Rig) -> bool:
    """Return whether reading a rig waits for its own clock, which paces the sampling."""
    return bool(getattr(rig, "has_own_clock", False))


def has_virtual_time(rig: Rig) -> bool:
    """Return whether the time of a rig stands still between its samples."""
    return bool(getattr(rig, "has_virtual_time", False))


def absent_channels(rig: Rig) -> tuple[str, ...]:
    """Return the names of the channels that a rig has no sensor for."""
    return tuple(getattr(rig, "absent_channels", ()))


def bodies_of(rig: Rig) -> Bodies | None:
    """Return the bodies of a rig that knows them."""
    return getattr(rig, "bodies", None)
