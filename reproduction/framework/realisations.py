"""Realisations of a model: their difference, and their digits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.validation import frequency_response, relative_errors
from flexarm_ident.models.state_space import simulate, with_matrices
from flexarm_ident.records.iodata import as_records

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_ident import IoData

_FREQUENCIES = 200
# Lowest frequency of the comparison, as a part of the Nyquist frequency.
_LOWEST = 1e-3


# Decimals in which the same record gives the same matrices on every processor.
_COMMON_DECIMALS = 7


def rounded_model(model: control.StateSpace) -> control.StateSpace:
    """Return a model with its matrices in the decimals that do not depend on the processor."""
    matrices = {name: np.round(getattr(model, name), _COMMON_DECIMALS) for name in "ABC"}
    return with_matrices(model, **matrices)


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
