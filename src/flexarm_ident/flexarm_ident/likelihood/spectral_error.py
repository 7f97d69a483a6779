"""Errors of a free simulation in the frequency domain, over the parameters in real modal form.

The lines of a spectrum are independent of each other, and a filter that whitens the errors is a
weight there (Whittle's likelihood). The spectra are gathered into bands, so that a step costs
nearly the same for a short and for a long record, see `bands`.

Whittle, "Estimation and information in stationary time series", Arkiv for Matematik 2 (1953).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.fitting.levenberg_marquardt import Normal
from flexarm_ident.fitting.modal_parameters import ModalParameters, PoleForm
from flexarm_ident.fitting.output_fit import fit_initial_states
from flexarm_ident.likelihood.bands import spectral_bands, whole_length
from flexarm_ident.likelihood.noise_filter import whitening_filters
from flexarm_ident.models.free_run import simulate_states

if TYPE_CHECKING:
    from collections.abc import Sequence

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
        self._records = records
        poles = np.linalg.eigvals(model.A).astype(complex)
        self._bands = bands or [spectral_bands(record, poles) for record in records]
        self.filters = filters

    @property
    def filters(self) -> Sequence[FloatArray]:
        """Filter of each output's errors."""
        return self._filters

    @filters.setter
    def filters(self, filters: Sequence[FloatArray]) -> None:
        self._filters = filters
        self._gains, self._rest = [], 0.0
        for bands in self._bands:
            z = np.exp(1j * bands.centres)
            gain = np.abs(np.stack([np.polyval(taps, z) for taps in filters], axis=1)) ** 2
            self._rest += float(np.sum(gain * bands.rest))
            self._gains.append(gain)

    def errors(self, theta: FloatArray) -> list[FloatArray]:
        """Return the errors of the outputs in each record, but for a few samples at its end."""
        form, errors = PoleForm(self, theta), []
        for number, record in enumerate(self._records):
            samples = whole_length(record)
            u = scipy.fft.rfft(record.u[:samples], axis=0)
            z = np.exp(2j * np.pi / samples * np.arange(len(u)))[:, np.newaxis]
            states = (np.column_stack([u, z]) @ form.beta_of(number, self.r)) / (z - form.poles)
            spectrum = states @ form.gamma.T + u @ self._start.D.T
            y = scipy.fft.irfft(spectrum, samples, axis=0)
            errors.append(np.asarray(record.y[:samples] - y))
        return errors

    def start(self, x0: Sequence[FloatArray]) -> FloatArray:
        """Return the parameters of the start, with initial states of the records."""
        ends = []
        for record, first in zip(self._records, x0, strict=True):
            # One sample more than the transform: where the next period would start.
            u = np.vstack([record.u[: whole_length(record)], np.zeros((1, self.r))])
            last = simulate_states(self._start.A, self._start.B, u, first)[-1]
            ends.append(np.asarray(first - last))
        return self.pack(ends)

    def settle(self, theta: FloatArray) -> None:
        """Make the bands suit the poles of some parameters, and the weights their errors."""
        poles = PoleForm(self, theta).poles
        if not all(each.suit(poles) for each in self._bands):
            self._bands = [spectral_bands(record, poles) for record in self._records]
        self.filters = whitening_filters(self.errors(theta))

    def unpack(self, theta: FloatArray) -> tuple[control.StateSpace, tuple[FloatArray, ...]]:
        """Return the model, and initial states that are fitted to the records."""
        model = self.model(theta)
        return model, fit_initial_states(model, self._records)

    def simpler(
        self, theta: FloatArray, group: tuple[int, ...]
    ) -> tuple[SpectralError, FloatArray]:
        """Return the problem without one mode, and the parameters that are left."""
        model, ends = self.without(theta, group)
        problem = SpectralError(model, self._records, self._filters, self._bands)
        return problem, problem.pack(ends)

    def powers(self, theta: FloatArray) -> FloatArray:
        """Return the sum of squares that each mode alone gives behind the filters, (modes,)."""
        powers = np.zeros(len(self.groups))
        form = PoleForm(self, theta)
        for number, gain in enumerate(self._gains):
            states, _, _ = self._responses(form, number)
            for mode, group in enumerate(map(list, self.groups)):
                powers[mode] += _weighted(states[..., group] @ form.gamma[:, group].T, gain)
        return powers

    def cost(self, theta: FloatArray) -> float:
        """Return the sum of squares."""
        form, total = PoleForm(self, theta), self._rest
        for number, gain in enumerate(self._gains):
            _, e, _ = self._responses(form, number)
            total += _weighted(e, gain)
        return total

    def normal(self, theta: FloatArray) -> Normal:
        """Return cost, gradient and the product of the Jacobian with itself."""
        form = PoleForm(self, theta)
        cost, gradient = self._rest, np.zeros(len(theta))
        matrix = np.zeros((len(theta), len(theta)))
        turns = [form.derivatives(output, self.r) for output in range(self.m)]
        for number, gain in enumerate(self._gains):
            states, e, near = self._responses(form, number)
            beta = form.beta_of(number, self.r)
            shares = self._shares(number, near)
            steeper = np.einsum("bsjp,jp->bsp", self._shares(number, near**2), beta)
            flat = shares.reshape(*shares.shape[:2], -1)
            rows = np.concatenate([steeper, flat, states, e], axis=-1)
            # The noise is white in a band: its products serve all outputs.
            products = np.matmul(rows.conj().transpose(0, 2, 1), rows)
            for output, turn in enumerate(turns):
                product = np.tensordot(gain[:, output], products, axes=1)
                slopes, error = slice(len(turn)), len(turn) + output
                place = self.columns(output, number)
                cost += float(product[error, error].real)
                gradient[place] += np.real(turn.conj().T @ product[slopes, error])
                matrix[np.ix_(place, place)] += np.real(
                    turn.conj().T @ product[slopes, slopes] @ turn
                )
        return Normal(cost, gradient, matrix)

    def _responses(
        self, form: PoleForm, record: int
    ) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return states, (bands, rows, poles), errors of the outputs, and 1 / (z - pole)."""
        bands = self._bands[record]
        near = 1.0 / (bands.nodes[..., np.newaxis] - form.poles)
        beta = form.beta_of(record, self.r)
        states = np.einsum("bsjp,jp->bsp", self._shares(record, near), beta)
        return states, states @ form.gamma.T + bands.inputs @ self._start.D.T - bands.y, near

    def _shares(self, record: int, response: ComplexArray) -> ComplexArray:
        """Return the responses to each input and to the ends, (bands, rows, inputs, poles)."""
        found = np.matmul(self._bands[record].drive, response)
        return np.asarray(found.reshape(len(found), -1, self.r + 1, self.n))


def _weighted(e: ComplexArray, gain: FloatArray) -> float:
    return float(np.sum(gain * np.sum(np.abs(e) ** 2, axis=1)))
