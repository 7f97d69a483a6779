"""Errors of a free simulation in the frequency domain, over the parameters in real modal form.

The lines of a spectrum are independent of each other, and a filter that whitens the errors is a
weight there (Whittle's likelihood). The spectra are gathered into bands, so that a step costs
nearly the same for a short and for a long record.

Whittle, "Estimation and information in stationary time series", Arkiv for Matematik 2 (1953).

The response of a pole is smooth where the distance from the pole is large. A band is therefore at
most as wide as half its distance from the nearest pole, and the response inside it is a polynomial
through a few nodes. The lines of a band then say no more than a few rows of a triangular factor do:
tens of thousands of lines become some hundred rows, whatever the length of the record.

The transform of a finite record is exact when the difference of its first and its last state is
taken for one more input with a flat spectrum (McKelvey 2002).

McKelvey, "Frequency domain identification methods", Circuits, Systems and Signal Processing 21
(2002); Berrut, Trefethen, "Barycentric Lagrange interpolation", SIAM Review 46 (2004).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.fitting.levenberg_marquardt import Normal
from flexarm_ident.fitting.modal_parameters import ModalParameters, PoleForm
from flexarm_ident.fitting.output_fit import fit_initial_states
from flexarm_ident.likelihood.noise_filter import whitening_filters
from flexarm_ident.models.state_space import simulate_states

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.records.iodata import IoData

_NODES = 5
# Width of a band in units of its distance from the nearest pole, and in radians: noise is taken for
# white inside a band.
_WIDTH = 0.5
_WIDEST_RAD = 0.1
# Shift of a pole in units of its distance from the unit circle.
_MOVED = 0.5
_ROUNDING = 1e-12


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


@dataclass(frozen=True, eq=False)
class Bands:
    """Spectra of one record as rows: outputs, and what inputs and end states contribute at nodes.

    Attributes
    ----------
    nodes : ndarray, (bands, nodes)
        Points exp(j w) of the unit circle.
    centres : ndarray, (bands,)
        The bands' middle, in radians a sample.
    drive : ndarray, (bands, rows of a band * (inputs + 1), nodes)
        Factors of a response at the nodes for each input, and at last for the end states.
    inputs : ndarray, (bands, rows of a band, inputs)
        Inputs. What fills a band up is zero.
    y : ndarray, (bands, rows of a band, outputs)
        Outputs. Squares of all rows and `rest` add up to those of the samples.
    rest : ndarray, (bands, outputs)
        Squares that no response which is smooth in the bands can explain.
    poles : ndarray, (poles,)
        Eigenvalues that the bands were made for.
    """

    nodes: ComplexArray
    centres: FloatArray
    drive: ComplexArray
    inputs: ComplexArray
    y: ComplexArray
    rest: FloatArray
    poles: ComplexArray

    def suit(self, poles: ComplexArray) -> bool:
        """Return whether the bands are narrow enough for a model with other poles."""
        moved = np.abs(np.subtract.outer(poles, self.poles)).min(axis=1)
        return bool(np.all(moved <= _MOVED * np.abs(1.0 - np.abs(poles)) + _ROUNDING))


def spectral_bands(record: IoData, poles: ComplexArray) -> Bands:
    """Return the spectra of a record in bands that suit a model with given poles.

    Parameters
    ----------
    record : IoData
        Record without holes.
    poles : ndarray, (poles,)
        Eigenvalues in discrete time.
    """
    samples = whole_length(record)
    u, y = (scipy.fft.rfft(part[:samples], axis=0) for part in (record.u, record.y))
    # Every line stands for itself and its conjugate, but for the first and the last.
    weight = np.full((len(u), 1), np.sqrt(2.0 / samples))
    weight[0] = np.sqrt(1.0 / samples)
    if samples % 2 == 0:
        weight[-1] = weight[0]
    # The end states act like an input that is one at every frequency.
    drive, y = weight * np.column_stack([u, np.ones(len(u))]), weight * y
    angles = 2.0 * np.pi / samples * np.arange(len(u), dtype=np.float64)
    cut = _cut(angles, poles)
    height = _NODES * drive.shape[1]
    nodes = np.empty((len(cut), _NODES), dtype=complex)
    rows = np.zeros((len(cut), height, drive.shape[1], _NODES), dtype=complex)
    values = np.zeros((len(cut), height, y.shape[1]), dtype=complex)
    rest = np.zeros((len(cut), y.shape[1]))
    for number, lines in enumerate(cut):
        points, shapes, inverse = _interpolation(angles[lines])
        factors = (drive[lines][:, :, np.newaxis] * shapes[:, np.newaxis]).reshape(-1, height)
        left = y[lines]
        if len(left) > height:
            basis, small = scipy.linalg.qr(factors, mode="economic", check_finite=False)
            factors = np.asarray(small)
            power = np.sum(np.abs(left) ** 2, axis=0)
            left = basis.conj().T @ left
            rest[number] = np.maximum(power - np.sum(np.abs(left) ** 2, axis=0), 0.0)
        nodes[number] = np.exp(1j * points)
        rows[number, : len(left)] = factors.reshape(len(left), -1, _NODES) @ inverse
        values[number, : len(left)] = left
    inputs = rows[:, :, :-1].sum(axis=-1)
    # By the end states the transform of z x follows, not that of x.
    rows[:, :, -1] *= nodes[:, np.newaxis]
    return Bands(
        nodes,
        np.array([0.5 * (angles[each][0] + angles[each][-1]) for each in cut]),
        rows.reshape(len(cut), -1, _NODES),
        inputs,
        values,
        rest,
        poles,
    )


def whole_length(record: IoData) -> int:
    """Return the leading samples whose transform is fast: all but a few."""
    samples = len(record)
    while scipy.fft.next_fast_len(samples, real=True) != samples:
        samples -= 1
    return samples


def _cut(angles: FloatArray, poles: ComplexArray) -> list[slice]:
    """Return the lines of each band."""
    near = np.unique(np.concatenate([poles, poles.conj()]))
    bands, first = [], 0
    while first < len(angles):
        distance = float(np.abs(np.exp(1j * angles[first]) - near).min(initial=np.inf))
        width = min(_WIDTH * distance, _WIDEST_RAD)
        after = int(np.searchsorted(angles, angles[first] + width, side="right"))
        bands.append(slice(first, max(after, first + 1)))
        first = bands[-1].stop
    return bands


def _interpolation(at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nodes, functions of the lines, (lines, nodes), and those at the nodes, inverted.

    The functions are Chebyshev's polynomials. Of a band of few lines these are the nodes.
    """
    if len(at) <= _NODES:
        # What fills up has no weight.
        nodes = np.append(at, np.full(_NODES - len(at), at[-1]))
        return nodes, np.eye(len(at), _NODES), np.eye(_NODES)
    middle, half = 0.5 * (at[0] + at[-1]), 0.5 * (at[-1] - at[0])
    return middle + half * _UNIT_NODES, _polynomials((at - middle) / half), _TO_POLYNOMIALS


def _polynomials(x: FloatArray) -> FloatArray:
    """Return Chebyshev's polynomials, (points, nodes)."""
    values = np.ones((len(x), _NODES))
    values[:, 1] = x
    for degree in range(2, _NODES):
        values[:, degree] = 2.0 * x * values[:, degree - 1] - values[:, degree - 2]
    return values


_UNIT_NODES: FloatArray = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
_TO_POLYNOMIALS: FloatArray = np.asarray(np.linalg.inv(_polynomials(_UNIT_NODES)), np.float64)
