"""Models of the arm: their signals, a loop delay, their frequency response."""

from __future__ import annotations

from math import floor
from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray

#: The measured signals, in the order of the thesis (y1 to y4).
OUTPUTS = ("position_v", "base_strain_v", "middle_strain_v", "speed_v")
POSITION, BASE_STRAIN, MIDDLE_STRAIN, SPEED = range(4)


_ROUNDING = 1e-9
_FROM_HZ = 0.1
_LOOKED_AT = 200


def check_arm_model(model: control.StateSpace) -> None:
    """Refuse a model that is not a sampled model of the arm with one input and four outputs.

    Raises
    ------
    SettingError
        When the model is not discrete-time, has another number of signals, or has the four known
        outputs in another order.
    """
    if not model.dt or model.dt is True:
        raise SettingError(f"the model has dt = {model.dt}; set its sampling period in s")
    check_arm_signals(model.input_labels, model.output_labels)


def check_arm_signals(
    inputs: Sequence[str], outputs: Sequence[str], whose: str = "the model"
) -> None:
    """Refuse signals that no law takes, of a model or of a record for one.

    Raises
    ------
    SettingError
        When there is another number of signals, or the four known outputs are in another order.
    """
    if (len(inputs), len(outputs)) != (1, len(OUTPUTS)):
        raise SettingError(
            f"{whose}'s inputs: {len(inputs)}, outputs: {len(outputs)}; every law takes one "
            f"input and the outputs {', '.join(OUTPUTS)}: for a law of your own, "
            "flexarm_ident.load_model gives a control.StateSpace; see 'Other signals' in "
            "docs/howto/own_rig.md"
        )
    if any(label in OUTPUTS and label != OUTPUTS[i] for i, label in enumerate(outputs)):
        raise SettingError(
            f"{whose}'s outputs are {', '.join(outputs)}; reorder them to {', '.join(OUTPUTS)}"
        )


def check_no_feedthrough(model: control.StateSpace) -> None:
    """Refuse a model with D, since a sample cannot depend on the command that answers it.

    Raises
    ------
    SettingError
        When D is not zero.
    """
    if np.any(model.D):
        raise SettingError(
            "the model's D is not zero, but a sample cannot depend on the command that answers "
            "it; state a loop delay greater than zero or identify the model without D"
        )


def delayed(model: control.StateSpace, delay_s: float) -> control.StateSpace:
    """Return the model whose input acts a time after the sample that it answers.

    The delay is exact for the held input, also for fractions of a sample. The fraction 1 - d of the
    transition matrix of state and held input, [[A, B], [0, 1]]^(1-d), has the part of B that the
    new command gets in the period. The command before it gets the rest.

    Parameters
    ----------
    model : control.StateSpace
        Discrete-time model of a continuous plant, without a delay of its own.
    delay_s : float
        Delay, s, at least zero.

    Returns
    -------
    control.StateSpace
        Model with one more state per started sample of delay, and the same names and dt.

    Raises
    ------
    SettingError
        When the delay is negative or not finite.
    """
    if not 0.0 <= delay_s < np.inf:
        raise SettingError(f"delay_s = {delay_s:g}; a loop delay is finite and not negative")
    samples = delay_s / model.dt
    whole = floor(samples + _ROUNDING)
    fraction = max(0.0, samples - whole)
    A, B, C, D = (np.asarray(matrix) for matrix in (model.A, model.B, model.C, model.D))
    if fraction > _ROUNDING:
        new = _input_over_fraction(A, B, 1.0 - fraction)
        A, B, C, D = _append_held_input(A, B - new, C, D, new)
    for _ in range(whole):
        A, B, C, D = _append_held_input(A, B, C, D, np.zeros_like(B))
    # The identification is loaded only to make a model; a running controller makes none.
    from flexarm_ident.models.state_space import with_matrices  # noqa: PLC0415

    return with_matrices(model, A=A, B=B, C=C, D=D)


def _input_over_fraction(A: FloatArray, B: FloatArray, fraction: float) -> FloatArray:
    order, inputs = B.shape
    transition = np.block([[A, B], [np.zeros((inputs, order)), np.eye(inputs)]])
    # A negative real pole has two complex fractional powers; the real part is their mean.
    part: FloatArray = np.real(scipy.linalg.fractional_matrix_power(transition, fraction))
    return part[:order, order:]


def _append_held_input(
    A: FloatArray, held: FloatArray, C: FloatArray, D: FloatArray, new: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    order, inputs = held.shape
    return (
        np.block([[A, held], [np.zeros((inputs, order + inputs))]]),
        np.vstack([new, np.eye(inputs)]),
        np.hstack([C, D]),
        np.zeros_like(D),
    )


def unreached_outputs(model: control.StateSpace) -> tuple[str, ...]:
    """Return the outputs of a model of the arm that its input does not move, rounding apart.

    Such an output is a channel that the rig does not have: its record is constant.
    """
    # The identification is loaded only to look at a model.
    from flexarm_ident.fitting.validation import frequency_response  # noqa: PLC0415

    frequency_hz = np.geomspace(_FROM_HZ, 0.5 / model.dt, _LOOKED_AT)
    largest = np.abs(frequency_response(model, frequency_hz)[..., 0]).max(axis=0)
    rests = largest <= _ROUNDING * largest.max()
    return tuple(name for name, is_so in zip(OUTPUTS, rests, strict=True) if is_so)
