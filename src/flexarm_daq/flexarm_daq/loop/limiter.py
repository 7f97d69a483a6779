"""Limiter of the command: the last gate before the rig."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.errors import SettingError

NOT_FINITE: Final = "not_finite"
MAGNITUDE: Final = "magnitude"
SLEW: Final = "slew"
POSITION_BOUND: Final = "position_bound"
LIMITS: Final = (NOT_FINITE, MAGNITUDE, SLEW, POSITION_BOUND)


@dataclass(frozen=True)
class LimiterSettings:
    """Limits of the command.

    Attributes
    ----------
    max_command_v : float
        Largest magnitude, at most the drive's 10 V.
    max_slew_v_per_s : float
        Fastest change, V/s; the default allows a full reversal in one period of 300 Hz.
    position_bound_v : float
        Position beyond which no command drives further outward, V; by default four degrees before
        the stops.

    Raises
    ------
    SettingError
        If a limit is not a positive number, or the magnitude exceeds that of the drive.
    """

    max_command_v: float = MAX_COMMAND_V
    max_slew_v_per_s: float = 6000.0
    position_bound_v: float = 6.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < math.inf:
                raise SettingError(f"{field.name} must be a positive number, got {value}")
        if self.max_command_v > MAX_COMMAND_V:
            raise SettingError(
                f"max_command_v must not exceed the drive's {MAX_COMMAND_V:g} V, "
                f"got {self.max_command_v}"
            )


class LimitedCommand(NamedTuple):
    """Limited command.

    Attributes
    ----------
    command_v : float
        Command, V.
    compensation_v : float
        Part of it that is friction compensation, V; the rest is feedback effort.
    reasons : tuple of str
        Limits that acted, in order; empty if the command passed unchanged.
    """

    command_v: float
    compensation_v: float
    reasons: tuple[str, ...]


_ZERO_NOT_FINITE: Final = LimitedCommand(0.0, 0.0, (NOT_FINITE,))


class Limiter:
    """Clamp, slew limit and position bound, in that order, behind a check for finite numbers.

    Zero is the safe state of the drive. A command that is not finite, or that drives outward beyond
    the bound, becomes zero at once, whatever the slew limit; a command beyond a magnitude that was
    lowered comes back to it at once too. The slew is counted from the last applied command.

    A limited command keeps its compensation as far as the command reaches, and the effort is cut.
    The compensation stands for friction, which is present in any case. The rest moves the arm and
    is the input of an identification (section 2.4.3).

    Parameters
    ----------
    settings : LimiterSettings, optional
        Limits; they may be replaced between two commands.

    Examples
    --------
    >>> Limiter().apply(12.0, 0.8, position_v=0.0, interval_s=0.01)
    LimitedCommand(command_v=10.0, compensation_v=0.8, reasons=('magnitude',))
    """

    def __init__(self, settings: LimiterSettings | None = None) -> None:
        self.settings = settings if settings is not None else LimiterSettings()
        self._applied_v = 0.0

    def reset(self) -> None:
        """Forget the last command: the drive was set to zero by other means."""
        self._applied_v = 0.0

    def apply(
        self, effort_v: float, compensation_v: float, position_v: float, interval_s: float
    ) -> LimitedCommand:
        """Limit one command.

        Parameters
        ----------
        effort_v, compensation_v : float
            Feedback effort u_e and friction compensation u_c of equation (4-6), V.
        position_v : float
            Position of the newest sample, V.
        interval_s : float
            Time since the last command was applied, s.

        Returns
        -------
        LimitedCommand
            Command to write, always finite and within the limits.
        """
        wanted_v = effort_v + compensation_v
        # A sum of finite numbers may overflow, and a sum of infinities may be NaN.
        if not (
            math.isfinite(wanted_v) and math.isfinite(position_v) and math.isfinite(interval_s)
        ):
            self._applied_v = 0.0
            return _ZERO_NOT_FINITE
        settings = self.settings
        reasons: tuple[str, ...] = ()
        command_v = _clamp(wanted_v, settings.max_command_v)
        if command_v != wanted_v:
            reasons += (MAGNITUDE,)
        change_v = command_v - self._applied_v
        allowed_v = settings.max_slew_v_per_s * max(interval_s, 0.0)
        if abs(change_v) > allowed_v:
            slewed_v = self._applied_v + _clamp(change_v, allowed_v)
            command_v = _clamp(slewed_v, settings.max_command_v)
            reasons += (SLEW,)
        if abs(position_v) > settings.position_bound_v and command_v * position_v > 0.0:
            command_v = 0.0
            reasons += (POSITION_BOUND,)
        self._applied_v = command_v
        if reasons:
            compensation_v = _share(compensation_v, command_v)
        return LimitedCommand(command_v, compensation_v, reasons)


def _clamp(value: float, bound: float) -> float:
    return min(max(value, -bound), bound)


def _share(part_v: float, whole_v: float) -> float:
    """Limit a part to between zero and its whole."""
    return min(max(part_v, min(whole_v, 0.0)), max(whole_v, 0.0))
