"""Spectral estimates of records: multiple coherence and the nonparametric frequency response.

Records are cut into half overlapping segments with a Hann window, whose periodograms are averaged
(Welch). Half overlapping segments count as 18 / 19 of as many separate ones.
Bendat, Piersol, "Random Data: Analysis and Measurement Procedures", 4th ed., Wiley (2010), chapters
7 and 11; Welch, "The use of fast Fourier transform for the estimation of power spectra", IEEE
Transactions on Audio and Electroacoustics 15 (1967).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from flexarm_ident.records.signals import hann_transforms
from flexarm_ident.subspace.gram import stretches

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.records.iodata import IoData

_OVERLAP_COUNTS = 18.0 / 19.0
# Segments of all records together. More resolve frequencies less, fewer scatter more.
_SEGMENTS = 16
_SEGMENTS_PER_INPUT = 4
_LONGEST, _SHORTEST = 4096, 64
# Power of an input at a frequency, in units of its largest, below which it says nothing.
_HEARD = 1e-12
# Share of the largest eigenvalue below which inputs depend on each other.
_DEPENDENT = 1e-10
# Segments beyond which an estimate hardly gains.
_MOST = 128


@dataclass(frozen=True, eq=False)
class Spectra:
    """Spectral estimates of outputs under inputs.

    Attributes
    ----------
    frequencies_hz : ndarray, (frequencies,)
        Frequencies, without zero.
    segments : float
        Number of independent segments that were averaged.
    power : ndarray, (frequencies, outputs)
        Power of the outputs, in arbitrary units.
    response : ndarray, (frequencies, outputs, inputs)
        Frequency response by least squares at each frequency.
    coherence : ndarray, (frequencies, outputs)
        Multiple coherence of each output with all inputs, without its bias: 0 on average where
        there is none, so that it may be negative.
    """

    frequencies_hz: FloatArray
    segments: float
    power: FloatArray
    response: ComplexArray
    coherence: FloatArray

    @property
    def explained(self) -> FloatArray:
        """Share of each output's power that is coherent with the inputs, (outputs,), 0 to 1."""
        total = self.power.sum(axis=0)
        coherent = np.sum(self.power * self.coherence, axis=0)
        share = np.divide(coherent, total, out=np.zeros_like(total), where=total > 0.0)
        return np.asarray(share.clip(0.0, 1.0))

    def chance(self, level: float) -> float:
        """Return the unbiased coherence that is exceeded by chance with a probability of `level`.

        Without coherence the biased one has a beta distribution.
        """
        inputs = self.response.shape[2]
        biased = scipy.special.betainccinv(inputs, self.segments - inputs, level)
        return float(_unbiased(np.array(biased), self.segments, inputs))


def spectra(
    records: Sequence[IoData], outputs: Sequence[FloatArray] | None = None
) -> Spectra | None:
    """Return spectral estimates of records of one rig; None for records that are too short.

    Parameters
    ----------
    records : sequence of IoData
        The records.
    outputs : sequence of ndarray, (samples, outputs), optional
        Signals to take for the outputs of each record, with NaN where they are not known.
    """
    inputs = records[0].u.shape[1]
    signals = outputs or [record.y_usable for record in records]
    pieces = [
        np.hstack([record.u[rows], y[rows]])
        for record, y in zip(records, signals, strict=True)
        for rows in stretches(y)
    ]
    wanted = _SEGMENTS + _SEGMENTS_PER_INPUT * inputs
    length = 2 * sum(map(len, pieces)) // (wanted + 1)
    length = min(_LONGEST, 1 << max(length, 1).bit_length() - 1)
    cut = [piece for piece in pieces if len(piece) >= length]
    if length < _SHORTEST or not cut:
        return None
    most = max(1, _MOST // len(cut))
    transforms = np.concatenate([_transforms(piece, length, most) for piece in cut])
    count = _OVERLAP_COUNTS * len(transforms) if len(transforms) > 1 else 1.0
    if count <= 2.0 * inputs:
        return None
    frequencies_hz = np.arange(1, length // 2) / (length * records[0].dt_s)
    return _estimates(frequencies_hz, transforms, inputs, count)


def _transforms(signals: FloatArray, length: int, most: int) -> ComplexArray:
    """Return the transforms of the segments, at most so many, (segments, frequencies, channels)."""
    segments = sliding_window_view(signals, length, axis=0)[:: length // 2]
    segments = segments[:: -(-len(segments) // most)]
    transforms = hann_transforms(segments)[..., 1 : length // 2]
    return np.asarray(transforms.transpose(0, 2, 1))


def _estimates(
    frequencies_hz: FloatArray, transforms: ComplexArray, inputs: int, count: float
) -> Spectra:
    signals = transforms.transpose(1, 2, 0)
    products = signals @ signals.conj().transpose(0, 2, 1) / len(transforms)
    power = products.diagonal(axis1=1, axis2=2).real
    drive, power = power[:, :inputs], power[:, inputs:]
    heard = drive > _HEARD * drive.max(axis=0)
    # An input without power at a frequency shows nothing there.
    scale = np.divide(1.0, np.sqrt(drive), out=np.zeros_like(drive), where=heard)
    unit = products[:, :inputs, :inputs] * scale[:, :, np.newaxis] * scale[:, np.newaxis]
    inverse = np.linalg.pinv(unit, rcond=_DEPENDENT, hermitian=True)
    crossed = products[:, inputs:, :inputs]
    scaled = crossed * scale[:, np.newaxis]
    response = (scaled @ inverse) * scale[:, np.newaxis]
    coherent = np.sum(response * crossed.conj(), axis=2).real
    biased = np.divide(coherent, power, out=np.zeros_like(power), where=power > 0.0).clip(0.0, 1.0)
    coherence = _unbiased(biased, count, inputs)
    return Spectra(frequencies_hz, count, power, response, coherence)


def _unbiased(coherence: FloatArray, segments: float, inputs: int) -> FloatArray:
    """Return a multiple coherence less its mean for unrelated signals, scaled to reach 1."""
    return np.asarray(1.0 - (1.0 - coherence) * segments / (segments - inputs))
