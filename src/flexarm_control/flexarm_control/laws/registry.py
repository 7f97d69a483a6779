"""Registry of the control laws: one row for each, the only list of them."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexarm_control.laws.gains import (
    Compensation,
    CompensationLevel,
    Coulomb,
    PdGains,
    PdpGains,
    PiGains,
    Sampling,
)
from flexarm_control.laws.ilqr import Ilqr, IlqrWeights, design_ilqr
from flexarm_control.laws.lqg import LqgWeights, design_lqg
from flexarm_control.laws.payload import PayloadDetection, PayloadEstimate
from flexarm_control.laws.pd import Pd
from flexarm_control.laws.pdpc import Pdp, Pdpc
from flexarm_control.laws.pdpc_plus import PdpcPlus, Rest
from flexarm_control.laws.pdpc_scheduled import ScheduledPdpc, ScheduleGains
from flexarm_control.laws.pi import Pi
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
    from collections.abc import Callable, Mapping

    import control

    from flexarm_control.laws.law_protocol import Law


@dataclass(frozen=True)
class LawSpec:
    """Row of one control law.

    Attributes
    ----------
    name, title : str
        Name, as the ROS parameter `law` has it, and one line for the choice of a law.
    build : callable
        Constructor of the law from one instance of each of `settings`; `build_law` calls it.
    settings : tuple of Bounded classes
        Tables of the gains and other parameters, with the thesis's values as defaults.
    design_model : callable or None
        Constructor of the model of the design, whose rate is that of the law.
    tuning : str
        Name of the tuning of its gains, a key of `design.tuning_job.TUNINGS`; empty for none.
    payload : callable or None
        Function from the law to its estimate of the payload, if it has one.
    uses_outputs : tuple of int
        Places of the outputs that the law uses, in the order of the channels.
    """

    name: str
    title: str
    build: Callable[..., Law]
    settings: tuple[type[Bounded], ...]
    design_model: Callable[[], control.StateSpace] | None = None
    tuning: str = ""
    payload: Callable[[Any], PayloadEstimate] | None = None
    uses_outputs: tuple[int, ...] = (0, 1, 2, 3)

    @property
    def parameters(self) -> tuple[ParameterSpec, ...]:
        """Table of all parameters."""
        return tuple(spec for kind in self.settings for spec in parameter_specs(kind))

    def rate_hz(self, values: Mapping[str, float]) -> float | None:
        """Return the sampling rate of the law, Hz, by its parameters; None if it suits any rate."""
        if self.design_model is not None:
            return 1.0 / float(self.design_model().dt)
        usual = {spec.name: spec.default for spec in self.parameters}
        rate_hz = (usual | dict(values)).get("rate_hz")
        return float(rate_hz) if isinstance(rate_hz, int | float) else None


_POSITION = (0,)
_POSITION_AND_SPEED = (0, 3)
_PDP_OUTPUTS = (0, 2, 3)

_ROWS = (
    LawSpec(
        "pd",
        "PD with Coulomb friction compensation (section 2.4.3)",
        Pd,
        (PdGains, Coulomb),
        uses_outputs=_POSITION_AND_SPEED,
    ),
    LawSpec(
        "pi",
        "PI without friction compensation, for the evaluation of models (4-1)",
        Pi,
        (PiGains, Sampling),
        tuning="pi",
        uses_outputs=_POSITION,
    ),
    LawSpec(
        "pdp",
        "PDP without friction compensation (4-7)",
        Pdp,
        (PdpGains,),
        tuning="pdp",
        uses_outputs=_PDP_OUTPUTS,
    ),
    LawSpec(
        "pdpc",
        "PDP with conditional Coulomb friction compensation (4-6 to 4-8)",
        Pdpc,
        (PdpGains, Compensation),
        tuning="pdp",
        uses_outputs=_PDP_OUTPUTS,
    ),
    LawSpec(
        "pdpc_unconditional",
        "PDP with Coulomb friction compensation that stays on (Figure 4-10 c, d)",
        lambda gains, level: Pdpc(gains, Compensation(level.compensation_v), conditional=False),
        (PdpGains, CompensationLevel),
        tuning="pdp",
        uses_outputs=_PDP_OUTPUTS,
    ),
    LawSpec(
        "ilqr",
        "integral plus LQR control from the position, on a model with 300 g (section 4.4)",
        lambda weights: Ilqr(design_ilqr(identified_model(), weights)),
        (IlqrWeights,),
        design_model=identified_model,
        uses_outputs=_POSITION,
    ),
    LawSpec(
        "lqg",
        "integral plus LQR control from all four signals, on a model with 300 g: a baseline",
        lambda weights: Ilqr(design_lqg(identified_model(), weights)),
        (LqgWeights,),
        design_model=identified_model,
    ),
    LawSpec(
        "pdpc_plus",
        "PDPC that comes to rest without gear hitting and lets no swing live on (chapter 5)",
        lambda gains, level, rest: PdpcPlus(gains, level.compensation_v, rest),
        (PdpGains, CompensationLevel, Rest),
        tuning="pdp",
    ),
    LawSpec(
        "pdpc_scheduled",
        "PDPC whose gains follow the payload that it detects (chapter 5)",
        ScheduledPdpc,
        (ScheduleGains, Compensation, PayloadDetection),
        payload=lambda law: law.payload,
    ),
)

#: Every law by the name it has as a ROS parameter.
LAWS: Mapping[str, LawSpec] = MappingProxyType({row.name: row for row in _ROWS})


def build_law(name: str, values: Mapping[str, float] | None = None) -> Law:
    """Build a law from its name and parameters.

    Parameters
    ----------
    name : str
        Key of `LAWS`.
    values : mapping of str to float, optional
        Parameters that differ from their defaults.

    Returns
    -------
    Law
        Law before its first sample.

    Raises
    ------
    SettingError
        When the law or a parameter is unknown, or a value is outside its range.
    """
    if name not in LAWS:
        raise SettingError(f"no law {name!r}; choose one of {', '.join(LAWS)}")
    spec, values = LAWS[name], values or {}
    refuse_unknown(name, spec.parameters, values)
    return spec.build(*(select(kind, values) for kind in spec.settings))
