"""Discrete state-space models with named channels.

python-control loads matplotlib's pyplot, which takes longer than everything else here together. So
it is imported when the first model is made.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control
    from numpy.typing import ArrayLike


def state_space(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    dt_s: float,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    name: str | None = None,
) -> control.StateSpace:
    """Return a discrete model.

    Parameters
    ----------
    A : array_like, (states, states)
        State matrix.
    B : array_like, (states, inputs)
        Input matrix.
    C : array_like, (outputs, states)
        Output matrix.
    D : array_like, (outputs, inputs)
        Feedthrough matrix; 0.0 is a zero matrix.
    dt_s : float
        Sampling period, in seconds.
    inputs, outputs : sequence of str, optional
        Names of the channels.
    name : str, optional
        Name of the model.

    Returns
    -------
    control.StateSpace
        The model.
    """
    import control  # noqa: PLC0415

    names = {"inputs": inputs and list(inputs), "outputs": outputs and list(outputs), "name": name}
    return control.StateSpace(A, B, C, D, dt_s, **names)


def with_matrices(
    model: control.StateSpace,
    *,
    A: ArrayLike | None = None,
    B: ArrayLike | None = None,
    C: ArrayLike | None = None,
    D: ArrayLike | None = None,
) -> control.StateSpace:
    """Return a model with the period and the channels of another one.

    Parameters
    ----------
    model : control.StateSpace
        Where period, channel names and the matrices that are not given come from.
    A, B, C, D : array_like, optional
        Matrices of the new model.

    Returns
    -------
    control.StateSpace
        The new model.
    """
    return state_space(
        model.A if A is None else A,
        model.B if B is None else B,
        model.C if C is None else C,
        model.D if D is None else D,
        model.dt,
        inputs=model.input_labels,
        outputs=model.output_labels,
    )
