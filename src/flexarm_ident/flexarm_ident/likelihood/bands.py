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
    from numpy.typing import NDArray

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.records.iodata import IoData

    IntArray = NDArray[np.intp]

_NODES = 5
# Width of a band in units of its distance from the nearest pole, and in radians: noise is taken for
# white inside a band.
_WIDTH = 0.5
_WIDEST_RAD = 0.1


@dataclass(frozen=True, eq=False)
class Bands:
    """Spectra of one record as rows: outputs, and what inputs and end states contribute at nodes.

    Attributes
    ----------
    nodes : ndarray, (bands, nodes)
        Points exp(j w) of the unit circle.
    centres : ndarray, (bands,)
        The bands' middle, in radians a sample.
    band : ndarray, (rows,)
        Band of each row.
    drive : ndarray, (rows, inputs + 1, nodes)
        Factors of a response at the nodes for each input, and at last for the end states.
    y : ndarray, (rows, outputs)
        Outputs. Squares of all rows and `rest` add up to those of the samples.
    rest : ndarray, (bands, outputs)
        Squares that no response which is smooth in the bands can explain.
    """

    nodes: ComplexArray
    centres: FloatArray
    band: IntArray
    drive: ComplexArray
    y: ComplexArray
    rest: FloatArray


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
    angles = 2.0 * np.pi / samples * np.arange(len(u))
    nodes, centres, band, rows, values, rest = [], [], [], [], [], []
    for number, lines in enumerate(_cut(angles, poles)):
        at = angles[lines]
        points, shapes = _interpolation(at)
        factors = (drive[lines][:, :, np.newaxis] * shapes[:, np.newaxis]).reshape(len(at), -1)
        left = y[lines]
        power = np.sum(np.abs(left) ** 2, axis=0)
        if len(at) > factors.shape[1]:
            basis, factors = scipy.linalg.qr(factors, mode="economic", check_finite=False)
            left = basis.conj().T @ left
        nodes.append(np.exp(1j * points))
        centres.append(0.5 * (at[0] + at[-1]))
        band.append(np.full(len(left), number))
        factors = factors.reshape(len(left), drive.shape[1], -1)
        # By the end states the transform of z x follows, not that of x.
        factors[:, -1] *= np.exp(1j * points)
        rows.append(factors)
        values.append(left)
        rest.append((power - np.sum(np.abs(left) ** 2, axis=0)).clip(min=0.0))
    return Bands(
        np.array(nodes),
        np.array(centres),
        np.concatenate(band),
        np.concatenate(rows),
        np.concatenate(values),
        np.array(rest),
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


def _interpolation(at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return nodes and the polynomials that are one at one of them, (lines, nodes)."""
    if len(at) <= _NODES:
        # The lines themselves; what fills up has no weight.
        shapes = np.zeros((len(at), _NODES))
        np.fill_diagonal(shapes, 1.0)
        return np.append(at, np.full(_NODES - len(at), at[-1])), shapes
    unit = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    x = (2.0 * at - at[0] - at[-1]) / (at[-1] - at[0])
    shapes = np.ones((len(at), _NODES))
    for node, place in enumerate(unit):
        for other in np.delete(unit, node):
            shapes[:, node] *= (x - other) / (place - other)
    return 0.5 * (at[0] + at[-1]) + 0.5 * (at[-1] - at[0]) * unit, shapes
