"""A tuning as somebody asks for it: models by name, file or bag in, gains as parameters out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_control.design.tuning import tune_pdp, tune_pi
from flexarm_control.models.nominal_models import nominal_model
from flexarm_core.errors import IdentificationError, SettingError
from flexarm_ident.models.ros_yaml import read_parameter_file
from flexarm_ident.reading.read import read_bag_report
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

    from flexarm_control.design.margins import Margins

TUNABLE = ("pdp", "pi")
_NOMINAL = "nominal:"
_FLIPPED = ":flipped"
_PDP_LAWS = ("pdp", "pdpc", "pdpc_unconditional", "pdpc_plus")
# Starts that agree to this have found one minimum; V/V.
_SPREAD = 0.05


@dataclass(frozen=True)
class TuneRequest:
    """What to tune.

    Attributes
    ----------
    law
        One of `TUNABLE`.
    error_weight, strain_weight
        W_E and W_sg of (4-3); None takes those of `tune_pdp`. PI has none.
    gain_margin_db, phase_margin_deg
        Least margins on every model; None takes those of `tune_pdp`. PI has none.
    delay_s
        Loop delay, s.
    """

    law: str = "pdp"
    error_weight: float | None = None
    strain_weight: float | None = None
    gain_margin_db: float | None = None
    phase_margin_deg: float | None = None
    delay_s: float = 0.0

    def constraints(self) -> dict[str, Any]:
        """Return the weights and margins that were given."""
        names = ("error_weight", "strain_weight", "gain_margin_db", "phase_margin_deg")
        return {name: value for name in names if (value := getattr(self, name)) is not None}


@dataclass(frozen=True)
class TuneResult:
    """Gains and what certifies them.

    Attributes
    ----------
    parameters
        Gains by the parameter names of the controller node, such as ``pdpc.kp``.
    criteria
        J, then the sums of E and Y for PDP; J alone for PI.
    margins, error_itae, strain_itae
        One per model; empty for PI.
    notes
        Active constraints and whether the starts agree, in words.
    """

    parameters: Mapping[str, float]
    criteria: tuple[float, ...]
    margins: tuple[Margins, ...] = ()
    error_itae: tuple[float, ...] = ()
    strain_itae: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


def load_models(names: Sequence[str]) -> dict[str, control.StateSpace]:
    """Load models from parameter files, identify them from bags, or take nominal ones.

    Parameters
    ----------
    names
        Parameter files, bags (identified, reduced by MRM and updated by B), ``nominal:0.2`` for
        the nominal model with 0.2 kg, ``nominal:0.2:flipped`` for it with the sign of y3 turned.

    Returns
    -------
    dict
        Models by name.

    Raises
    ------
    SettingError
        When a file, bag or payload has no model.
    """
    models: dict[str, control.StateSpace] = {}
    for name in names:
        if name.startswith(_NOMINAL):
            models[name] = nominal_model(
                _payload_kg(name.removesuffix(_FLIPPED)),
                flip_middle_strain=name.endswith(_FLIPPED),
            )
            continue
        try:
            if Path(name).is_dir():
                models[name] = _identified(Path(name))
                continue
            found = read_parameter_file(name)
        except IdentificationError as error:
            raise SettingError(str(error)) from error
        models.update({f"{name} {key}": model for key, model in found.items()})
    return models


def tune(models: Mapping[str, control.StateSpace], request: TuneRequest) -> TuneResult:
    """Tune one law, (4-1) or (4-3).

    Raises
    ------
    SettingError
        When the law cannot be tuned, or no gains meet the request.
    """
    if request.law not in TUNABLE:
        raise SettingError(f"law {request.law!r} is not tunable; choose {' or '.join(TUNABLE)}")
    return _tune_pi(models, request) if request.law == "pi" else _tune_pdp(models, request)


def _tune_pi(models: Mapping[str, control.StateSpace], request: TuneRequest) -> TuneResult:
    if len(models) != 1:
        raise SettingError(f"pi is tuned on one model, got {len(models)}")
    unused = request.constraints()
    if unused:
        raise SettingError(f"pi is tuned without {', '.join(unused)}: leave that out or take pdp")
    found = tune_pi(next(iter(models.values())), delay_s=request.delay_s)
    return TuneResult({"pi.kp": found.gains.kp, "pi.ki": found.gains.ki}, (found.criterion,))


def _tune_pdp(models: Mapping[str, control.StateSpace], request: TuneRequest) -> TuneResult:
    found = tune_pdp(
        list(models.values()),
        delay_s=request.delay_s,
        **request.constraints(),
    )
    gains = {"kp": found.gains.kp, "kd": found.gains.kd, "ksg": found.gains.ksg}
    feasible = sum(search.feasible for search in found.searches)
    word = "agree" if found.gain_spread <= _SPREAD else "do NOT agree"
    starts = (
        f"{feasible} of {len(found.searches)} starts met the constraints and {word}; "
        f"gains differ by at most {found.gain_spread:.3g}"
    )
    return TuneResult(
        {f"{law}.{name}": float(gain) for law in _PDP_LAWS for name, gain in gains.items()},
        (found.criterion, sum(found.error_itae), sum(found.strain_itae)),
        found.margins,
        found.error_itae,
        found.strain_itae,
        (
            f"active: {', '.join(found.active) or 'none'}",
            starts,
        ),
    )


def _identified(bag: Path) -> control.StateSpace:
    data = read_bag_report(bag).data
    return run(data, Request(reduction="mrm", update="b")).model


def _payload_kg(name: str) -> float:
    try:
        return float(name.removeprefix(_NOMINAL))
    except ValueError as error:
        raise SettingError(f"{name}: write the payload in kg, such as nominal:0.2") from error
