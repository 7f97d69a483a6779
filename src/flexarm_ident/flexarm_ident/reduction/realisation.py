"""Real reduced model by the thesis's method (3-10), for comparison with the direct one.

The triplet (3-9) of the kept modes is complex. The thesis simulates its output, which is real, and
identifies that with ORSE. `modal.truncate` gives a real block-diagonal form directly. Both are
realisations of the same triplet, so they differ by rounding only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.output_fit import fit_inputs
from flexarm_ident.fitting.validation import frequency_response, relative_errors
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

_FREQUENCIES = 200
# Lowest frequency of the comparison, as a part of the Nyquist frequency.
_LOWEST = 1e-3


@dataclass(frozen=True)
class RealisationDifference:
    """Differences between two models of the same channels.

    Attributes
    ----------
    frequency_response : float
        Largest difference of the gains over frequencies, relative to the largest gain of the same
        output; the largest over all outputs.
    simulation : float
        RMS difference of the simulated outputs, relative to the output's RMS; the largest over all
        outputs and records.
    """

    frequency_response: float
    simulation: float


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


def realisation_difference(
    one: control.StateSpace, other: control.StateSpace, data: IoData | Sequence[IoData]
) -> RealisationDifference:
    """Compare two models of the same channels and period, relative to the first.

    They are compared by frequency response (2-4) and by simulation from rest under the records'
    inputs.
    """
    nyquist_hz = 0.5 / one.dt
    frequencies_hz = np.geomspace(_LOWEST * nyquist_hz, nyquist_hz, _FREQUENCIES)
    first, second = (frequency_response(model, frequencies_hz) for model in (one, other))
    largest = np.abs(first).max(axis=(0, 2))
    apart = np.abs(first - second).max(axis=(0, 2))
    simulated = [
        relative_errors(simulate(one, record.u), simulate(other, record.u)).max()
        for record in as_records(data)
    ]
    return RealisationDifference(float(np.max(apart / largest)), float(np.max(simulated)))
