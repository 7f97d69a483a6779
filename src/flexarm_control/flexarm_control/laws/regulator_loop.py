"""Linear loop of a state feedback with observer, and designs that are checked in it.

A design is made on rigid motion and bending modes. Whether it stabilises the arm shows on the model
that was identified, with all of its states.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np

from flexarm_control.models.arm_model import OUTPUTS, POSITION
from flexarm_control.models.rigid_and_bending import design_model
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Callable

    import control

    from flexarm_control.laws.ilqr import IlqrDesign, RegulatorWeights

    _WeightsT = TypeVar("_WeightsT", bound=RegulatorWeights)


def stabilising_design(
    design: Callable[[control.StateSpace, _WeightsT], IlqrDesign],
    model: control.StateSpace,
    weights: _WeightsT,
) -> IlqrDesign:
    """Design on rigid motion and bending modes of a model, and check it on the whole model.

    Parameters
    ----------
    design : callable
        `design_ilqr` or `design_lqg`.
    model : control.StateSpace
        Identified model of the arm.
    weights : RegulatorWeights
        Weights of the design.

    Raises
    ------
    SettingError
        When the model cannot be used or the loop with it is not stable.
    """
    found = design(design_model(model).model, weights)
    largest = pole_radius(closed_loop(found, model))
    # Written so that NaN is refused too.
    if not largest < 1.0:
        raise SettingError(
            f"no stabilising design: the loop with the model has a pole of {largest:.4f}; weigh "
            "the effort more, make the observer slower, or identify the model again"
        )
    return found


def controller_model(design: IlqrDesign) -> control.StateSpace:
    """Return the controller of Figure 4-13 as a model.

    Returns
    -------
    control.StateSpace
        Model from the four outputs and the reference to the effort; its last state is the sum of
        the errors, which a design with K_I = 0 has not.
    """
    # The identification is loaded only to make a model.
    from flexarm_ident.models.state_space import state_space  # noqa: PLC0415

    A, B, C = (np.asarray(matrix) for matrix in (design.model.A, design.model.B, design.model.C))
    order, inputs = len(A), len(OUTPUTS) + 1
    corrects = np.zeros((order, inputs))
    corrects[:, list(design.channels)] = design.observer
    error = np.eye(1, inputs, len(OUTPUTS)) - np.eye(1, inputs, POSITION)
    effort = np.append(-design.kc, design.ki)[None]
    effort_now = design.kp * np.eye(1, inputs, len(OUTPUTS)) + design.ki * error
    # The observer moves with the effort that is sent.
    moves = np.hstack([A - corrects[:, : len(OUTPUTS)] @ C, np.zeros((order, 1))]) + B @ effort
    kept = order + bool(design.ki)
    return state_space(
        np.vstack([moves, np.eye(1, order + 1, order)])[:kept, :kept],
        np.vstack([corrects + B @ effort_now, error])[:kept],
        effort[:, :kept],
        effort_now,
        float(design.model.dt),
        inputs=(*OUTPUTS, "reference_v"),
        outputs=("effort_v",),
    )


def closed_loop(design: IlqrDesign, model: control.StateSpace) -> control.StateSpace:
    """Return the loop of a design and a model of any order, from the reference to the outputs."""
    from flexarm_ident.models.state_space import state_space  # noqa: PLC0415

    law = controller_model(design)
    measured, referred = law.B[:, : len(OUTPUTS)], law.B[:, len(OUTPUTS) :]
    now, referred_now = law.D[:, : len(OUTPUTS)], law.D[:, len(OUTPUTS) :]
    A, B, C = model.A, model.B, model.C
    return state_space(
        np.block([[A + B @ now @ C, B @ law.C], [measured @ C, law.A]]),
        np.vstack([B @ referred_now, referred]),
        np.hstack([C, np.zeros((len(OUTPUTS), law.nstates))]),
        0.0,
        float(model.dt),
        inputs=("reference_v",),
        outputs=OUTPUTS,
    )


def pole_radius(model: control.StateSpace) -> float:
    """Return the largest magnitude of the poles of a model."""
    return float(np.max(np.abs(np.linalg.eigvals(model.A))))
