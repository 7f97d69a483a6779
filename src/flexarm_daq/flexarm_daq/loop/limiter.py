"""Limiter of the commands: the last gate before the rig."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final, NamedTuple

from flexarm_core.channels import MAX_COMMAND_V
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flexarm_core.rig_description import RigDescription

NOT_FINITE: Final = "not_finite"
MAGNITUDE: Final = "magnitude"
SLEW: Final = "slew"
POSITION_BOUND: Final = "position_bound"
LIMITS: Final = (NOT_FINITE, MAGNITUDE, SLEW, POSITION_BOUND)


class InputLimits(NamedTuple):
    """Limits of one input, in its unit, and of the joint that it drives, in that of the angle.

    Attributes
    ----------
    low, high : float
        Ends of the command.
    slew_per_s : float
        Fastest change a second.
    travel_low, travel_high : float
        Positions beyond which no command drives further outward.
    sign : int
        1 where a positive command drives towards positive positions, else -1.
    rest : float
        Command at which the drive rests, within its ends.
    holds : bool
        Beyond the travel every command is `rest`, not only one that drives outward.
    """

    low: float
    high: float
    slew_per_s: float
    travel_low: float = -math.inf
    travel_high: float = math.inf
    sign: int = 1
    rest: float = 0.0
    holds: bool = False

    def is_refused(self, command: float, position: float) -> bool:
        """Return whether a command may not act at a position, since it leads further outward."""
        if self.travel_low <= position <= self.travel_high:
            return False
        outward = 1.0 if position > self.travel_high else -1.0
        return self.holds or self.sign * (command - self.rest) * outward > 0.0


@dataclass(frozen=True)
class LimiterSettings:
    """Limits of the thesis's arm, as parameters.

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

    def limits(self) -> InputLimits:
        """Return the limits of the drive."""
        return InputLimits(
            -self.max_command_v,
            self.max_command_v,
            self.max_slew_v_per_s,
            -self.position_bound_v,
            self.position_bound_v,
        )


class LimitedCommand(NamedTuple):
    """Limited command of one input.

    Attributes
    ----------
    command : float
        Command, in the unit of the input.
    compensation : float
        Part of it that is friction compensation; the rest is feedback effort.
    reasons : tuple of str
        Limits that acted, in order; empty if the command passed unchanged.
    """

    command: float
    compensation: float
    reasons: tuple[str, ...]


class Limiter:
    """Clamp, slew limit and position bound, in that order, behind a check for finite numbers.

    The command at rest is the safe state of the drive. A command that is not finite, or that drives
    outward beyond the bound, becomes that at once, whatever the slew limit; a command beyond a
    magnitude that was lowered comes back to it at once too. The slew is counted from the last
    applied command.

    A limited command keeps its compensation as far as the command reaches, and the effort is cut.
    The compensation stands for friction, which is present in any case. The rest moves the arm and
    is the input of an identification (section 2.4.3).

    Parameters
    ----------
    limits : InputLimits
        Limits; they may be replaced between two commands.

    Examples
    --------
    >>> limiter = Limiter(InputLimits(-10.0, 10.0, 6000.0))
    >>> limiter.apply(12.0, 0.8, position=0.0, interval_s=0.01)
    LimitedCommand(command=10.0, compensation=0.8, reasons=('magnitude',))
    """

    def __init__(self, limits: InputLimits) -> None:
        self.limits = limits
        self._applied = limits.rest

    def reset(self) -> None:
        """Forget the last command: the drive was set to rest by other means."""
        self._applied = self.limits.rest

    def apply(
        self, effort: float, compensation: float, position: float, interval_s: float
    ) -> LimitedCommand:
        """Limit one command.

        Parameters
        ----------
        effort, compensation : float
            Feedback effort u_e and friction compensation u_c of equation (4-6).
        position : float
            Position of the joint in the newest sample; 0 for an input that drives none.
        interval_s : float
            Time since the last command was applied, s.

        Returns
        -------
        LimitedCommand
            Command to write, always finite and within the limits.
        """
        limits = self.limits
        wanted = effort + compensation
        # A sum of finite numbers may overflow, and a sum of infinities may be NaN.
        if not (math.isfinite(wanted) and math.isfinite(position) and math.isfinite(interval_s)):
            self._applied = limits.rest
            return LimitedCommand(limits.rest, 0.0, (NOT_FINITE,))
        reasons: tuple[str, ...] = ()
        command = min(max(wanted, limits.low), limits.high)
        if command != wanted:
            reasons += (MAGNITUDE,)
        change = command - self._applied
        allowed = limits.slew_per_s * max(interval_s, 0.0)
        if abs(change) > allowed:
            slewed = self._applied + math.copysign(allowed, change)
            command = min(max(slewed, limits.low), limits.high)
            reasons += (SLEW,)
        if limits.is_refused(command, position):
            command = limits.rest
            reasons += (POSITION_BOUND,)
        self._applied = command
        if reasons:
            compensation = _share(compensation, command)
        return LimitedCommand(command, compensation, reasons)


def _share(part: float, whole: float) -> float:
    """Limit a part to between zero and its whole."""
    return min(max(part, min(whole, 0.0)), max(whole, 0.0))


class Limited(NamedTuple):
    """Limited commands of all inputs, and the limits that acted on any of them."""

    commands: tuple[float, ...]
    compensations: tuple[float, ...]
    reasons: tuple[str, ...]


class Gate:
    """Limiters of all inputs: the last gate before the rig.

    Parameters
    ----------
    limits : iterable of InputLimits
        Limits of each input.
    positions : sequence of int or None
        Output with the position of the joint that each input drives; None for none.
    """

    def __init__(self, limits: Iterable[InputLimits], positions: Sequence[int | None]) -> None:
        self._limiters = tuple(map(Limiter, limits))
        self._positions = tuple(positions)
        self.rest = tuple(each.limits.rest for each in self._limiters)

    @property
    def limits(self) -> tuple[InputLimits, ...]:
        """Limits of each input; they may be replaced between two commands."""
        return tuple(each.limits for each in self._limiters)

    @limits.setter
    def limits(self, limits: Iterable[InputLimits]) -> None:
        for limiter, each in zip(self._limiters, limits, strict=True):
            limiter.limits = each

    def reset(self) -> None:
        """Forget the last commands: the drives were set to rest by other means."""
        for limiter in self._limiters:
            limiter.reset()

    def apply(
        self,
        efforts: Sequence[float],
        compensations: Sequence[float],
        outputs: Sequence[float],
        interval_s: float,
    ) -> Limited:
        """Limit the commands of all inputs; see `Limiter.apply`.

        Raises
        ------
        ValueError
            If there are more or fewer commands than inputs.
        """
        found = [
            limiter.apply(
                effort, compensation, 0.0 if place is None else outputs[place], interval_s
            )
            for limiter, place, effort, compensation in zip(
                self._limiters, self._positions, efforts, compensations, strict=True
            )
        ]
        commands, shares, reasons = zip(*found, strict=True)
        return Limited(commands, shares, tuple(dict.fromkeys(sum(reasons, ()))))


def arm_gate(settings: LimiterSettings | None = None) -> Gate:
    """Return the gate of the thesis's arm."""
    return Gate([(settings or LimiterSettings()).limits()], [0])


def rig_gate(rig: RigDescription) -> Gate:
    """Return the gate of a rig by its description."""
    joints = {each.input: each for each in rig.joints}
    limits, positions = [], []
    for each in rig.inputs:
        joint = joints.get(each.name)
        limit = InputLimits(each.low, each.high, each.slew_per_s, rest=each.rest)
        if joint is not None:
            limit = limit._replace(
                travel_low=joint.low,
                travel_high=joint.high,
                sign=joint.sign,
                holds=rig.safety.end_of_travel == "hold",
            )
        limits.append(limit)
        positions.append(rig.output_names.index(joint.angle) if joint else None)
    return Gate(limits, positions)
