"""Errors of a free simulation sample by sample, for the likelihood of records with holes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.fitting.modal_error import ModalError
from flexarm_ident.likelihood.noise_filter import whitening_filters
from flexarm_ident.models.free_run import BlockSimulation, simulate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray


class SampledError(ModalError):
    """Cost and normal equations with what the likelihood asks beside, see `ModalError`."""

    def start(self, x0: Sequence[FloatArray]) -> FloatArray:
        """Return the parameters of the start, with initial states of the records."""
        return self.pack(x0)

    def settle(self, theta: FloatArray) -> None:
        """Make the filters suit the errors of some parameters."""
        model, starts = self.unpack(theta)
        with np.errstate(over="ignore", invalid="ignore"):
            errors = [
                np.asarray(record.y_usable - simulate(model, record.u, start))
                for record, start in zip(self._records, starts, strict=True)
            ]
        self.filters = whitening_filters(errors)

    def simpler(self, theta: FloatArray, group: tuple[int, ...]) -> tuple[SampledError, FloatArray]:
        """Return the problem without one mode, and the parameters that are left."""
        model, starts = self.without(theta, group)
        problem = SampledError(model, self._records, self._filters)
        return problem, problem.pack(starts)

    def powers(self, theta: FloatArray) -> FloatArray:
        """Return the sum of squares that each mode alone gives behind the filters, (modes,)."""
        A, B, C, starts = self.split(theta)
        powers = np.zeros(len(self.groups))
        direct = np.zeros((self.m, self.r))
        for mode, group in enumerate(map(list, self.groups)):
            own = (A[np.ix_(group, group)], B[group], C[:, group], direct)
            for record, start, known in zip(self._records, starts, self._known, strict=True):
                y = BlockSimulation(*own, start[group]).advance(record.u)
                for alone, taps, rows in zip(y.T, self._filters, known, strict=True):
                    passed = scipy.signal.lfilter(taps, [1.0], alone)
                    powers[mode] += float(np.sum(passed[rows] ** 2))
        return powers
