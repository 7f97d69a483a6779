"""Baselines of modal reduction: balanced truncation, and the thesis's realisation (3-10).

Balanced truncation keeps states by their controllability and observability, not by mode. Only the
stable part has Gramians and is balanced; the rest is kept whole.
Moore, "Principal component analysis in linear systems", IEEE Transactions on Automatic Control 26
(1981); square-root form of Laub, Heath, Paige, Ward, same journal 32 (1987).

The triplet (3-9) of the kept modes is complex. The thesis simulates its output, which is real, and
identifies that with ORSE. `modal.truncate` gives a real block-diagonal form directly. Both are
realisations of the same triplet, so they differ by rounding only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_core.errors import IdentificationError
from flexarm_ident.fitting.output_fit import fit_inputs
from flexarm_ident.models.modes import modal_form
from flexarm_ident.models.state_space import simulate, with_matrices
from flexarm_ident.records.iodata import as_records
from flexarm_ident.records.preprocess import output_scale
from flexarm_ident.reduction.modal import truncate
from flexarm_ident.subspace import orse
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.inverse import factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

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


def thesis_realisation(
    model: control.StateSpace, data: IoData | Sequence[IoData], *, block_rows: int = 40
) -> control.StateSpace:
    """Identify a reduced model from its own simulated output with the thesis's ORSE (3-10).

    Parameters
    ----------
    model : control.StateSpace
        The kept modes in any real form, such as `reduction.truncate` gives; without feedthrough.
    data : IoData or sequence of IoData
        Records whose input drives the simulation, from rest.
    block_rows : int
        Block rows of the Hankel matrices, more than the model has states.

    Returns
    -------
    control.StateSpace
        Model of the same order and names.

    Raises
    ------
    DataError
        If a record is too short for the block rows.
    """
    simulated = [
        replace(record, y=simulate(model, record.u), compensation=None, reference=None)
        for record in as_records(data)
    ]
    space = orse.plain(block_gram(simulated, block_rows), output_scale(simulated))
    matrices = space.matrices(model.nstates)
    fit = fit_inputs(matrices.A, matrices.C, simulated)
    return with_matrices(model, A=matrices.A, B=fit.B, C=matrices.C, D=fit.D)
