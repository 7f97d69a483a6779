"""Loop of a regulator, and its effort weight, searched on identified models with margins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeVar

import numpy as np

from flexarm_control.design.criteria import step_itae
from flexarm_control.design.margins import (
    Loop,
    LoopResponse,
    Requirements,
    check_delay,
    margin_frequencies_hz,
)
from flexarm_control.design.tuning import constant_input_response
from flexarm_control.laws.gains import PdpGains
from flexarm_control.laws.ilqr import RegulatorWeights
from flexarm_control.laws.registry import LAWS
from flexarm_control.laws.regulator_loop import (
    closed_loop,
    controller_model,
    pole_radius,
    stabilising_design,
)
from flexarm_control.models.arm_model import (
    OUTPUTS,
    check_arm_model,
    check_no_feedthrough,
    delayed,
)
from flexarm_control.models.nominal_models import identified_model
from flexarm_control.models.rigid_and_bending import design_model
from flexarm_core.errors import SettingError
from flexarm_core.specs import select
from flexarm_ident.fitting.validation import frequency_response

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import control

    from flexarm_control.design.margins import Margins
    from flexarm_control.laws.ilqr import IlqrDesign
    from flexarm_core.arrays import FloatArray

_WeightsT = TypeVar("_WeightsT", bound=RegulatorWeights)

#: Effort weights of the search, all of which are tried.
EFFORTS = tuple(np.geomspace(0.05, 100.0, 23).tolist())
_PDP = "pdp"


@dataclass(frozen=True)
class RegulatorTuning(Generic[_WeightsT]):
    """Tuned weights of a regulator, with their certificate.

    Attributes
    ----------
    weights : RegulatorWeights
        Weights; only that of the effort was searched.
    modes_hz : tuple of float
        Bending modes of the model of the design, Hz.
    criterion : float
        J of (4-3).
    error_itae, strain_itae : tuple of float
        E of (4-4) and Y of (4-5), s^2, one per model.
    margins : tuple of Margins
        Margins on every model, the loop opened at the effort.
    active : tuple of str
        Active constraints, in words.
    """

    weights: _WeightsT
    modes_hz: tuple[float, ...]
    criterion: float
    error_itae: tuple[float, ...]
    strain_itae: tuple[float, ...]
    margins: tuple[Margins, ...]
    active: tuple[str, ...]


class _Trial(NamedTuple):
    weights: RegulatorWeights
    margins: tuple[Margins, ...]
    parts: FloatArray


def tune_regulator(
    models: Sequence[control.StateSpace],
    design: Callable[[control.StateSpace, _WeightsT], IlqrDesign],
    weights: _WeightsT,
    wanted: Requirements,
    *,
    delay_s: float = 0.0,
) -> RegulatorTuning[_WeightsT]:
    """Choose the effort weight of a regulator by (4-3) to (4-5) among those that keep the margins.

    The design is made on rigid motion and bending modes of the first model. Margins and step
    responses are those with every whole model. All weights of `EFFORTS` are tried, so the result
    depends on no starting point.

    Parameters
    ----------
    models : sequence of control.StateSpace
        Models of the arm; the design is made on the first.
    design : callable
        `design_ilqr` or `design_lqg`.
    weights : RegulatorWeights
        The other weights.
    wanted : Requirements
        Criterion and least margins.
    delay_s : float
        Loop delay of simulations and margins, s, 0 to 0.05.

    Raises
    ------
    SettingError
        When a model or value cannot be used or no weight meets the constraints.
    """
    check_delay(delay_s)
    if not models:
        raise SettingError("tuning needs at least one model")
    reduced = design_model(models[0])
    loops = [RegulatorLoop(model, delay_s=delay_s) for model in models]
    trials = []
    for effort in EFFORTS:
        tried = replace(weights, effort=effort)
        made = design(reduced.model, tried)
        margins = tuple(loop.margins(made) for loop in loops)
        trials.append(_Trial(tried, margins, _all_parts(made, loops, wanted.duration_s)))
    feasible = [trial for trial in trials if np.all(wanted.excess(trial.margins) >= 0.0)]
    if not feasible:
        raise SettingError(_none_found(trials, wanted))
    best = min(feasible, key=lambda trial: wanted.criterion(trial.parts))
    errors, strains = best.parts.T
    return RegulatorTuning(
        weights=replace(weights, effort=best.weights.effort),
        modes_hz=reduced.modes_hz,
        criterion=wanted.criterion(best.parts),
        error_itae=tuple(errors.tolist()),
        strain_itae=tuple(strains.tolist()),
        margins=best.margins,
        active=tuple(wanted.active(best.margins)),
    )


def _all_parts(design: IlqrDesign, loops: Sequence[RegulatorLoop], duration_s: float) -> FloatArray:
    return np.array([_parts(design, loop, duration_s) for loop in loops])


def _parts(design: IlqrDesign, loop: RegulatorLoop, duration_s: float) -> tuple[float, float]:
    """Return E and Y of the response to a step of 1 V, not finite for some unstable loops."""
    closed = closed_loop(design, loop.model)
    dt_s = float(closed.dt)
    with np.errstate(over="ignore", invalid="ignore"):
        y = constant_input_response(closed.A, closed.B, closed.C, round(duration_s / dt_s))
        return step_itae(y, dt_s=dt_s)


def _none_found(trials: Sequence[_Trial], wanted: Requirements) -> str:
    """Return in one line how near the trials came."""
    nearest = max(trials, key=lambda trial: float(np.min(wanted.excess(trial.margins))))
    gain_db = min(each.gain_margin_db for each in nearest.margins)
    phase_deg = min(each.phase_margin_deg for each in nearest.margins)
    return (
        f"no effort weight from {EFFORTS[0]:g} to {EFFORTS[-1]:g} keeps {wanted.gain_margin_db:g} "
        f"dB and {wanted.phase_margin_deg:g} deg on every model; the nearest, "
        f"{nearest.weights.effort:.3g}, has {gain_db:.1f} dB and {phase_deg:.0f} deg: ask for "
        "less, reduce the delay, or identify a better model"
    )


class RegulatorLoop:
    """Loop of one model, for evaluation with many designs; parameters as for `margins`."""

    def __init__(self, model: control.StateSpace, *, delay_s: float = 0.0) -> None:
        check_arm_model(model)
        self.model = delayed(model, delay_s)
        check_no_feedthrough(self.model)
        self._frequency_hz = margin_frequencies_hz(model)
        self._response = frequency_response(self.model, self._frequency_hz)[..., 0]

    def loop(self, design: IlqrDesign) -> Loop:
        """Return the loop, opened at the effort.

        All that the controller does comes together in the effort. A factor there changes every
        loop of the controller at once.
        """
        law = controller_model(design)
        gains = frequency_response(law, self._frequency_hz)[:, 0, : len(OUTPUTS)]
        return Loop(
            self._frequency_hz,
            -np.sum(gains * self._response, axis=1),
            np.ones(len(self._frequency_hz), dtype=complex),
            stable=pole_radius(closed_loop(design, self.model)) < 1.0,
        )

    def margins(self, design: IlqrDesign) -> Margins:
        """Return gain, phase and disk margins of the loop."""
        return self.loop(design).margins()


def law_loop(
    law: str,
    model: control.StateSpace,
    values: Mapping[str, Any] | None = None,
    *,
    delay_s: float = 0.0,
) -> Loop | None:
    """Return the loop of a law on a model, or None for a law without one loop of its own.

    A regulator as packaged has the packaged model; one that changes with the payload has no loop.

    Parameters
    ----------
    law : str
        Key of `LAWS`.
    model : control.StateSpace
        Model of the arm.
    values : mapping, optional
        Parameters of a regulator that is designed on this model, or of a PDP law. None: those of
        the packaged law.
    delay_s : float
        Loop delay, s.

    Raises
    ------
    SettingError
        When the model is not one of the arm, the delay is negative or there is no stabilising
        design.
    """
    row = LAWS[law]
    weights: Any = select(row.settings[0], values or {})
    if row.design is not None and values is not None:
        design = stabilising_design(row.design, model, weights)
    elif row.design is not None and row.packaged is None:
        design = row.design(identified_model(), weights)
    elif row.tuning == _PDP and isinstance(weights, PdpGains):
        return LoopResponse(model, delay_s=delay_s).loop(weights)
    else:
        return None
    return RegulatorLoop(model, delay_s=delay_s).loop(design)
