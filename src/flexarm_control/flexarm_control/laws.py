"""Control laws of the flexible arm, one sample at a time.

A law takes the four measured signals and the reference and answers with the feedback effort u_e
and the Coulomb friction compensation u_c, kept apart (4-6): the identification subtracts u_c.

Every law answers an effort that is not finite with zero effort and zero compensation. Such an
effort comes from a measurement or reference that is NaN, infinite or so large that the sum
overflows; all three are faults, and zero is the command that adds no energy. So the outputs are
finite for every input.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, Protocol

from flexarm_control.errors import ControlError
from flexarm_control.gains import Compensation, Coulomb, PdGains, PdpGains
from flexarm_control.parameters import (
    Bounded,
    ParameterSpec,
    parameter_specs,
    refuse_unknown,
    select,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


class Effort(NamedTuple):
    """What a law asks of the motor.

    Attributes
    ----------
    effort_v
        Feedback effort u_e, V.
    compensation_v
        Coulomb friction compensation u_c, V; the drive gets the sum (4-6).
    """

    effort_v: float
    compensation_v: float


_NO_EFFORT = Effort(0.0, 0.0)


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


@dataclass(frozen=True)
class Pd:
    """PD law with Coulomb friction compensation of the closed-loop experiments (section 2.4.3).

    u_e = kp (R - y1) - kd y4 and u_c = c sign(u_e), with no compensation at u_e = 0.
    """

    gains: PdGains = field(default_factory=PdGains)
    coulomb: Coulomb = field(default_factory=Coulomb)

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        effort_v = self.gains.kp * (reference_v - volts[0]) - self.gains.kd * volts[3]
        if not isfinite(effort_v) or effort_v == 0.0:
            return _NO_EFFORT
        level_v = self.coulomb.compensation_v
        return Effort(effort_v, level_v if effort_v > 0.0 else -level_v)

    def reset(self) -> None:
        """Do nothing: the law has no state."""


@dataclass(frozen=True)
class Pdp:
    """PDP law (4-7) without friction compensation.

    u_e = kp (R - y1) - kd y4 - ksg y3; y4 already is the speed, the dot over it in (4-7) is a
    misprint.
    """

    gains: PdpGains = field(default_factory=PdpGains)

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        gains = self.gains
        effort_v = gains.kp * (reference_v - volts[0]) - gains.kd * volts[3] - gains.ksg * volts[2]
        return Effort(effort_v, 0.0) if isfinite(effort_v) else _NO_EFFORT

    def reset(self) -> None:
        """Do nothing: the law has no state."""


@dataclass(frozen=True)
class Pdpc:
    """PDP law with conditional Coulomb friction compensation, (4-6) to (4-8).

    Parameters
    ----------
    gains
        Gains of the PDP law (4-7).
    compensation
        Level and thresholds of (4-8).
    conditional
        False keeps the compensation on after the set-point is reached, as in Figure 4-10 (c)
        and (d).
    """

    gains: PdpGains = field(default_factory=PdpGains)
    compensation: Compensation = field(default_factory=Compensation)
    conditional: bool = True

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        gains, compensation = self.gains, self.compensation
        error_v, speed_v = reference_v - volts[0], volts[3]
        effort_v = gains.kp * error_v - gains.kd * speed_v - gains.ksg * volts[2]
        if not isfinite(effort_v):
            return _NO_EFFORT
        at_set_point = (
            abs(error_v) < compensation.error_threshold_v
            and abs(speed_v) < compensation.speed_threshold_v
        )
        if self.conditional and at_set_point:
            return Effort(effort_v, 0.0)
        level_v = compensation.compensation_v
        return Effort(effort_v, level_v if effort_v >= 0.0 else -level_v)

    def reset(self) -> None:
        """Do nothing: the law has no state."""


@dataclass(frozen=True)
class LawSpec:
    """A law by name: what it is, its parameters, and how to build it.

    Attributes
    ----------
    description
        One sentence for a person who chooses a law.
    parameters
        Table of the parameters, thesis values as defaults.
    make
        Builds the law from checked values; use `build_law`.
    """

    description: str
    parameters: tuple[ParameterSpec, ...]
    make: Callable[[Mapping[str, float]], Law]


def _table(*kinds: type[Bounded]) -> tuple[ParameterSpec, ...]:
    return tuple(spec for kind in kinds for spec in parameter_specs(kind))


# Without conditions (4-8) has a level but no thresholds.
_LEVEL = parameter_specs(Compensation)[:1]


def _make_pd(values: Mapping[str, float]) -> Pd:
    return Pd(select(PdGains, values), select(Coulomb, values))


def _make_pdp(values: Mapping[str, float]) -> Pdp:
    return Pdp(select(PdpGains, values))


def _make_pdpc(values: Mapping[str, float]) -> Pdpc:
    return Pdpc(select(PdpGains, values), select(Compensation, values))


def _make_pdpc_unconditional(values: Mapping[str, float]) -> Pdpc:
    return Pdpc(select(PdpGains, values), select(Compensation, values), conditional=False)


#: Every law by the name it has as a ROS parameter.
LAWS: Mapping[str, LawSpec] = MappingProxyType(
    {
        "pd": LawSpec(
            "PD with Coulomb friction compensation (section 2.4.3)",
            _table(PdGains, Coulomb),
            _make_pd,
        ),
        "pdp": LawSpec(
            "PDP without friction compensation (4-7)",
            _table(PdpGains),
            _make_pdp,
        ),
        "pdpc": LawSpec(
            "PDP with conditional Coulomb friction compensation (4-6 to 4-8)",
            _table(PdpGains, Compensation),
            _make_pdpc,
        ),
        "pdpc_unconditional": LawSpec(
            "PDP with Coulomb friction compensation that stays on (Figure 4-10 c, d)",
            _table(PdpGains) + _LEVEL,
            _make_pdpc_unconditional,
        ),
    }
)


def build_law(name: str, values: Mapping[str, float] | None = None) -> Law:
    """Build a law from its name and parameters.

    Parameters
    ----------
    name
        A key of `LAWS`.
    values
        Parameters that differ from their defaults.

    Returns
    -------
    Law
        The law, as before its first sample.

    Raises
    ------
    ControlError
        When the law or a parameter is unknown, or a value is outside its range.
    """
    if name not in LAWS:
        raise ControlError(f"no law {name!r}; choose one of {', '.join(LAWS)}")
    values = values or {}
    refuse_unknown(name, LAWS[name].parameters, values)
    return LAWS[name].make(values)
