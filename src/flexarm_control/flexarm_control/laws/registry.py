"""The control laws by their names, each answering one sample at a time."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from types import MappingProxyType
from typing import TYPE_CHECKING

from flexarm_control.laws.gains import Compensation, Coulomb, PdGains, PdpGains, PiGains, Sampling
from flexarm_control.laws.ilqr import Ilqr, IlqrWeights, design_ilqr
from flexarm_control.laws.law import NO_EFFORT, SATURATION_V, Effort, Law, limited
from flexarm_control.laws.lqg import LqgWeights, design_lqg
from flexarm_control.laws.payload import PayloadDetection
from flexarm_control.laws.pdpc import Pdp, Pdpc
from flexarm_control.laws.pdpc_plus import PdpcPlus, Rest
from flexarm_control.laws.schedule import ScheduleGains
from flexarm_control.laws.scheduled import ScheduledPdpc
from flexarm_control.models.nominal_models import identified_model
from flexarm_core.errors import SettingError
from flexarm_core.specs import (
    Bounded,
    ParameterSpec,
    parameter_specs,
    refuse_unknown,
    select,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


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
        if effort_v == 0.0:
            return Effort(0.0, 0.0)
        level_v = self.coulomb.compensation_v
        return limited(effort_v, level_v if effort_v > 0.0 else -level_v)

    def reset(self) -> None:
        """Do nothing: the law has no state."""


class Pi:
    """PI law that evaluates models (Figure 4-1), without friction compensation.

    u_e = kp e + ki dt (e(0) + ... + e(k)), with e = R - y1. The sum stands still while the drive
    is saturated and the error would drive it further.

    Parameters
    ----------
    gains
        Gains of the law.
    sampling
        Sampling rate of its samples.
    """

    def __init__(self, gains: PiGains, sampling: Sampling) -> None:
        self._gains = gains
        self._dt_s = 1.0 / sampling.rate_hz
        self._integral_v_s = 0.0

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer one sample; see `Law.step`."""
        error_v = reference_v - volts[0]
        if not isfinite(error_v):
            return NO_EFFORT
        integral_v_s = self._integral_v_s + self._dt_s * error_v
        effort_v = self._gains.kp * error_v + self._gains.ki * integral_v_s
        if abs(effort_v) <= SATURATION_V or effort_v * error_v < 0.0:
            self._integral_v_s = integral_v_s
        return limited(effort_v)

    def reset(self) -> None:
        """Forget the sum of the errors."""
        self._integral_v_s = 0.0


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


def _make_pi(values: Mapping[str, float]) -> Pi:
    return Pi(select(PiGains, values), select(Sampling, values))


def _make_pdp(values: Mapping[str, float]) -> Pdp:
    return Pdp(select(PdpGains, values))


def _make_pdpc(values: Mapping[str, float]) -> Pdpc:
    return Pdpc(select(PdpGains, values), select(Compensation, values))


def _make_pdpc_unconditional(values: Mapping[str, float]) -> Pdpc:
    return Pdpc(select(PdpGains, values), select(Compensation, values), conditional=False)


def _make_ilqr(values: Mapping[str, float]) -> Ilqr:
    return Ilqr(design_ilqr(identified_model(), select(IlqrWeights, values)))


def _make_lqg(values: Mapping[str, float]) -> Ilqr:
    return Ilqr(design_lqg(identified_model(), select(LqgWeights, values)))


def _make_pdpc_plus(values: Mapping[str, float]) -> PdpcPlus:
    return PdpcPlus(
        select(PdpGains, values),
        select(Compensation, values).compensation_v,
        select(Rest, values),
    )


def _make_pdpc_scheduled(values: Mapping[str, float]) -> ScheduledPdpc:
    return ScheduledPdpc(
        select(ScheduleGains, values),
        select(Compensation, values),
        select(PayloadDetection, values),
    )


_DESIGNED_ON_A_MODEL = ("ilqr", "lqg")

#: Every law by the name it has as a ROS parameter.
LAWS: Mapping[str, LawSpec] = MappingProxyType(
    {
        "pd": LawSpec(
            "PD with Coulomb friction compensation (section 2.4.3)",
            _table(PdGains, Coulomb),
            _make_pd,
        ),
        "pi": LawSpec(
            "PI without friction compensation, for the evaluation of models (4-1)",
            _table(PiGains, Sampling),
            _make_pi,
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
        "ilqr": LawSpec(
            "integral plus LQR control from the position, on a model with 300 g (section 4.4)",
            _table(IlqrWeights),
            _make_ilqr,
        ),
        "lqg": LawSpec(
            "integral plus LQR control from all four signals, on a model with 300 g: a baseline",
            _table(LqgWeights),
            _make_lqg,
        ),
        "pdpc_plus": LawSpec(
            "PDPC that comes to rest without gear hitting and lets no swing live on (chapter 5)",
            _table(PdpGains) + _LEVEL + _table(Rest),
            _make_pdpc_plus,
        ),
        "pdpc_scheduled": LawSpec(
            "PDPC whose gains follow the payload that it detects (chapter 5)",
            _table(ScheduleGains, Compensation, PayloadDetection),
            _make_pdpc_scheduled,
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
    SettingError
        When the law or a parameter is unknown, or a value is outside its range.
    """
    if name not in LAWS:
        raise SettingError(f"no law {name!r}; choose one of {', '.join(LAWS)}")
    values = values or {}
    refuse_unknown(name, LAWS[name].parameters, values)
    return LAWS[name].make(values)


def law_rate_hz(name: str, values: Mapping[str, float]) -> float | None:
    """Return the sampling rate that a law is made for; None for a law that suits any rate.

    Parameters
    ----------
    name
        One of `LAWS`.
    values
        Parameters of the law by name, as for `build_law`.
    """
    if name in _DESIGNED_ON_A_MODEL:
        return 1.0 / float(identified_model().dt)
    usual = {spec.name: spec.default for spec in LAWS[name].parameters}
    rate_hz = (usual | dict(values)).get("rate_hz")
    return float(rate_hz) if isinstance(rate_hz, int | float) else None
