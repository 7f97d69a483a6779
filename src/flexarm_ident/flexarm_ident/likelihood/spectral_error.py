"""Errors of a free simulation in the frequency domain, over the parameters in real modal form.

The lines of a spectrum are independent of each other, and a filter that whitens the errors is a
weight there (Whittle's likelihood). The spectra are gathered into bands, so that a step costs
nearly the same for a short and for a long record, see `bands`.

Whittle, "Estimation and information in stationary time series", Arkiv for Matematik 2 (1953).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import Normal
from flexarm_ident.fitting.modal_parameters import ModalParameters, PoleForm
from flexarm_ident.fitting.output_fit import fit_initial_states
from flexarm_ident.likelihood.bands import spectral_bands, whole_length
from flexarm_ident.models.free_run import simulate_states

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import control

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.likelihood.bands import Bands
    from flexarm_ident.records.iodata import IoData


class SpectralError(ModalParameters):
    """Cost and normal equations over modal parameters: A, B, C and what the ends of records add.

    Parameters
    ----------
    model : control.StateSpace
        Discrete start, with a basis of eigenvectors and no eigenvalue outside the unit circle.
    records : sequence of IoData
        Records without holes.
    filters : sequence of ndarray, (taps,)
        Filter of each output's errors.
    bands : sequence of Bands, optional
        Spectra of the records, if they are known.
    """

    def __init__(
        self,
        model: control.StateSpace,
        records: Sequence[IoData],
        filters: Sequence[FloatArray],
        bands: Sequence[Bands] | None = None,
    ) -> None:
        super().__init__(model)
        self._records, self._filters = records, filters
        poles = np.linalg.eigvals(model.A).astype(complex)
        self.bands = bands or [spectral_bands(record, poles) for record in records]
        self._weights = [
            np.stack([np.abs(np.polyval(taps, np.exp(1j * each.centres))) for taps in filters], 1)
            for each in self.bands
        ]
        self._rest = sum(
            float(np.sum(weight**2 * each.rest))
            for weight, each in zip(self._weights, self.bands, strict=True)
        )

    def start(self, x0: Sequence[FloatArray]) -> FloatArray:
        """Return the parameters of the start, with initial states of the records."""
        ends = []
        for record, first in zip(self._records, x0, strict=True):
            # One sample more than the transform: where the next period would start.
            u = np.vstack([record.u[: whole_length(record)], np.zeros((1, self.r))])
            last = simulate_states(self._start.A, self._start.B, u, first)[-1]
            ends.append(np.asarray(first - last))
        return self.pack(ends)

    def unpack(self, theta: FloatArray) -> tuple[control.StateSpace, tuple[FloatArray, ...]]:
        """Return the model, and initial states that are fitted to the records."""
        model = self.model(theta)
        return model, fit_initial_states(model, self._records)

    def simpler(
        self, theta: FloatArray, group: tuple[int, ...]
    ) -> tuple[SpectralError, FloatArray]:
        """Return the problem without one mode, and the parameters that are left."""
        model, ends = self.without(theta, group)
        problem = SpectralError(model, self._records, self._filters, self.bands)
        return problem, problem.pack(ends)

    def powers(self, theta: FloatArray) -> FloatArray:
        """Return the sum of squares that each mode alone gives behind the filters, (modes,)."""
        powers = np.zeros(len(self.groups))
        form = PoleForm(self, theta)
        for states, _, weight, _ in self._responses(form, slopes=False):
            for mode, group in enumerate(map(list, self.groups)):
                alone = states[:, group] @ form.gamma[:, group].T
                powers[mode] += float(np.sum(np.abs(weight * alone) ** 2))
        return powers

    def cost(self, theta: FloatArray) -> float:
        """Return the sum of squares."""
        form, total = PoleForm(self, theta), self._rest
        for number, (states, _, weight, direct) in enumerate(self._responses(form, slopes=False)):
            e = states @ form.gamma.T + direct - self.bands[number].y
            total += float(np.sum(np.abs(weight * e) ** 2))
        return total

    def normal(self, theta: FloatArray) -> Normal:
        """Return cost, gradient and the product of the Jacobian with itself."""
        form = PoleForm(self, theta)
        cost, gradient = self._rest, np.zeros(len(theta))
        matrix = np.zeros((len(theta), len(theta)))
        for number, (states, shares, weight, direct) in enumerate(
            self._responses(form, slopes=True)
        ):
            e = states @ form.gamma.T + direct - self.bands[number].y
            steeper = np.einsum("sjp,jp->sp", shares[..., self.n :], self._beta(form, number))
            by_C = form.of_output_kind(states * form.half)
            for output, gamma in enumerate(form.gamma):
                by_A = form.of_output_kind(steeper * gamma)
                driven = form.of_input_kind(shares[..., : self.n] * gamma)
                by_B = driven[:, :-1].transpose(0, 2, 1).reshape(len(e), -1)
                block = np.column_stack([by_A, by_B, driven[:, -1], by_C, e[:, output]])
                block *= weight[:, [output]]
                real = np.vstack([block.real, block.imag])
                product = real.T @ real
                place = self.columns(output, number)
                cost += float(product[-1, -1])
                gradient[place] += product[:-1, -1]
                matrix[np.ix_(place, place)] += product[:-1, :-1]
        return Normal(cost, gradient, matrix)

    def _beta(self, form: PoleForm, record: int) -> ComplexArray:
        """Return the factors of the inputs, and of the end vector of one record."""
        return form.beta[[*range(self.r), self.r + record]]

    def _responses(
        self, form: PoleForm, *, slopes: bool
    ) -> Iterator[tuple[ComplexArray, ComplexArray, FloatArray, ComplexArray]]:
        """Yield states, (rows, poles), shares of each input in them, weights, and the part of D.

        With `slopes` the derivatives of the shares by the poles follow them.
        """
        for number, (bands, weight) in enumerate(zip(self.bands, self._weights, strict=True)):
            near = 1.0 / (bands.nodes[..., np.newaxis] - form.poles)
            response = np.concatenate([near, near**2], axis=-1) if slopes else near
            shares = np.matmul(bands.drive, response[bands.band])
            states = np.einsum("sjp,jp->sp", shares[..., : self.n], self._beta(form, number))
            direct = bands.drive[:, :-1].sum(axis=-1) @ self._start.D.T
            yield states, shares, weight[bands.band], direct
