"""Tuning job: models by name, file or bag in, gains as parameters out."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flexarm_control.design.tuning import tune_pdp, tune_pi
from flexarm_control.laws.registry import LAWS
from flexarm_control.models.nominal_models import nominal_model
from flexarm_core.errors import IdentificationError, SettingError
from flexarm_ident.models import files
from flexarm_ident.reading.read import read_bag_report
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import control

    from flexarm_control.design.margins import Margins
    from flexarm_control.laws.gains import PdpGains, PiGains

_NOMINAL = "nominal:"
_FLIPPED = ":flipped"
# Largest difference of gains of one minimum, V/V.
_SPREAD = 0.05


@dataclass(frozen=True)
class TuneRequest:
    """Request of a tuning.

    Attributes
    ----------
    law : str
        Key of `TUNINGS`; the gains are those of every law that names this tuning in its row.
    error_weight, strain_weight : float or None
        W_E and W_sg of (4-3); None takes those of `tune_pdp`. PI has none.
    gain_margin_db, phase_margin_deg : float or None
        Least margins on every model; None takes those of `tune_pdp`. PI has none.
    delay_s : float
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
    """Gains with their certificate.

    Attributes
    ----------
    parameters : mapping of str to float
        Gains by the parameter names of the controller node, such as ``pdpc.kp``.
    criteria : tuple of float
        J, then the sums of E and Y for PDP; J alone for PI.
    margins, error_itae, strain_itae : tuple
        One per model; empty for PI.
    notes : tuple of str
        Active constraints and the agreement of the starts, in words.
    """

    parameters: Mapping[str, float]
    criteria: tuple[float, ...]
    margins: tuple[Margins, ...] = ()
    error_itae: tuple[float, ...] = ()
    strain_itae: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


def load_models(names: Sequence[str]) -> dict[str, control.StateSpace]:
    """Load models from files, identify them from bags, or take nominal ones.

    Parameters
    ----------
    names : sequence of str
        Model files (YAML, JSON, MAT), bags (identified, reduced by MRM and updated by B),
        ``nominal:0.2`` for the nominal model with 0.2 kg, ``nominal:0.2:flipped`` for it with the
        sign of y3 inverted.

    Returns
    -------
    dict of str to control.StateSpace
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
        if not Path(name).exists():
            raise SettingError(
                f"{name}: no such file: name a file from identify, a bag, or nominal:KG"
            )
        try:
            if Path(name).is_dir():
                models[name] = _identified(Path(name))
                continue
            found = files.load_models(name)
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
    if request.law not in TUNINGS:
        raise SettingError(f"law {request.law!r} is not tunable; choose {' or '.join(TUNINGS)}")
    return TUNINGS[request.law](models, request)


def _tune_pi(models: Mapping[str, control.StateSpace], request: TuneRequest) -> TuneResult:
    if len(models) != 1:
        raise SettingError(f"pi is tuned on one model, got {len(models)}")
    unused = request.constraints()
    if unused:
        raise SettingError(f"pi is tuned without {', '.join(unused)}: leave that out or take pdp")
    found = tune_pi(next(iter(models.values())), delay_s=request.delay_s)
    return TuneResult(_parameters("pi", found.gains), (found.criterion,))


def _tune_pdp(models: Mapping[str, control.StateSpace], request: TuneRequest) -> TuneResult:
    found = tune_pdp(list(models.values()), delay_s=request.delay_s, **request.constraints())
    feasible = sum(search.feasible for search in found.searches)
    word = "agree" if found.gain_spread <= _SPREAD else "do NOT agree"
    starts = (
        f"{feasible} of {len(found.searches)} starts met the constraints and {word}; "
        f"gains differ by at most {found.gain_spread:.3g}"
    )
    return TuneResult(
        _parameters("pdp", found.gains),
        (found.criterion, sum(found.error_itae), sum(found.strain_itae)),
        found.margins,
        found.error_itae,
        found.strain_itae,
        (f"active: {', '.join(found.active) or 'none'}", starts),
    )


def _parameters(tuning: str, gains: PdpGains | PiGains) -> dict[str, float]:
    """Return the gains as parameters of every law that the tuning is for."""
    return {
        f"{row.name}.{name}": float(gain)
        for row in LAWS.values()
        if row.tuning == tuning
        for name, gain in asdict(gains).items()
    }


#: Every tuning by the name that the rows of the laws have for it.
TUNINGS: Mapping[str, Callable[[Mapping[str, control.StateSpace], TuneRequest], TuneResult]] = (
    MappingProxyType({"pdp": _tune_pdp, "pi": _tune_pi})
)


def _identified(bag: Path) -> control.StateSpace:
    return run(read_bag_report(bag).data, Request(reduction="mrm", update="b")).model


def _payload_kg(name: str) -> float:
    try:
        return float(name.removeprefix(_NOMINAL))
    except ValueError as error:
        raise SettingError(f"{name}: write the payload in kg, such as nominal:0.2") from error
