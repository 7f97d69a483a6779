"""Spectra of records, gathered into bands so narrow that a model is smooth in each of them.

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

if TYPE_CHECKING:
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
