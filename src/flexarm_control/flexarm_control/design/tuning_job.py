"""Tuning job: models and a request in, parameters of the controller and words out."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from flexarm_control.design.margins import Requirements
from flexarm_control.design.model_sources import is_nominal, parameter_name, payload_kg
from flexarm_control.design.regulator_tuning import EFFORTS, tune_regulator
from flexarm_control.design.tuning import (
    PDP_BOUNDS,
    PDP_MORE_STARTS,
    PDP_STARTS,
    PI_BOUNDS,
    gain_values,
    tune_pdp,
    tune_pi,
)
from flexarm_control.laws.gains import Compensation, CompensationLevel
from flexarm_control.laws.ilqr import IlqrWeights, RegulatorWeights, design_ilqr
from flexarm_control.laws.lqg import LqgWeights, design_lqg
from flexarm_control.laws.pdpc_scheduled import ScheduleGains
from flexarm_control.laws.registry import LAWS
from flexarm_control.models.arm_model import (
    MIDDLE_STRAIN,
    OUTPUTS,
    POSITION,
    SPEED,
    check_arm_model,
    unreached_outputs,
)
from flexarm_core.errors import SettingError
from flexarm_core.specs import parameter_specs
from flexarm_ident.models.model_parameters import model_parameters

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence

    import control

    from flexarm_control.design.margins import Margins
    from flexarm_control.design.tuning import PdpTuning, PiTuning
    from flexarm_control.laws.gains import PdpGains, PiGains
    from flexarm_control.laws.ilqr import IlqrDesign
    from flexarm_ident.models.model_parameters import ParameterValue

    Models = Mapping[str, control.StateSpace]

_WeightsT = TypeVar("_WeightsT", bound=RegulatorWeights)

# Its compensation leaves little friction for the sum of errors, which overshoots with more.
_REGULATOR_KI = 1e-4
_LEVEL = "compensation_v"
_LEVEL_DIGITS = 3
_MOST_V = {spec.name: spec.maximum for spec in parameter_specs(CompensationLevel)}[_LEVEL] or 0.0
_SCHEDULE = ("light", "medium", "heavy")
# Largest difference of gains of one minimum, V/V.
_SPREAD = 0.05
# Part of J below which a difference is none that a step on the arm would show.
_SAME = 0.01
_FED_BACK = {OUTPUTS[SPEED]: "kd", OUTPUTS[MIDDLE_STRAIN]: "ksg"}
"""Gains of (4-7) by the outputs that they feed back."""


@dataclass(frozen=True)
class TuneRequest:
    """Request of a tuning.

    Attributes
    ----------
    law : str
        Key of `TUNINGS`; the gains are those of every law that names this tuning in its row.
    error_weight, strain_weight : float or None
        W_E and W_sg of (4-3); None takes those of `Requirements`. PI has none.
    gain_margin_db, phase_margin_deg : float or None
        Least margins on every model; None takes those of `Requirements`. PI has none.
    delay_s : float
        Loop delay, s.
    duration_s : float or None
        Length of the step of the criterion, s; None takes that of `Requirements`.
    """

    law: str = "pdp"
    error_weight: float | None = None
    strain_weight: float | None = None
    gain_margin_db: float | None = None
    phase_margin_deg: float | None = None
    delay_s: float = 0.0
    duration_s: float | None = None

    def constraints(self) -> dict[str, Any]:
        """Return the weights, the margins and the length that were given."""
        names = (field.name for field in fields(Requirements))
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    def requirements(self) -> Requirements:
        """Return weights and margins, checked."""
        return Requirements(**self.constraints())


@dataclass(frozen=True)
class TuneResult:
    """Parameters with their certificate.

    Attributes
    ----------
    parameters : mapping of str to value
        Gains by the parameter names of the controller node, such as ``pdpc.kp``; for ILQR and LQG
        also the model of the design, as ``models.<name>.*``.
    criteria : tuple of float
        J, then the sums of E and Y; J alone for PI.
    explanation : tuple of str
        What the figures are and what was searched, in words.
    margins, error_itae, strain_itae : tuple
        One per model; empty for PI.
    notes : tuple of str
        Active constraints, how sure the result is, and friction that is not the models', in words.
    """

    parameters: Mapping[str, ParameterValue]
    criteria: tuple[float, ...]
    explanation: tuple[str, ...]
    margins: tuple[Margins, ...] = ()
    error_itae: tuple[float, ...] = ()
    strain_itae: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


def tune(
    models: Models, request: TuneRequest, friction_v: Mapping[str, float] = MappingProxyType({})
) -> TuneResult:
    """Tune one law, by (4-1) or (4-3).

    Parameters
    ----------
    models : mapping of str to control.StateSpace
        Models by name.
    request : TuneRequest
        The law, its weights and margins.
    friction_v : mapping of str to float
        Friction that was found with some of the models, V: the least becomes the level of the
        compensation, as with more than there is the compensation drives the arm.

    Raises
    ------
    SettingError
        When the law cannot be tuned, the input does not move a model's position, or no gains meet
        the request.
    """
    if request.law not in TUNINGS:
        *others, last = TUNINGS
        raise SettingError(
            f"law {request.law!r} is not tunable; choose {', '.join(others)} or {last}"
        )
    for model in models.values():
        check_arm_model(model)
    unreached = {name: unreached_outputs(model) for name, model in models.items()}
    for name, outputs in unreached.items():
        if OUTPUTS[POSITION] in outputs:
            raise SettingError(no_position(name))
    result = TUNINGS[request.law](models, request)
    gains = {name.rpartition(".")[2] for name in result.parameters}
    said = [of_unreached(name, outputs, gains) for name, outputs in unreached.items() if outputs]
    result = replace(result, notes=(*said, *result.notes))
    if request.law == "pi" or all(map(is_nominal, models)):
        return result
    return _with_level(result, "pdpc" if request.law == "pdp" else request.law, friction_v)


def _with_level(result: TuneResult, law: str, friction_v: Mapping[str, float]) -> TuneResult:
    """Return a result with the level of the laws' compensation, where a model has it."""
    model = min(friction_v, key=lambda name: friction_v[name], default="")
    if not model or not 0.0 < friction_v[model] <= _MOST_V:
        return replace(result, notes=(*result.notes, compensated(law)))
    level_v = round(friction_v[model], _LEVEL_DIGITS)
    laws = {name.partition(".")[0] for name in result.parameters} & LAWS.keys()
    levels = {
        f"{each}.{_LEVEL}": level_v
        for each in sorted(laws)
        if _LEVEL in {spec.name for spec in LAWS[each].parameters}
    }
    notes = (*result.notes, handed_over(law, level_v, model))
    return replace(result, parameters={**result.parameters, **levels}, notes=notes)


def _tune_pi(models: Models, request: TuneRequest) -> TuneResult:
    if len(models) != 1:
        raise SettingError(f"pi is tuned on one model, got {len(models)}")
    unused = request.constraints()
    length = {name: unused.pop(name) for name in ("duration_s",) if name in unused}
    if unused:
        raise SettingError(f"pi is tuned without {', '.join(unused)}: leave that out or take pdp")
    found = tune_pi(next(iter(models.values())), delay_s=request.delay_s, **length)
    explanation = (
        "J: integral of time times the error of a step of 1 V (4-1), V s^2; smaller is better",
        searched(("kp", "ki"), PI_BOUNDS),
    )
    gains = _gain_parameters("pi", found.gains)
    return TuneResult(gains, (found.criterion,), explanation, notes=(pi_stopped_by(found),))


def _tune_pdp(models: Models, request: TuneRequest) -> TuneResult:
    found = _confirmed_pdp(list(models.values()), request)
    return _pdp_result(found, request, _gain_parameters("pdp", found.gains))


def _tune_schedule(models: Models, request: TuneRequest) -> TuneResult:
    """Tune gains for all payloads together, and for each of three alone."""
    if len(models) != len(_SCHEDULE):
        raise SettingError(
            f"pdpc_scheduled has gains at three payloads, {', '.join(_SCHEDULE)}; "
            f"got {len(models)} models"
        )
    names = sorted(models, key=payload_kg)
    payloads = [payload_kg(name) for name in names]
    # The law checks the payloads, before the work.
    ScheduleGains(**{f"{row}_kg": kg for row, kg in zip(_SCHEDULE, payloads, strict=True)})
    found = _confirmed_pdp(list(models.values()), request)
    rows: dict[str, float] = {}
    notes = []
    for row, name, kg in zip(_SCHEDULE, names, payloads, strict=True):
        alone = _confirmed_pdp([models[name]], request)
        values = {"kg": kg, **asdict(alone.gains)}
        rows |= {f"{row}_{key}": value for key, value in values.items()}
        bounds = at_bounds(alone.active)
        stopped = f"{stopped_by(bounds)}, " if bounds else ""
        notes.append(f"{kg:g} kg alone: J {alone.criterion:.4g}, {stopped}{confirmation(alone)}")
    gains = ScheduleGains(**asdict(found.gains), **rows)
    return _pdp_result(found, request, _prefixed("pdpc_scheduled", asdict(gains)), notes)


def _tune_ilqr(models: Models, request: TuneRequest) -> TuneResult:
    weights, more = IlqrWeights(ki=_REGULATOR_KI), asdict(Compensation())
    return _tune_regulator("ilqr", design_ilqr, weights, models, request, more=more)


def _tune_lqg(models: Models, request: TuneRequest) -> TuneResult:
    weights = LqgWeights(loop_delay_s=request.delay_s)
    return _tune_regulator("lqg", design_lqg, weights, models, request)


def _tune_regulator(
    law: str,
    design: Callable[[control.StateSpace, _WeightsT], IlqrDesign],
    start: _WeightsT,
    models: Models,
    request: TuneRequest,
    *,
    more: Mapping[str, float] = MappingProxyType({}),
) -> TuneResult:
    """Tune a regulator; `more` are the other parameters of the law that the result names."""
    wanted = request.requirements()
    found = tune_regulator(list(models.values()), design, start, wanted, delay_s=request.delay_s)
    first = next(iter(models))
    name = parameter_name(first)
    weights = {**asdict(found.weights), "states": list(found.weights.states)}
    values = {"model": name, **weights, **more}
    modes = ", ".join(f"{mode_hz:.1f}" for mode_hz in found.modes_hz)
    return TuneResult(
        _prefixed(law, values) | model_parameters(name, models[first], provenance={}),
        (found.criterion, sum(found.error_itae), sum(found.strain_itae)),
        (
            *explained(wanted),
            f"tried: {len(EFFORTS)} effort weights from {EFFORTS[0]:g} to {EFFORTS[-1]:g}",
        ),
        found.margins,
        found.error_itae,
        found.strain_itae,
        (
            stopped_by(found.active),
            f"designed on {first}: rigid motion and modes at {modes} Hz; margins: whole models",
        ),
    )


def _confirmed_pdp(models: Sequence[control.StateSpace], request: TuneRequest) -> PdpTuning:
    """Tune from the usual starts, and from more where those do not agree."""
    constraints = request.constraints()
    found = tune_pdp(models, delay_s=request.delay_s, **constraints)
    if starts_agree(found):
        return found
    starts = (*PDP_STARTS, *PDP_MORE_STARTS)
    return tune_pdp(models, delay_s=request.delay_s, starts=starts, **constraints)


def _pdp_result(
    found: PdpTuning,
    request: TuneRequest,
    parameters: Mapping[str, ParameterValue],
    notes: Sequence[str] = (),
) -> TuneResult:
    return TuneResult(
        parameters,
        (found.criterion, sum(found.error_itae), sum(found.strain_itae)),
        (*explained(request.requirements()), searched(("kp", "kd", "ksg"), PDP_BOUNDS)),
        found.margins,
        found.error_itae,
        found.strain_itae,
        (stopped_by(found.active), confirmation(found), *notes),
    )


def _gain_parameters(tuning: str, gains: PdpGains | PiGains) -> dict[str, ParameterValue]:
    """Return the gains as parameters of every law that the tuning is for."""
    rows = (row.name for row in LAWS.values() if row.tuning == tuning)
    return {key: value for name in rows for key, value in _prefixed(name, asdict(gains)).items()}


def _prefixed(law: str, values: Mapping[str, ParameterValue]) -> dict[str, ParameterValue]:
    return {f"{law}.{name}": value for name, value in values.items()}


#: Every tuning by the name that the rows of the laws have for it.
TUNINGS: Mapping[str, Callable[[Models, TuneRequest], TuneResult]] = MappingProxyType(
    {
        "pdp": _tune_pdp,
        "pi": _tune_pi,
        "pdpc_scheduled": _tune_schedule,
        "ilqr": _tune_ilqr,
        "lqg": _tune_lqg,
    }
)


def starts_agree(found: PdpTuning) -> bool:
    """Return whether all starts that met the constraints ended at the same gains."""
    return found.gain_spread <= _SPREAD


def confirmation(found: PdpTuning) -> str:
    """Return in words whether the starts confirm each other, and what to do if not."""
    feasible = [search for search in found.searches if search.feasible]
    starts = f"{len(feasible)} of {len(found.searches)} starts met the constraints"
    if len(feasible) == 1:
        return f"{starts}: no other start confirms the gains, so try them on the arm with care"
    if starts_agree(found):
        return f"{starts} and agree; gains differ by at most {found.gain_spread:.3g}"
    spread = f"{starts} and do NOT agree: gains differ by up to {found.gain_spread:.3g}"
    best = gain_values(found.gains)
    others = [each for each in feasible if np.max(np.abs(gain_values(each.gains) - best)) > _SPREAD]
    if (same := len(feasible) - len(others)) > 1:
        worst = max(each.criterion for each in others) / found.criterion - 1.0
        return (
            f"{spread}; {same} end at these, the others at a J up to {100 * worst:.0f} % larger. "
            "The models leave out friction: compare its step with that of the default gains"
        )
    if any(each.criterion <= (1.0 + _SAME) * found.criterion for each in others):
        return (
            f"{spread}, and others have the same J within {100 * _SAME:.0f} %, which hardly "
            "depends on the gains: compare steps on the arm, or tune on several payloads together"
        )
    return (
        f"{spread}; the best is written, and no other start confirms it. Compare its step with "
        "that of the default gains, or tune on several payloads together"
    )


def at_bounds(active: Sequence[str]) -> list[str]:
    """Return the bounds of gains among what is active."""
    return [each for each in active if each.startswith("bound of ")]


def stopped_by(active: Sequence[str]) -> str:
    """Return in words what stopped the search, with what to do at a bound."""
    text = f"active: {', '.join(active) or 'none'}"
    if at_bounds(active):
        text += (
            "; the best gain may lie beyond: see that all signals are in V, or weigh E and Y anew"
        )
    return text


def pi_stopped_by(found: PiTuning) -> str:
    """Return in words what stopped the search of the PI law, with what to do at a bound."""
    text = f"active: {', '.join(found.active) or 'none'}"
    if not found.active:
        return text
    if np.isclose(found.gains.ki, PI_BOUNDS[1][0]):
        return f"{text}; the step needs no integral: next to 0, ki leaves a proportional law"
    return f"{text}; the best gain may lie beyond: see that all signals are in V"


def no_position(model: str) -> str:
    """Return why a model is not a model to tune on."""
    return (
        f"{model}: the input does not move {OUTPUTS[POSITION]}: there is nothing to control; "
        "identify from a record in which the hub moves"
    )


def of_unreached(model: str, outputs: Sequence[str], gains: Collection[str]) -> str:
    """Return what a tuning is worth where the input does not reach some outputs.

    Parameters
    ----------
    model : str
        Name of the model.
    outputs : sequence of str
        Outputs that the input does not reach.
    gains : collection of str
        Names of the gains that were tuned.
    """
    idle = [gain for name, gain in _FED_BACK.items() if name in outputs and gain in gains]
    worth = f"; {' and '.join(idle)} act on nothing there: set them to 0" if idle else ""
    return (
        f"caution: the input does not reach {', '.join(outputs)} of {model}, channels that its rig "
        f"seems to lack: nothing here is known of them{worth}"
    )


def compensated(law: str) -> str:
    """Return how much friction a law makes up for where the models tell none."""
    return (
        f"{law}.compensation_v is {CompensationLevel().compensation_v:g} V, the friction of the "
        "thesis's arm: for another arm, set it to the level that identify finds, or to 0"
    )


def handed_over(law: str, level_v: float, model: str) -> str:
    """Return where the level of a law's compensation comes from."""
    return f"{law}.compensation_v is {level_v:.3g} V, the friction that identify found in {model}"


def explained(wanted: Requirements) -> tuple[str, ...]:
    """Return what E, Y and J are."""
    return (
        "E: time-weighted error of the position (4-4), Y: of both gauges (4-5), s^2, steps of 1 V",
        f"J: {wanted.error_weight:g} sum E + {wanted.strain_weight:g} sum Y (4-3), best smallest",
        f"least margins: {wanted.gain_margin_db:g} dB, {wanted.phase_margin_deg:g} deg each model",
    )


def searched(names: Sequence[str], bounds: Sequence[tuple[float, float]]) -> str:
    """Return between which bounds gains were searched."""
    ranges = zip(names, bounds, strict=True)
    return f"searched: {', '.join(f'{name} {low:g} to {high:g}' for name, (low, high) in ranges)}"
