"""Servo of any linear model: Kalman filter with disturbances, regulator, planned set-points.

The filter estimates the state x, a constant force d at each input, and a bias b of each output that
is not tracked, as far as the outputs tell them apart:

    x[k+1] = A x[k] + B (u[k] + d[k]),   y[k] = C x[k] + b[k]

A planned set-point w moves a model of the plant by the command v = N w - L p, where p is the
model's state, the planned one. The plant gets u = v - K (x - p) - d. So the plan is followed by a
loop of its own, faster than the one that noise and errors of the model allow. With as many
disturbances as outputs the tracked ones come to rest on their set-points whatever the gains of the
plant (Pannocchia and Rawlings, "Disturbance models for offset-free model-predictive control", AIChE
Journal 49 (2003)). The filter hears the command that was applied, so a limit winds nothing up.

All weights follow from one frequency, the bandwidth. There the regulator crosses over, and the
filter at a multiple of it, one of `FILTERS`; the model says how far each output moves. Nothing
depends on units.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.models.arm_model import delayed
from flexarm_control.servo.generalised_plant import GeneralisedPlant, hinf_gains, lqg_gains
from flexarm_core.errors import SettingError, nearest
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.models.control_library import control_library
from flexarm_ident.models.state_space import state_space

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import ComplexArray, FloatArray

_BIAS_RATIO = 0.1
_OTHERS = 0.1
_OCTAVE = np.geomspace(0.5, 2.0, 9)
# The input in force at a sample is the one before: a direct path needs no more delay than that.
_AT_ONCE = 1e-6
# Sine of the angle between what two disturbances do to the outputs, below which they are one.
_APART = 0.1
_HIDDEN = 1e-9
# Gain at rest over that at the bandwidth, below which it is zero.
_UNREACHED = 1e-6
_FLOOR = 1e-24
_SLOW = 0.01
# Bandwidth of the planned motion over that of the loop, which noise and errors do not reach.
_AHEAD = 5.0


class Filter(NamedTuple):
    """A filter of the servo.

    Attributes
    ----------
    ratio : float
        Its frequency over that of the regulator. The larger it is, the nearer is the loop to a full
        state feedback, and the more of the noise of the outputs comes to the inputs.
    rolls_off : bool
        Whether it leaves modes beyond its frequency to the model. Else it follows them too, which
        damps them where the model knows their frequencies well.
    hinf : bool
        Whether filter and regulator are those of H-infinity; else they are those of LQG.
    """

    ratio: float
    rolls_off: bool
    hinf: bool = False


FILTERS = tuple(
    Filter(ratio, rolls_off) for ratio in (3.0, 10.0, 1.0) for rolls_off in (False, True)
)
"""Filters that are tried. None is the best for every arm; among equal ones the first is taken."""
LAWS = {
    "servo": FILTERS,
    "hinf": tuple(each._replace(hinf=True) for each in FILTERS),
}
"""Filters of each law by its name."""


@dataclass(frozen=True, eq=False)
class Regulator:
    """Gains of a servo for one model.

    Attributes
    ----------
    plant : control.StateSpace
        Model with the delay of the loop, without feedthrough.
    A, B, C : ndarray
        Model with disturbances, (states, states), (states, inputs), (outputs, states).
    feedback : ndarray, (inputs, states)
        Gain on the estimated state with disturbances.
    correction : ndarray, (states, outputs)
        Gain of the filter at a sample.
    deviation : ndarray, (states, states)
        Transition of what the estimated state differs from the planned one: A, or that with the
        worst disturbance.
    planning : ndarray, (inputs, states)
        Gain L on the planned state.
    forward : ndarray, (3, inputs, tracked)
        Gains N on the planned set-points and on their first and second differences.
    tracked : tuple of int
        Outputs that follow set-points.
    bandwidth_hz : float
        Bandwidth.
    """

    plant: control.StateSpace
    A: FloatArray
    B: FloatArray
    C: FloatArray
    feedback: FloatArray
    correction: FloatArray
    deviation: FloatArray
    planning: FloatArray
    forward: FloatArray
    tracked: tuple[int, ...]
    bandwidth_hz: float

    @property
    def controller(self) -> control.StateSpace:
        """The linear controller from the outputs to the inputs, predicted state inside."""
        corrected = np.eye(len(self.A)) - self.correction @ self.C
        moves = self.deviation - self.B @ self.feedback
        return state_space(
            moves @ corrected,
            moves @ self.correction,
            -self.feedback @ corrected,
            -self.feedback @ self.correction,
            float(self.plant.dt),
        )

    @property
    def following(self) -> control.StateSpace:
        """Planned set-points with their differences to the inputs, when the model is true."""
        gain = self.planning[:, : self.plant.nstates]
        forward = np.hstack(list(self.forward))
        A = self.plant.A - self.plant.B @ gain
        return state_space(A, self.plant.B @ forward, -gain, forward, float(self.plant.dt))

    @property
    def rest(self) -> FloatArray:
        """State of the plant at rest for unit tracked outputs, (states, tracked)."""
        A = self.following.A
        at_rest = np.linalg.solve(np.eye(len(A)) - A, self.plant.B @ self.forward[0])
        return np.asarray(at_rest)


def tracked_outputs(
    inputs: Sequence[str], outputs: Sequence[str], names: Sequence[str]
) -> tuple[int, ...]:
    """Return the places of the outputs to be tracked.

    Raises
    ------
    SettingError
        When there is no such output, or fewer inputs than are to be tracked.
    """
    listed = ", ".join(outputs)
    for name in names:
        if name not in outputs:
            raise SettingError(
                f"--track {name}: there is no such output{nearest(name, outputs)}; "
                f"the outputs: {listed}"
            )
    places = tuple(dict.fromkeys(outputs.index(name) for name in names))
    if not places:
        raise SettingError(f"--track is missing: name one of the outputs {listed}")
    if len(places) > len(inputs):
        raise SettingError(
            f"--track names {len(places)} outputs, beside {len(inputs)} "
            f"input{'s' * (len(inputs) != 1)} ({', '.join(inputs)}): track as many "
            "outputs as there are inputs at most"
        )
    return places


def loop_plant(model: control.StateSpace, delay_s: float = 0.0) -> control.StateSpace:
    """Return the model as a sampled loop has it: delayed, without feedthrough.

    Raises
    ------
    SettingError
        When the model has no sampling period or an unstable mode that its signals do not show.
    """
    if not model.dt or model.dt is True:
        raise SettingError(f"the model has dt = {model.dt}: set its sampling period in s")
    direct = bool(np.any(model.D))
    plant = delayed(model, max(delay_s, _AT_ONCE * model.dt if direct else 0.0))
    for pole in np.linalg.eigvals(plant.A):
        if abs(pole) >= 1.0:
            _require_visible(plant, complex(pole))
    return plant


def design_regulator(
    plant: control.StateSpace,
    tracked: Sequence[int],
    bandwidth_hz: float,
    *,
    limits: FloatArray | None = None,
    through: Filter = FILTERS[0],
) -> Regulator:
    """Design a servo for a bandwidth.

    Parameters
    ----------
    plant : control.StateSpace
        Model of `loop_plant`.
    tracked : sequence of int
        Outputs that follow set-points, as many as inputs at most.
    bandwidth_hz : float
        Frequency at which the regulator crosses over, Hz.
    limits : ndarray, (inputs,), optional
        Largest inputs, by which several inputs are weighed against each other.
    through : Filter
        The filter.

    Raises
    ------
    SettingError
        When no input reaches a tracked output at rest, or no design stabilises the model.
    """
    # An output that nothing moves has no weight either.
    moves = np.abs(frequency_response(plant, [bandwidth_hz])[0][list(tracked)])
    _require_reach(plant, tracked, moves, bandwidth_hz)
    scale = np.ones(plant.ninputs) if limits is None else np.asarray(limits, dtype=np.float64)
    scale = np.where(np.isfinite(scale), scale, 1.0)
    weighed = _generalised(plant, tracked, bandwidth_hz, scale, through)
    try:
        gains = hinf_gains(weighed) if through.hinf else lqg_gains(weighed)
        ahead = _planning(plant, tracked, bandwidth_hz, scale)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise SettingError(_no_design(bandwidth_hz)) from error
    found = Regulator(
        plant,
        *(weighed.A, weighed.B, weighed.C),
        *gains,
        np.hstack([ahead, np.zeros_like(weighed.rejection)]),
        _forward(plant, tracked, ahead, scale, bandwidth_hz),
        tuple(tracked),
        float(bandwidth_hz),
    )
    # Written so that NaN is refused too.
    if not loop_radius(found, plant) < 1.0:
        raise SettingError(_no_design(bandwidth_hz))
    return found


def loop_radius(found: Regulator, plant: control.StateSpace) -> float:
    """Return the largest magnitude of a pole of the loop of a servo and any plant."""
    law = found.controller
    closed = np.block(
        [
            [plant.A + plant.B @ law.D @ plant.C, plant.B @ law.C],
            [law.B @ plant.C, law.A],
        ]
    )
    return float(np.max(np.abs(np.linalg.eigvals(closed))))


def _planning(
    plant: control.StateSpace, tracked: Sequence[int], bandwidth_hz: float, scale: FloatArray
) -> FloatArray:
    """Return the gain on the planned state."""
    cost = _cost(plant, tracked, _AHEAD * bandwidth_hz, scale)
    gain, *_ = control_library().dlqr(plant.A, plant.B, cost, np.diag(scale**-2.0))
    return np.asarray(gain)


def _cost(
    plant: control.StateSpace, tracked: Sequence[int], at_hz: float, scale: FloatArray
) -> FloatArray:
    """Return the cost of the state by which the tracked outputs cross over at a frequency."""
    return _even(plant.C.T @ _output_weight(plant, tracked, at_hz, scale) @ plant.C)


def _forward(
    plant: control.StateSpace,
    tracked: Sequence[int],
    gain: FloatArray,
    scale: FloatArray,
    bandwidth_hz: float,
) -> FloatArray:
    """Return the gains on a planned set-point and its differences, (3, inputs, tracked).

    At low frequencies the tracked outputs answer the set-points by I + H1 d + H2 d^2 + ..., where d
    is the difference to the next sample. The first three terms of the inverse make them follow a
    smooth plan without a lag, also where an exact inverse would not be stable. What creeps far more
    slowly than the bandwidth, and is left so by the regulator, stands still in a move.
    """
    closed = plant.A - plant.B @ gain
    moving = _without_creep(closed, 2.0 * np.pi * _SLOW * bandwidth_hz * float(plant.dt))
    away = np.eye(plant.nstates) - closed
    rows = plant.C[list(tracked)]
    terms, states = [], moving @ plant.B
    for sign in (1.0, -1.0, 1.0):
        states = moving @ np.linalg.solve(away, states)
        terms.append(sign * rows @ states)
    _require_reach(plant, tracked, terms[0], bandwidth_hz)
    still = np.linalg.pinv(terms[0] * scale) * scale[:, None]
    first, second = terms[1] @ still, terms[2] @ still
    return np.stack([still, -still @ first, still @ (first @ first - second)])


def _without_creep(A: FloatArray, slowest: float) -> FloatArray:
    """Return the projector, (states, states), on the modes of a transition that are not too slow.

    `slowest` is the distance of an eigenvalue from 1, as small as radians a sample.
    """
    values, right = np.linalg.eig(A)
    kept = np.where(np.abs(values - 1.0) < slowest, 0.0, 1.0)
    if kept.all():
        return np.eye(len(A))
    return np.asarray(np.real(right * kept @ np.linalg.inv(right)))


def _below(plant: control.StateSpace, corner_hz: float) -> FloatArray:
    """Return a map, (states, states), that takes each mode by a low-pass of second order.

    The logarithm of the transition is Tustin's, which allows delays. Its sign is that of an
    unstable plant, so that damped modes become smaller too.
    """
    one = np.eye(plant.nstates)
    speeds = np.linalg.solve((plant.A + one).T, (plant.A - one).T).T
    speeds /= np.pi * corner_hz * plant.dt
    return np.asarray(np.linalg.inv(one - np.sqrt(2.0) * speeds + speeds @ speeds))


def _even(matrix: FloatArray) -> FloatArray:
    """Return a symmetric matrix without its rounding, which python-control refuses."""
    return np.asarray(0.5 * (matrix + matrix.T))


def _no_design(bandwidth_hz: float) -> str:
    return (
        f"no stabilising design at {bandwidth_hz:g} Hz: the model has a mode on or outside the "
        "unit circle that its inputs do not move or its outputs do not show; leave out what "
        "cannot be controlled, or measure more"
    )


def _require_visible(plant: control.StateSpace, pole: complex) -> None:
    """Refuse an unstable mode that no input moves or no output shows (Popov, Belevitch, Hautus)."""
    away = plant.A - pole * np.eye(plant.nstates)
    size = np.linalg.norm(plant.A)
    for other, axis, what in (
        (plant.B / np.linalg.norm(plant.B), 1, "no input moves it"),
        (plant.C / np.linalg.norm(plant.C), 0, "no output shows it"),
    ):
        seen = np.linalg.svd(np.concatenate([away / size, other], axis=axis), compute_uv=False)
        if seen[-1] < _HIDDEN:
            raise SettingError(
                f"the model has a pole of {abs(pole):.6g} that a zero cancels ({what}): no "
                "controller holds it; identify the plant again with an input or an output there"
            )


def _require_reach(
    plant: control.StateSpace, tracked: Sequence[int], reach: FloatArray, at_hz: float
) -> None:
    """Refuse tracked outputs that the inputs do not hold, each and together.

    `reach` is what the inputs of the loop do to the tracked outputs at rest, (tracked, inputs).
    """
    moves = frequency_response(plant, [at_hz])[0][list(tracked)]
    for row, output in enumerate(tracked):
        if not np.linalg.norm(reach[row]) > _UNREACHED * np.linalg.norm(moves[row]):
            raise SettingError(
                f"--track {plant.output_labels[output]}: no input holds it away from zero at rest "
                "(its gain there is zero): track an output that rests where it is put, such as an "
                "angle"
            )
    sizes = np.linalg.svd(reach / np.linalg.norm(reach, axis=1)[:, None], compute_uv=False)
    if sizes[-1] < _UNREACHED:
        names = ", ".join(plant.output_labels[output] for output in tracked)
        raise SettingError(
            f"--track {names}: the inputs move them together only: track one of them"
        )


def _sizes(plant: control.StateSpace, at_hz: float, scale: FloatArray) -> FloatArray:
    """Return how far each output moves around a frequency, (outputs,)."""
    response = frequency_response(plant, at_hz * _OCTAVE) * scale
    power = np.sum(np.abs(response) ** 2, axis=2)
    largest = power.max() or 1.0
    return np.asarray(np.exp(0.5 * np.mean(np.log(np.maximum(power, _FLOOR * largest)), axis=0)))


def _output_weight(
    plant: control.StateSpace, tracked: Sequence[int], at_hz: float, scale: FloatArray
) -> FloatArray:
    """Return the weight of the outputs, (outputs, outputs): the tracked ones cross over there.

    A mean of logarithms over an octave to each side keeps a single resonance from deciding it.
    """
    response = (frequency_response(plant, at_hz * _OCTAVE) * scale)[:, list(tracked)]
    squares = np.real(response @ response.conj().swapaxes(1, 2))
    values, vectors = np.linalg.eigh(squares)
    logs = np.log(np.maximum(values, _FLOOR * values.max()))
    mean = np.mean(np.einsum("fij,fj,fkj->fik", vectors, logs, vectors), axis=0)
    values, vectors = np.linalg.eigh(-mean)
    weight = np.diag(_OTHERS / _sizes(plant, at_hz, scale) ** 2)
    weight[np.ix_(list(tracked), list(tracked))] = vectors * np.exp(values) @ vectors.T
    return weight


def _generalised(
    plant: control.StateSpace,
    tracked: Sequence[int],
    bandwidth_hz: float,
    scale: FloatArray,
    through: Filter,
) -> GeneralisedPlant:
    """Return a plant with disturbances that its outputs tell apart, and all weights."""
    dt_s = float(plant.dt)
    filter_hz = min(through.ratio * bandwidth_hz, 0.25 / dt_s)
    sizes = _sizes(plant, filter_hz, scale)
    seen = _below(plant, filter_hz) if through.rolls_off else np.eye(plant.nstates)
    driven = seen @ plant.B * scale
    slow: ComplexArray = frequency_response(plant, [_SLOW * bandwidth_hz])[0]
    corner = 2.0 * np.pi * bandwidth_hz * dt_s
    others = [j for j in range(plant.noutputs) if j not in set(tracked)]
    chosen: list[ComplexArray] = []
    forces: list[FloatArray] = []
    biases: list[int] = []
    for force in np.diag(scale):
        if _is_apart(chosen, slow @ force / sizes):
            chosen.append(slow @ force / sizes)
            forces.append(force)
    for output in others:
        effect = np.eye(plant.noutputs)[output].astype(complex)
        if _is_apart(chosen, effect):
            chosen.append(effect)
            biases.append(output)
    order, count, shifts = plant.nstates, len(forces), len(biases)
    rejection = np.zeros((plant.ninputs, count + shifts))
    rejection[:, :count] = np.array(forces).reshape(count, plant.ninputs).T
    A = np.eye(order + count + shifts)
    A[:order, :order] = plant.A
    A[:order, order:] = plant.B @ rejection
    B = np.vstack([plant.B, np.zeros((count + shifts, plant.ninputs))])
    C = np.hstack([plant.C, np.zeros((plant.noutputs, count)), np.eye(plant.noutputs)[:, biases]])
    noise = np.zeros_like(A)
    noise[:order, :order] = _even(driven @ driven.T)
    noise[order:, order:] = np.diag(
        [corner**2] * count + [(_BIAS_RATIO * corner * sizes[j]) ** 2 for j in biases]
    )
    cost, effort = _cost(plant, tracked, bandwidth_hz, scale), np.diag(scale**-2.0)
    return GeneralisedPlant(A, B, C, noise, sizes, rejection, cost, effort)


def _is_apart(chosen: Sequence[ComplexArray], effect: ComplexArray) -> bool:
    """Return whether outputs tell a disturbance from those chosen before."""
    size = np.linalg.norm(effect)
    if not size:
        return False
    if not chosen:
        return True
    basis = np.linalg.qr(np.array(chosen).T)[0]
    unit = effect / size
    left = unit - basis @ (basis.conj().T @ unit)
    return bool(np.linalg.norm(left) > _APART)
