"""Excitation of the data: band and persistence of the inputs, and length of the records."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_ident.diagnostics.check import Check, each_record
from flexarm_ident.records.data_warning import Grade, Kind
from flexarm_ident.records.signals import CONSTANT_SHARE, constant_share, hann_transforms

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram

# Condition of the inputs' product matrix, which is that of the inputs squared.
_SINGULAR_CONDITION = 1e12
# 40 dB below the maximum, more than the leakage of the window.
_EXCITED = 1e-4
_PARTS = 16
_EXCITED_SHARE = 0.8
_LOWEST_EXCITED = 0.02
_VALUES_A_PARAMETER = 5.0
FEW_VALUES = "few_values"
"""Code of the warning that a record has too few values to judge a model by."""


def excited_band_hz(u: FloatArray, dt_s: float) -> tuple[float, float, float]:
    """Return the band in which one input has power, and the excited share of all frequencies.

    A frequency counts when the density of the input, or that of its increments, is within 40 dB of
    its own maximum. Steps excite high frequencies by their edges, however small their part of the
    power is.

    Parameters
    ----------
    u : ndarray, (samples,)
        One input.
    dt_s : float
        Sampling period.

    Returns
    -------
    float, float
        Lowest and highest excited frequency, in hertz; both zero when there is none.
    float
        Excited share of the frequencies up to Nyquist.
    """
    length = min(len(u), max(256, min(len(u) // 8, 4096)))
    # Parts spread over a long record suffice.
    starts = np.linspace(0, len(u) - length, min(_PARTS, 2 * len(u) // length)).astype(int)
    parts = u[starts[:, np.newaxis] + np.arange(length)]
    density = np.mean(np.abs(hann_transforms(parts)) ** 2, axis=0)
    if length % 2 == 0:
        # Of the Nyquist frequency there is one line, of the others two.
        density[-1] /= 2.0
    frequencies_hz = np.fft.rfftfreq(length, dt_s)
    # The increments' density follows from it. The mean of the record is left out of both.
    increments = density * np.sin(np.pi * frequencies_hz * dt_s) ** 2
    density, increments, frequencies_hz = density[1:], increments[1:], frequencies_hz[1:]
    excited = (density > _EXCITED * density.max()) | (increments > _EXCITED * increments.max())
    if not excited.any():
        return 0.0, 0.0, 0.0
    band = frequencies_hz[excited]
    return float(band[0]), float(band[-1]), float(excited.mean())


def persistence(gram: BlockGram) -> Iterator[DataWarning]:
    """Yield what is wrong with the inputs' product matrix."""
    rows = gram.input_rows(0, gram.block_rows)
    inputs = gram.matrix[np.ix_(rows, rows)]
    scale = np.sqrt(np.diag(inputs))
    scale[scale == 0.0] = 1.0
    values = scipy.linalg.eigvalsh(inputs / np.outer(scale, scale))
    smallest = max(values[0], np.finfo(float).eps * values[-1])
    # Inputs that act in stretches too short for the products alone leave all of them zero.
    condition = float(values[-1] / smallest) if smallest > 0.0 else np.inf
    if condition >= _SINGULAR_CONDITION:
        yield _EXCITATION(
            f"the input excites few frequencies: U U' has the condition number {condition:.0e}, a "
            "pseudo-inverse was used and modes outside its band are not to be trusted",
            {"condition": condition},
        )


def few_values(records: Sequence[IoData], states: int) -> Iterator[DataWarning]:
    """Yield what is wrong with the number of measured values beside that of a model's parameters.

    The parameters are B, C, as many eigenvalues as states, and a record's initial state.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    states : int
        Order of the model.
    """
    inputs, outputs = len(records[0].inputs), len(records[0].outputs)
    parameters = states * (inputs + outputs + len(records))
    samples = sum(int(record.usable.sum()) for record in records)
    if samples * outputs < _VALUES_A_PARAMETER * parameters:
        yield _FEW_VALUES(
            f"{samples} samples are few for order {states}: {samples * outputs} values of the "
            f"outputs for {parameters} parameters, {_VALUES_A_PARAMETER:.0f} times as many would "
            "be good; record longer or lower the order",
            {"samples": float(samples), "parameters": float(parameters)},
        )


def excited_bands(record: IoData) -> Iterator[DataWarning]:
    """Yield the inputs of a record that leave out a part of the frequencies."""
    nyquist_hz = 0.5 / record.dt_s
    for name, u in zip(record.inputs, record.u.T, strict=True):
        if constant_share(u) > CONSTANT_SHARE:
            continue
        low_hz, high_hz, share = excited_band_hz(u, record.dt_s)
        if share < _EXCITED_SHARE or low_hz > _LOWEST_EXCITED * nyquist_hz:
            yield _EXCITATION(
                f"{name} has power between {low_hz:.3g} and {high_hz:.3g} Hz only, "
                f"{100.0 * share:.3g} % of the frequencies up to {nyquist_hz:.4g} Hz: modes "
                "outside are not to be trusted",
                {"low_hz": low_hz, "high_hz": high_hz, "share": share},
                grade=Grade.INFORMATION,
                channel=name,
            )


_EXCITATION = Kind(
    "excitation",
    "Persistence of excitation",
    "condition of U U' 1e12 or more; below 80 % of the frequencies within 40 dB, or none below 2"
    " % of Nyquist, is information",
    "excite with steps or noise over all modes; trust no mode outside the excited band",
)
_FEW_VALUES = Kind(
    FEW_VALUES,
    "Number of values",
    "fewer values of the outputs than five for each of the n (inputs + outputs + records) "
    "parameters",
    "record longer, or a lower order",
)
CHECKS = (
    Check(lambda data: persistence(data.gram), (_EXCITATION,)),
    Check(each_record(excited_bands), (_EXCITATION,)),
    Check(lambda data: few_values(data.records, data.order), (_FEW_VALUES,)),
)
