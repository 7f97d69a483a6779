"""Gains that minimise an ITAE criterion: PDP over payloads (4-3), PI on one model (4-1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from flexarm_control.design.criteria import itae, step_itae
from flexarm_control.design.margins import (
    LoopResponse,
    Margins,
    Requirements,
    check_delay,
    check_duration,
)
from flexarm_control.laws.gains import PdpGains, PiGains
from flexarm_control.models.arm_model import (
    POSITION,
    check_arm_model,
    check_no_feedthrough,
    delayed,
)
from flexarm_core.errors import SettingError
from flexarm_core.showing.tables import html_table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from flexarm_core.arrays import FloatArray

#: Bounds of the search of Table 4-2: Kp, Kd, Ksg.
PDP_BOUNDS = ((0.005, 1.0), (0.05, 15.0), (0.005, 2.0))
#: Starting points of Table 4-2; the second is its result.
PDP_STARTS = (PdpGains(0.3, 1.0, 0.1), PdpGains(0.594, 4.266, 0.254), PdpGains(0.8, 4.0, 0.5))
#: Bounds of the search of Table 4-1: Kp, Ki.
PI_BOUNDS = ((0.005, 2.0), (5e-6, 0.2))
#: Further starting points, for models on which the first ones do not agree.
PDP_MORE_STARTS = (
    PdpGains(0.2, 2.0, 0.05),
    PdpGains(0.4, 8.0, 0.3),
    PdpGains(0.5, 2.0, 1.5),
    PdpGains(0.7, 3.0, 0.7),
    PdpGains(0.95, 6.0, 1.0),
)
#: Starting points for the PI law; the first is that of Table 4-1.
PI_STARTS = (PiGains(0.3, 0.01), PiGains(1.0, 0.1))
_GainsT = TypeVar("_GainsT", PdpGains, PiGains)

# Large enough to repel the search from an unstable loop, small enough for its arithmetic.
_WORST = 1e3
_MET_WITHIN = 0.01
# Kernels of linear algebra round differently, and a gradient over a tiny step makes another way of
# that: so steps are wide, and values have the digits that all kernels share.
_STEP = 1e-3
_SHARED_DECIMALS = 10


@dataclass(frozen=True)
class PdpTuning:
    """Tuned gains of the PDP law, with their certificate.

    Attributes
    ----------
    gains : PdpGains
        Gains.
    criterion : float
        J of (4-3).
    error_itae, strain_itae : tuple of float
        E of (4-4) and Y of (4-5), s^2, one per model.
    margins : tuple of Margins
        Margins, one per model.
    active : tuple of str
        Active constraints and bounds, in words.
    searches : tuple of Search
        Results of the starting points.
    gain_spread : float
        Largest difference of a gain between the feasible searches and the result, V/V. A large one
        means several local minima.
    """

    gains: PdpGains
    criterion: float
    error_itae: tuple[float, ...]
    strain_itae: tuple[float, ...]
    margins: tuple[Margins, ...]
    active: tuple[str, ...]
    searches: tuple[Search[PdpGains], ...]
    gain_spread: float

    def _repr_html_(self) -> str:
        gains = ", ".join(f"{name} {value:.4g}" for name, value in vars(self.gains).items())
        header = ("model", "gain margin, dB", "phase margin, deg", "disk margin", "error ITAE, s²")
        rows = [
            (
                str(number),
                f"{each.gain_margin_db:.1f}",
                f"{each.phase_margin_deg:.0f}",
                f"{each.disk_margin:.2f}",
                f"{itae:.4g}",
            )
            for number, (each, itae) in enumerate(
                zip(self.margins, self.error_itae, strict=True), start=1
            )
        ]
        return html_table(f"{gains}; J {self.criterion:.4g}", header, rows)


@dataclass(frozen=True)
class PiTuning:
    """Tuned gains of the PI law.

    Attributes
    ----------
    gains : PiGains
        Gains.
    criterion : float
        J of (4-1) for a step of 1 V, V s^2.
    active : tuple of str
        Active bounds, in words.
    searches : tuple of Search
        Results of the starting points.
    """

    gains: PiGains
    criterion: float
    active: tuple[str, ...]
    searches: tuple[Search[PiGains], ...]


def tune_pdp(
    models: Sequence[control.StateSpace],
    *,
    error_weight: float = 0.5,
    strain_weight: float = 0.5,
    gain_margin_db: float = 10.0,
    phase_margin_deg: float = 55.0,
    delay_s: float = 0.0,
    duration_s: float = 5.0,
    starts: Sequence[PdpGains] = PDP_STARTS,
    bounds: tuple[tuple[float, float], ...] = PDP_BOUNDS,
) -> PdpTuning:
    """Tune the PDP law over several models with constraints on their margins, (4-3) to (4-5).

    Parameters
    ----------
    models : sequence of control.StateSpace
        Models of the arm, one per payload.
    error_weight, strain_weight : float
        W_E and W_sg of (4-3), not both zero.
    gain_margin_db, phase_margin_deg : float
        Least margins on every model, above 0 and at most 60 dB and below 180 deg.
    delay_s : float
        Loop delay of simulations and margins, s, 0 to 0.05.
    duration_s : float
        Length of the simulated step responses, s.
    starts : sequence of PdpGains
        Starting points of the search.
    bounds : tuple of tuple of float
        Lower and upper bound of Kp, Kd and Ksg.

    Returns
    -------
    PdpTuning
        Gains of the best feasible search, and their certificate.

    Raises
    ------
    SettingError
        When a model or value cannot be used or no search meets the constraints.
    """
    wanted = Requirements(error_weight, strain_weight, gain_margin_db, phase_margin_deg, duration_s)
    check_delay(delay_s)
    if not models or not starts:
        raise SettingError("tuning needs at least one model and one starting point")
    loops = [LoopResponse(model, delay_s=delay_s) for model in models]
    for loop in loops:
        check_no_feedthrough(loop.model)

    def parts(gains: PdpGains) -> FloatArray:
        return np.array([_error_and_strain(loop.model, gains, duration_s) for loop in loops])

    def criterion(values: FloatArray) -> float:
        return wanted.criterion(parts(PdpGains(*values)))

    def excess(values: FloatArray) -> FloatArray:
        return wanted.excess([loop.margins(PdpGains(*values)) for loop in loops])

    searches = tuple(search(PdpGains, criterion, start, bounds, excess) for start in starts)
    feasible = [found for found in searches if found.feasible]
    if not feasible:
        shorter = f"reduce the delay of {delay_s:g} s, " if delay_s > 0.0 else ""
        raise SettingError(
            f"no gains found with {gain_margin_db:g} dB and {phase_margin_deg:g} deg on every "
            f"model: ask for less, {shorter}or give other starts in Python"
        )
    best = min(feasible, key=lambda found: found.criterion)
    margins = tuple(loop.margins(best.gains) for loop in loops)
    errors, strains = parts(best.gains).T
    return PdpTuning(
        gains=best.gains,
        criterion=best.criterion,
        error_itae=tuple(errors.tolist()),
        strain_itae=tuple(strains.tolist()),
        margins=margins,
        active=(*wanted.active(margins), *_at_bounds(best.gains, bounds)),
        searches=searches,
        gain_spread=max(
            float(np.max(np.abs(gain_values(found.gains) - gain_values(best.gains))))
            for found in feasible
        ),
    )


def tune_pi(
    model: control.StateSpace,
    *,
    delay_s: float = 0.0,
    duration_s: float = 5.0,
    starts: Sequence[PiGains] = PI_STARTS,
) -> PiTuning:
    """Tune the PI law that evaluates a model (4-1).

    Parameters
    ----------
    model : control.StateSpace
        Model of the arm.
    delay_s, duration_s : float
        Loop delay, 0 to 0.05, and length of the simulated step response, s.
    starts : sequence of PiGains
        Starting points of the search.

    Returns
    -------
    PiTuning
        Gains of the best search.

    Raises
    ------
    SettingError
        When the model or the delay cannot be used or there is no starting point.
    """
    check_delay(delay_s)
    check_duration(duration_s)
    if not starts:
        raise SettingError("tuning needs at least one starting point")
    check_arm_model(model)
    late = delayed(model, delay_s)
    check_no_feedthrough(late)
    samples = _samples(model, duration_s)

    def criterion(values: FloatArray) -> float:
        position_v = pi_step_response(late, PiGains(*values), samples)[:, POSITION]
        return itae(1.0 - position_v, dt_s=model.dt)

    searches = tuple(
        search(PiGains, criterion, start, PI_BOUNDS, unconstrained) for start in starts
    )
    best = min(searches, key=lambda found: found.criterion)
    return PiTuning(best.gains, best.criterion, _at_bounds(best.gains, PI_BOUNDS), searches)


def _error_and_strain(
    model: control.StateSpace, gains: PdpGains, duration_s: float
) -> tuple[float, float]:
    samples = _samples(model, duration_s)
    return step_itae(pdp_step_response(model, gains, samples), dt_s=float(model.dt))


def _samples(model: control.StateSpace, duration_s: float) -> int:
    return round(duration_s / float(model.dt))


def _at_bounds(
    gains: PdpGains | PiGains, bounds: tuple[tuple[float, float], ...]
) -> tuple[str, ...]:
    return tuple(
        f"bound of {name}"
        for (name, value), ends in zip(vars(gains).items(), bounds, strict=True)
        if np.isclose(value, ends).any()
    )


def pdp_step_response(model: control.StateSpace, gains: PdpGains, samples: int) -> FloatArray:
    """Simulate the PDP loop (4-7) after a step of the reference from 0 to 1 V.

    Parameters
    ----------
    model : control.StateSpace
        Model of the arm with D = 0.
    gains : PdpGains
        Gains of the PDP law.
    samples : int
        Number of samples, the first at the step.

    Returns
    -------
    ndarray, (samples, 4)
        Position, base strain, middle strain and speed, V.
    """
    feedback = np.array([[gains.kp, 0.0, gains.ksg, gains.kd]])
    closed = model.A - model.B @ feedback @ model.C
    return constant_input_response(closed, gains.kp * model.B, model.C, samples)


def pi_step_response(model: control.StateSpace, gains: PiGains, samples: int) -> FloatArray:
    """Simulate the PI loop of Figure 4-1 after a step of the reference from 0 to 1 V.

    The effort is kp e(k) + ki dt (e(0) + ... + e(k)); arguments and result are as for
    `pdp_step_response`.
    """
    position = model.C[[POSITION]]
    integral_gain = gains.ki * model.dt
    error_gain = gains.kp + integral_gain
    # The extra state is the sum of the errors before this sample.
    closed = np.block(
        [[model.A - error_gain * model.B @ position, integral_gain * model.B], [-position, 1.0]]
    )
    outputs = np.hstack([model.C, np.zeros((len(model.C), 1))])
    return constant_input_response(
        closed, np.vstack([error_gain * model.B, [[1.0]]]), outputs, samples
    )


def constant_input_response(
    A: FloatArray, b: FloatArray, C: FloatArray, samples: int
) -> FloatArray:
    """Return the response from rest to a constant input of 1, (samples, outputs).

    A is (states, states), b (states, 1) and C (outputs, states). Each pass doubles the length, and
    python-control's `forced_response` takes 40 times as long for the 1050 samples of a criterion.
    """
    order = len(A)
    power = np.block([[A, b], [np.zeros((1, order)), 1.0]])
    states = np.zeros((order + 1, 1))
    states[-1] = 1.0
    while states.shape[1] < samples:
        states = np.hstack([states, power @ states])
        power = power @ power
    response: FloatArray = (C @ states[:-1, :samples]).T
    return response


@dataclass(frozen=True)
class Search(Generic[_GainsT]):
    """Result of the search from one starting point.

    Attributes
    ----------
    start, gains : PdpGains or PiGains
        Starting point and end of the search.
    criterion : float
        Value of the criterion at the end.
    feasible : bool
        True if the end meets every constraint.
    """

    start: _GainsT
    gains: _GainsT
    criterion: float
    feasible: bool


def search(
    kind: type[_GainsT],
    criterion: Callable[[FloatArray], float],
    start: _GainsT,
    bounds: tuple[tuple[float, float], ...],
    excess: Callable[[FloatArray], FloatArray],
) -> Search[_GainsT]:
    """Minimise a criterion over gains by sequential quadratic programming.

    Parameters
    ----------
    kind : type of PdpGains or PiGains
        Class of the gains.
    criterion : callable
        Value of the criterion for an array of gains.
    start : PdpGains or PiGains
        Starting point.
    bounds : tuple of tuple of float
        Lower and upper bound of every gain.
    excess : callable
        Margin of every constraint for an array of gains, at least zero where it is met.

    Returns
    -------
    Search
        End of the search, feasible or not.
    """
    # This import takes half a second, and a running controller never searches.
    from scipy.optimize import NonlinearConstraint, minimize  # noqa: PLC0415

    lower, upper = np.transpose(bounds)

    def bounded_criterion(values: FloatArray) -> float:
        # The response of an unstable loop may overflow; it then has the worst value.
        with np.errstate(over="ignore", invalid="ignore"):
            value = criterion(np.clip(values, lower, upper))
        value = min(value, _WORST) if np.isfinite(value) else _WORST
        return float(np.round(value, _SHARED_DECIMALS))

    def bounded_excess(values: FloatArray) -> FloatArray:
        return np.round(excess(np.clip(values, lower, upper)), _SHARED_DECIMALS)

    # Both clip their argument: the optimiser oversteps its bounds by rounding errors.
    result = minimize(
        bounded_criterion,
        np.clip(gain_values(start), lower, upper),
        method="SLSQP",
        jac="3-point",
        bounds=bounds,
        constraints=NonlinearConstraint(bounded_excess, 0.0, np.inf),
        options={"ftol": 1e-6, "maxiter": 200, "finite_diff_rel_step": _STEP},
    )
    found = np.clip(result.x, lower, upper)
    value = bounded_criterion(found)
    return Search(
        start=start,
        gains=kind(*found.tolist()),
        criterion=value,
        feasible=value < _WORST and bool(np.all(bounded_excess(found) >= -_MET_WITHIN)),
    )


def unconstrained(values: FloatArray) -> FloatArray:
    """Return the excess for a search without constraints."""
    return np.zeros_like(values)


def gain_values(gains: PdpGains | PiGains) -> FloatArray:
    """Return the gains as an array, in the order of the fields."""
    return np.array(list(vars(gains).values()))
