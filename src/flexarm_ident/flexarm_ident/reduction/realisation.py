"""Real reduced model by the thesis's method (3-10), for comparison with the direct one.

The triplet (3-9) of the kept modes is complex. The thesis simulates its output, which is real, and
identifies that with ORSE. `modal.truncate` gives a real block-diagonal form directly. Both are
realisations of the same triplet, so they differ by rounding only.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flexarm_ident.fitting.output_fit import fit_inputs
from flexarm_ident.models.free_run import simulate
from flexarm_ident.models.state_space import with_matrices
from flexarm_ident.records.iodata import as_records
from flexarm_ident.records.preprocess import output_scale
from flexarm_ident.subspace import orse
from flexarm_ident.subspace.gram import block_gram

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_ident.records.iodata import IoData


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
