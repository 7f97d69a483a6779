"""Registry of the control laws: one row for each, the only list of them but for the user's own.

A file of the user's, named by the environment variable FLEXARM_LAWS, has a tuple `LAWS` of
`LawSpec` rows. All processes of flexarm have them beside its own: nodes, verbs, the page, and the
replay of a record.
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexarm_control.laws.gains import (
    CompensationLevel,
    Coulomb,
    OptionalCompensation,
    PdGains,
    PdpGains,
    PiGains,
    Sampling,
    TunedCompensation,
    TunedPdpGains,
)
from flexarm_control.laws.ilqr import Ilqr, IlqrDesign, IlqrWeights, design_ilqr
from flexarm_control.laws.lqg import (
    Lqg,
    LqgSettings,
    LqgWeights,
    design_lqg,
    packaged_designs,
)
from flexarm_control.laws.payload import PayloadDetection, PayloadEstimate, PayloadSensing
from flexarm_control.laws.pdpc import Pd, Pdp, Pdpc, Pi
from flexarm_control.laws.pdpc_plus import PdpcPlus, Rest, RestThresholds
from flexarm_control.laws.pdpc_scheduled import ScheduledPdpc, ScheduleGains
from flexarm_control.laws.planned import FrictionSensing, Planned
from flexarm_control.laws.regulator_loop import stabilising_design
from flexarm_control.laws.strain_limit import StrainLimit
from flexarm_control.models.nominal_models import identified_model
from flexarm_control.planning.flat_arm import ArmFigures, fitted_arm
from flexarm_control.planning.move import MoveSettings
from flexarm_core.errors import SettingError
from flexarm_core.own_files import error_text, failed_line, own_module
from flexarm_core.specs import (
    Bounded,
    ParameterSpec,
    parameter_specs,
    refuse_unknown,
    select,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    import control

    from flexarm_control.laws.law_protocol import LawWithMemory

FILES = "FLEXARM_LAWS"
"""Environment variable: Python files with laws, separated as those of PATH."""
_NAME = re.compile("[a-z][a-z0-9_]*")
_MODELS = "models"
_METHODS = ("step", "reset", "memory", "remember")
_AT_REST_V = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class LawSpec:
    """Row of one control law.

    Attributes
    ----------
    name, title : str
        Name, as the ROS parameter `law` has it, and one line for the choice of a law.
    build : callable
        Constructor of the law from one instance of each of `settings`; `build_law` calls it. With a
        `design`, the first argument is the result of that in place of the weights.
    settings : tuple of Bounded classes
        Tables of the gains and other parameters, with their defaults.
    design : callable or None
        Design of the law from a model and an instance of the first of `settings`, its weights; the
        rate of the law is that of the model.
    packaged : callable or None
        Function from the weights to what the constructor takes without a model; None takes the
        design on `identified_model`.
    fit : callable or None
        Function from an identified model and an instance of the first of `settings` to what the
        constructor takes in place of these; without a model the law has these.
    tuning : str
        Name of the tuning of its gains, a key of `design.tuning_job.TUNINGS`; empty for none.
    payload : callable or None
        Function from the law to its estimate of the payload, if it has one.
    uses_outputs : tuple of int
        Places of the outputs that the law uses, in the order of the channels.
    plays : callable or None
        Function from the law to its PDP loop, which plays a trajectory; None if it has none.
    """

    name: str
    title: str
    build: Callable[..., LawWithMemory]
    settings: tuple[type[Bounded], ...]
    design: Callable[[control.StateSpace, Any], IlqrDesign] | None = None
    packaged: Callable[[Any], object] | None = None
    fit: Callable[[control.StateSpace, Any], object] | None = None
    tuning: str = ""
    payload: Callable[[Any], PayloadEstimate] | None = None
    uses_outputs: tuple[int, ...] = (0, 1, 2, 3)
    plays: Callable[[Any], LawWithMemory] | None = None

    @property
    def parameters(self) -> tuple[ParameterSpec, ...]:
        """Table of all parameters; one that several `settings` have is in it once."""
        specs = (spec for kind in self.settings for spec in parameter_specs(kind))
        return tuple({spec.name: spec for spec in specs}.values())

    @property
    def takes_model(self) -> bool:
        """Whether the law can be built on an identified model."""
        return self.design is not None or self.fit is not None

    @property
    def is_tuned_to_margins(self) -> bool:
        """Whether its tuning meets least margins; that of the PI law is for models (4-1)."""
        return self.tuning not in {"", "pi"}

    def rate_hz(
        self, values: Mapping[str, float], model: control.StateSpace | None = None
    ) -> float | None:
        """Return the sampling rate of the law, Hz; None if it suits any rate.

        Values and model are as for `build_law`.
        """
        if self.design is not None:
            return 1.0 / float((model or identified_model()).dt)
        usual = {spec.name: spec.default for spec in self.parameters}
        rate_hz = (usual | dict(values)).get("rate_hz")
        return float(rate_hz) if isinstance(rate_hz, int | float) else None


def _itself(law: LawWithMemory) -> LawWithMemory:
    return law


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
        plays=_itself,
    ),
    LawSpec(
        "pdpc",
        "PDP with conditional Coulomb friction compensation (4-6 to 4-8)",
        Pdpc,
        (TunedPdpGains, TunedCompensation),
        tuning="pdp",
        uses_outputs=_PDP_OUTPUTS,
        plays=_itself,
    ),
    LawSpec(
        "pdpc_unconditional",
        "PDP with Coulomb friction compensation that stays on (Figure 4-10 c, d)",
        Pdpc,
        (PdpGains, CompensationLevel),
        tuning="pdp",
        uses_outputs=_PDP_OUTPUTS,
        plays=_itself,
    ),
    LawSpec(
        "ilqr",
        "integral plus LQR control from the position, designed on a model (section 4.4)",
        Ilqr,
        (IlqrWeights, OptionalCompensation),
        design=design_ilqr,
        tuning="ilqr",
        uses_outputs=_POSITION,
    ),
    LawSpec(
        "lqg",
        "LQG control from all four signals; it tolerates delay and follows the payload (chapter 5)",
        Lqg,
        (LqgWeights, LqgSettings, StrainLimit, RestThresholds, PayloadSensing),
        design=design_lqg,
        packaged=packaged_designs,
        tuning="lqg",
        payload=lambda law: law.payload,
    ),
    LawSpec(
        "pdpc_plus",
        "PDPC that comes to rest without gear hitting and lets no swing live on (chapter 5)",
        PdpcPlus,
        (TunedPdpGains, CompensationLevel, Rest),
        tuning="pdp",
        plays=_itself,
    ),
    LawSpec(
        "pdpc_scheduled",
        "PDPC whose gains follow the payload that it detects (chapter 5)",
        ScheduledPdpc,
        (ScheduleGains, TunedCompensation, PayloadDetection),
        tuning="pdpc_scheduled",
        payload=lambda law: law.payload,
    ),
    LawSpec(
        "planned",
        "planned moves with a PDP loop on the differences and the rest of pdpc_plus (chapter 5)",
        Planned,
        (
            ArmFigures,
            MoveSettings,
            TunedPdpGains,
            CompensationLevel,
            Rest,
            FrictionSensing,
            PayloadDetection,
        ),
        fit=fitted_arm,
        tuning="pdp",
        payload=lambda law: law.payload,
        plays=lambda law: law.loop,
    ),
)


def build_law(
    name: str,
    values: Mapping[str, float] | None = None,
    model: control.StateSpace | None = None,
) -> LawWithMemory:
    """Build a law from its name and parameters.

    Parameters
    ----------
    name : str
        Key of `LAWS`.
    values : mapping of str to float, optional
        Parameters that differ from their defaults.
    model : control.StateSpace, optional
        Identified model that a law with a design is designed on, by default a packaged one; or that
        a law with a fit takes its figures from. Other laws have none.

    Returns
    -------
    LawWithMemory
        Law before its first sample.

    Raises
    ------
    SettingError
        When the law or a parameter is unknown, a value is outside its range, or there is no
        stabilising design.
    """
    if name not in LAWS:
        raise SettingError(
            f"no law {name!r}; choose one of {', '.join(LAWS)}, or name its file in {FILES}"
        )
    spec, values = LAWS[name], values or {}
    refuse_unknown(name, spec.parameters, values)
    first, *others = (select(kind, values) for kind in spec.settings)
    if spec.fit is not None and model is not None:
        return spec.build(spec.fit(model, first), *others)
    if spec.design is None:
        return spec.build(first, *others)
    if spec.packaged is not None and model is None:
        return spec.build(spec.packaged(first), *others)
    return spec.build(_designed(spec.design, first, model), *others)


def _designed(
    design: Callable[[control.StateSpace, Any], IlqrDesign],
    weights: Any,  # noqa: ANN401 - those of the design
    model: control.StateSpace | None,
) -> IlqrDesign:
    """Return the design on a model; the packaged one is reduced already."""
    if model is None:
        return design(identified_model(), weights)
    return stabilising_design(design, model, weights)


def own_laws(known: Sequence[str]) -> tuple[LawSpec, ...]:
    """Return the rows of the user's laws, each tried once at rest.

    Parameters
    ----------
    known : sequence of str
        Names that are taken.

    Raises
    ------
    SettingError
        When a file cannot be read, or has a row that is not a law or whose name is taken.
    """
    files = [each for each in os.environ.get(FILES, "").split(os.pathsep) if each]
    found: dict[str, LawSpec] = {}
    for file in files:
        for each in _rows(file):
            if each.name in {*known, *found, _MODELS}:
                raise SettingError(
                    f"{FILES}: {file}: law {each.name!r}: the name is taken: choose another one"
                )
            if not _NAME.fullmatch(each.name):
                raise SettingError(
                    f"{FILES}: {file}: law {each.name!r}: a name is a word in small letters"
                )
            _try_out(file, each)
            found[each.name] = each
    return tuple(found.values())


def _rows(file: str) -> Iterator[LawSpec]:
    """Yield the rows of a file."""
    rows = getattr(own_module(Path(file), FILES), "LAWS", ())
    if not rows or not all(isinstance(each, LawSpec) for each in rows):
        raise SettingError(
            f"{FILES}: {file}: it has no tuple LAWS of LawSpec rows (docs/howto/own_law.md)"
        )
    yield from rows


def _try_out(file: str, row: LawSpec) -> None:
    """Refuse a law that does not answer a sample at rest; one that needs a model is left alone."""
    if row.design is not None:
        return
    start = f"{FILES}: {file}: law {row.name}"
    try:
        law = row.build(*(kind() for kind in row.settings))
        lacking = [name for name in _METHODS if not callable(getattr(law, name, None))]
        if not lacking:
            _answer_at_rest(law)
    except Exception as error:
        where = failed_line(error, Path(file))
        raise SettingError(
            f"{start} does not answer at rest{where}: {error_text(error)}"
        ) from error
    if lacking:
        raise SettingError(f"{start} has no method {', '.join(lacking)}")


def _answer_at_rest(law: Any) -> None:  # noqa: ANN401 - it may be none
    law.reset()
    law.remember(law.memory())
    effort_v, compensation_v = law.step(_AT_REST_V, 0.0)
    if not math.isfinite(effort_v + compensation_v):
        raise ValueError(f"{effort_v} V of effort and {compensation_v} V of compensation")


# At the end: the files of the user's laws take what is above from here.
#: Every law by the name it has as a ROS parameter, those of the user last.
LAWS: Mapping[str, LawSpec] = MappingProxyType(
    {row.name: row for row in (*_ROWS, *own_laws([row.name for row in _ROWS]))}
)
