"""Model of a design: rigid motion and bending modes of an identified model.

A design from few signals needs a model of the arm alone. An identified one has more: states that
imitate friction, and a slowest pole that is near 1, not at 1. With it a regulator takes friction
for a spring that holds the hub. The hub turns freely: its position is the integral of a speed
that damping slows down. So the model of a design has a pole at 1, a real pole, and the bending
modes of the identified model. Its outputs are fitted to the response of that model.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.models.arm_model import (
    OUTPUTS,
    POSITION,
    check_arm_model,
    check_no_feedthrough,
)
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Callable

    import control

    from flexarm_core.arrays import ComplexArray, FloatArray

# Identified bending modes have up to 0.16; slow pairs that imitate friction have more.
_VIBRATES = 0.2
# A slower vibration is that of controller and friction; the arm has none so slow.
_SLOWEST_BENDING_HZ = 2.0
# Below, an identified response is that of friction; above, beyond the last mode, that of noise.
_FROM_HZ = 0.2
_BEYOND_LAST = 1.2
_FREQUENCIES = 400
_TIME_CONSTANTS_S = np.geomspace(0.02, 10.0, 15)
# State of the real pole.
_SPEED = 1
# Part of the position's response that a usable model leaves out at most.
_MOST_MISSED = 0.3


@dataclass(frozen=True, eq=False)
class DesignModel:
    """Reduced model of a design.

    Attributes
    ----------
    model : control.StateSpace
        Model of rigid motion and bending modes, D = 0, signals and period as given.
    modes_hz : tuple of float
        Natural frequencies of the bending modes, lowest first, Hz.
    time_constant_s : float
        Time in which the speed of the rigid motion decays to 37 %, s.
    missed : tuple of float
        Root mean square of the difference of the responses in units of that of the response, one
        per output.
    """

    model: control.StateSpace
    modes_hz: tuple[float, ...]
    time_constant_s: float
    missed: tuple[float, ...]


class _Fit(NamedTuple):
    C: FloatArray
    missed: FloatArray


def design_model(model: control.StateSpace) -> DesignModel:
    """Reduce an identified model to rigid motion and bending modes.

    The poles are 1, one real pole and those of the bending modes. Of each output the residues are
    fitted by least squares to the response of the given model, from 0.2 Hz to beyond the last
    mode on a logarithmic scale. The real pole is the one with the least sum of errors. Only the
    position has a part at the pole 1: the gauges and the speed come to rest.

    Parameters
    ----------
    model : control.StateSpace
        Identified model of the arm with D = 0.

    Returns
    -------
    DesignModel
        Reduced model.

    Raises
    ------
    SettingError
        When the model has other signals, a feedthrough, no bending mode, or a position that is
        not that of a hub which turns freely.
    """
    # The identification is loaded only to make a model.
    from flexarm_ident.fitting.validation import frequency_response  # noqa: PLC0415
    from flexarm_ident.models.state_space import state_space, with_matrices  # noqa: PLC0415

    check_arm_model(model)
    check_no_feedthrough(model)
    modes_hz, poles = bending_modes(model)
    most_hz = min(_BEYOND_LAST * modes_hz[-1], 0.5 / model.dt)
    frequency_hz = np.geomspace(_FROM_HZ, most_hz, _FREQUENCIES)
    response = frequency_response(model, frequency_hz)[..., 0]
    A, B = _blocks(poles)
    states = frequency_response(state_space(A, B, np.eye(len(A)), 0.0, model.dt), frequency_hz)[
        ..., 0
    ]
    z = np.exp(2j * np.pi * frequency_hz * model.dt)

    def fit(time_constant_s: float) -> _Fit:
        A[_SPEED, _SPEED] = np.exp(-model.dt / time_constant_s)
        states[:, _SPEED] = 1.0 / (z - A[_SPEED, _SPEED])
        return _outputs(states, response)

    time_constant_s = _best_time_constant_s(fit)
    C, missed = fit(time_constant_s)
    if missed[POSITION] > _MOST_MISSED:
        raise SettingError(
            f"{100 * missed[POSITION]:.3g} % of the model's {OUTPUTS[POSITION]} is not that of a "
            f"hub that turns freely and bends, at most {100 * _MOST_MISSED:.0f} % may be: identify "
            "the arm from a closed-loop experiment, such as C_dat3"
        )
    reduced = with_matrices(model, A=A, B=B, C=C, D=np.zeros((len(OUTPUTS), 1)))
    return DesignModel(reduced, modes_hz, time_constant_s, tuple(missed.tolist()))


def bending_modes(model: control.StateSpace) -> tuple[tuple[float, ...], list[complex]]:
    """Return the bending modes of an identified model, lowest first.

    Returns
    -------
    modes_hz : tuple of float
        Natural frequencies, Hz.
    poles : list of complex
        The poles with positive imaginary part.

    Raises
    ------
    SettingError
        When there is none.
    """
    from flexarm_ident.models.modes import frequency_and_damping  # noqa: PLC0415

    found = []
    for pole in np.linalg.eigvals(model.A).astype(complex).tolist():
        frequency_hz, damping_ratio = frequency_and_damping(pole, float(model.dt))
        is_upper = pole.imag > 0.0
        if is_upper and frequency_hz > _SLOWEST_BENDING_HZ and 0.0 < damping_ratio < _VIBRATES:
            found.append((frequency_hz, pole))
    if not found:
        raise SettingError(
            "the model has no bending mode (a pair of stable poles above "
            f"{_SLOWEST_BENDING_HZ:g} Hz, damping ratio below {_VIBRATES:g}): identify the arm "
            "with a higher order or more excitation"
        )
    found.sort(key=lambda mode: mode[0])
    return tuple(frequency_hz for frequency_hz, _ in found), [pole for _, pole in found]


def _best_time_constant_s(fit: Callable[[float], _Fit]) -> float:
    """Return the time constant with the least error: the best of a grid, refined."""
    from scipy.optimize import minimize_scalar  # noqa: PLC0415 - not for a running controller

    def error(logarithm: float) -> float:
        return float(np.sum(fit(np.exp(logarithm)).missed ** 2))

    grid = np.log(_TIME_CONSTANTS_S)
    best = int(np.argmin([error(each) for each in grid]))
    around = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    return float(np.exp(minimize_scalar(error, bounds=around, method="bounded").x))


def _outputs(states: ComplexArray, response: ComplexArray) -> _Fit:
    """Fit outputs of states to a response, both (frequencies, signals)."""
    # Real and imaginary parts are equations of their own, since C is real.
    left, right = (np.vstack([each.real, each.imag]) for each in (states, response))
    C = np.zeros((right.shape[1], left.shape[1]))
    for output, wanted in enumerate(right.T):
        # The gauges and the speed come to rest; the position stays.
        used = slice(0 if output == POSITION else _SPEED, None)
        C[output, used] = np.linalg.lstsq(left[:, used], wanted, rcond=None)[0]
    left_out, whole = (np.linalg.norm(each, axis=0) for each in (left @ C.T - right, right))
    # Nothing is missed of an output that the rig does not have.
    missed = np.divide(left_out, whole, out=np.zeros_like(whole), where=whole > 0.0)
    return _Fit(C, missed)


def _blocks(poles: list[complex]) -> tuple[FloatArray, FloatArray]:
    """Return A and B: an integrator, a real pole that is still 0, and a block for each pair."""
    order = 2 + 2 * len(poles)
    A, B = np.zeros((order, order)), np.zeros((order, 1))
    A[0, 0] = 1.0
    B[:2] = 1.0
    for at, pole in zip(range(2, order, 2), poles, strict=True):
        A[at : at + 2, at : at + 2] = [[pole.real, -pole.imag], [pole.imag, pole.real]]
        B[at] = 1.0
    return A, B
