"""Fit of B, D and the initial states for a state matrix that has to be stable first.

Where an unstable eigenvalue belongs is a question to the data: a free hub is an integrator, growth
of a weakly damped mode is an error of the estimate. So is whether a slow decay is one. The
simulation errors therefore choose among the ways of moving eigenvalues.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.fitting.output_fit import fit_each
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.models.state_space import moved, spectrum

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.fitting.output_fit import OutputFit
    from flexarm_ident.models.state_space import Spectrum, Way
    from flexarm_ident.records.source import Source

# Far below the distance of an integrator from 0.9999.
_SAME = 1e-12


class StableFit(NamedTuple):
    """Stable state matrix with its fit, how many eigenvalues were unstable, and the way they went.

    `way` is None where none was moved.
    """

    A: FloatArray
    fit: OutputFit
    unstable: int
    way: Way | None


def fit_stable(
    A: FloatArray,
    C: FloatArray,
    records: Sequence[Source],
    ways: Sequence[Way],
    *,
    feedthrough: bool,
    noise_weighted: bool,
    at_rest: bool = False,
) -> StableFit:
    """Move the eigenvalues in the way that simulates best, and fit the inputs.

    Parameters
    ----------
    A : ndarray, (states, states)
        State matrix as estimated.
    C : ndarray, (outputs, states)
        Output matrix.
    records : sequence of Source
        Records of one rig.
    ways : sequence of Way
        Ways to weigh. Without one A stays as it is.
    feedthrough : bool
        Whether D is fitted.
    noise_weighted : bool
        Whether the outputs are weighted by their noise, see `fit_inputs`.
    at_rest : bool
        Whether the records start from rest.

    Raises
    ------
    IdentificationError
        If A stays so unstable that its response overflows.
    """
    tried = _distinct(A, ways)
    fits = fit_each(
        *([each for each, _ in tried], C, records),
        feedthrough=feedthrough,
        noise_weighted=noise_weighted,
        at_rest=at_rest,
    )
    found = [
        StableFit(each.A, fit, each.unstable, way)
        for (each, way), fit in zip(tried, fits, strict=True)
    ]
    return min(found, key=lambda each: _comparable(mean_error(each.fit.error)))


def _distinct(A: FloatArray, ways: Sequence[Way]) -> list[tuple[Spectrum, Way | None]]:
    """Return the matrices that differ with their ways, `A` itself among them when it is stable."""
    start = spectrum(A)
    found: list[tuple[Spectrum, Way | None]] = []
    for way in ways:
        stable = moved(start, way)
        if not any(np.allclose(stable.A, each.A, rtol=0.0, atol=_SAME) for each, _ in found):
            found.append((stable, None if stable is start else way))
    return found or [(start, None)]


def _comparable(error: float) -> float:
    return error if np.isfinite(error) else np.inf
