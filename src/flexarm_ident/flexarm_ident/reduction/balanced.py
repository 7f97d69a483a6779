"""Balanced truncation, the baseline of modal reduction.

States are kept by their controllability and observability, not by mode. Only the stable part has
Gramians and is balanced; the rest is kept whole.
Moore, "Principal component analysis in linear systems", IEEE Transactions on Automatic Control 26
(1981); square-root form of Laub, Heath, Paige, Ward, same journal 32 (1987).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_core.errors import IdentificationError
from flexarm_ident.models.modes import modal_form
from flexarm_ident.models.state_space import with_matrices
from flexarm_ident.reduction.modal import truncate
from flexarm_ident.subspace.inverse import factor

if TYPE_CHECKING:
    import control

    from flexarm_core.arrays import FloatArray

_REACHABLE = 1e-12


@dataclass(frozen=True, eq=False)
class BalancedTruncation:
    """Reduced model with its Hankel singular values.

    Attributes
    ----------
    model : control.StateSpace
        Reduced model with the names of the full one.
    hankel_singular_values : ndarray
        Of the stable part, falling.
    unstable : int
        Number of unstable states, which are kept.
    """

    model: control.StateSpace
    hankel_singular_values: FloatArray
    unstable: int


def balanced_truncation(
    model: control.StateSpace, order: int, output_scale: FloatArray | None = None
) -> BalancedTruncation:
    """Reduce a discrete model by balanced truncation of its stable part.

    python-control's `balanced_reduction` takes every model for one in continuous time, and needs
    the package slycot, which is not part of this environment.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    order : int
        States to keep.
    output_scale : ndarray, (outputs,), optional
        Factors that make the outputs comparable, such as those of `preprocess.output_scale`.

    Returns
    -------
    BalancedTruncation
        The reduced model. It has fewer states than `order` where the minimal stable part has fewer.

    Raises
    ------
    IdentificationError
        If `order` is below the number of unstable states, or above all.
    """
    eigenvalues = modal_form(model).eigenvalues
    stable = np.flatnonzero(np.abs(eigenvalues) < 1.0).tolist()
    unstable = sorted(set(range(model.nstates)) - set(stable))
    if not max(1, len(unstable)) <= order <= model.nstates:
        raise IdentificationError(
            f"order must lie between {max(1, len(unstable))} and the model's {model.nstates}, "
            f"{len(unstable)} of them unstable: {order}"
        )
    if not stable:
        return BalancedTruncation(model, np.empty(0), len(unstable))
    part = truncate(model, stable)
    scale = np.ones(model.noutputs) if output_scale is None else output_scale
    reach = factor(scipy.linalg.solve_discrete_lyapunov(part.A, part.B @ part.B.T))
    C = scale[:, np.newaxis] * part.C
    sight = factor(scipy.linalg.solve_discrete_lyapunov(part.A.T, C.T @ C))
    left, values, right = scipy.linalg.svd(sight.T @ reach)
    usable = int(np.sum(values > _REACHABLE * values[0]))
    size = min(order - len(unstable), usable)
    root = np.sqrt(values[:size])
    expand = reach @ right[:size].T / root
    project = (sight @ left[:, :size] / root).T
    kept = truncate(model, unstable)
    reduced = with_matrices(
        model,
        A=scipy.linalg.block_diag(project @ part.A @ expand, kept.A),
        B=np.vstack([project @ part.B, kept.B]),
        C=np.hstack([part.C @ expand, kept.C]),
    )
    return BalancedTruncation(reduced, values, len(unstable))
