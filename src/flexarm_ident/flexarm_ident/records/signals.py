"""Signal properties: magnitude, bandwidth, smoothing, constancy, and stretches of a dead sensor."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from flexarm_core.arrays import column_range
from flexarm_core.errors import DataError
from flexarm_ident.records.data_warning import CONVERTED, Grade

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

_POWER_OUTSIDE = 1e-3
# Noise with more of an output's power cannot be told from a signal that fills the band.
_MOSTLY_NOISE = 0.5
# Sums over noise scatter; what exceeds so many of their deviations is signal.
_STANDS_OUT = 4.0
_ORDER = 2
_CONTINUOUS = 0.95
_LONGEST_HOLD = 20
_MOSTLY = 0.5
_LOOK = 2048
_CONSTANT_LOOK = 0.9

ROUNDING = 1e-9
"""Difference of two samples, as a part of them, that is none."""
CONSTANT_SHARE = 0.99
"""Share of equal samples above which a channel counts as constant."""
FEW_LEVELS = 20
"""Values of a switch or a square wave at most."""
NORMAL_MAD = 1.4826
"""Standard deviation of normal values over their median absolute deviation."""
# Fourth powers occur, and ratios of outputs to inputs.
_SMALLEST, _LARGEST = 1e-50, 1e50


def hann_transforms(segments: FloatArray) -> ComplexArray:
    """Return the transforms of segments about their means by a Hann window, (..., frequencies).

    Parameters
    ----------
    segments : ndarray, (..., samples)
        Pieces of signals.
    """
    length = segments.shape[-1]
    # scipy.signal has such windows too, and takes long to import.
    window = np.hanning(length + 1)[:-1]
    centred = segments - segments.mean(axis=-1, keepdims=True)
    return np.asarray(scipy.fft.rfft(centred * window, axis=-1))


def bandwidth_hz(records: Sequence[IoData]) -> float:
    """Return the frequency below which 99.9 % of every output's power lies, white noise left out.

    The floor of the spectrum's upper half is taken for white noise of the sensor, which would move
    the frequency towards half the sampling rate from 3 % of noise on. Less of the power lies below
    where the noise hides as much as 0.1 % of it.
    """
    highest = 0.0
    for record in records:
        frequency, power = scipy.signal.periodogram(
            record.y, 1.0 / record.dt_s, window="hann", detrend="constant", axis=0
        )
        last = max(_last_line(each) for each in power.T)
        highest = max(highest, float(frequency[last]))
    return highest


def _last_line(power: FloatArray) -> int:
    """Return the last line of a periodogram, (lines,), that holds power of a signal."""
    lines, whole = len(power), float(power.sum())
    # Lines of white noise are distributed exponentially.
    floor = float(np.median(power[lines // 2 :])) / np.log(2.0)
    if lines * floor > _MOSTLY_NOISE * whole:
        floor = 0.0
    noise = lines * floor / whole if whole > 0.0 else 0.0
    outside = max(_POWER_OUTSIDE, _STANDS_OUT * noise / np.sqrt(lines / 2.0))
    below = np.cumsum(power - floor)
    return int(np.argmax(below >= (1.0 - outside) * below[-1]))


def smoothed(x: FloatArray, cutoff_hz: float, dt_s: float) -> FloatArray:
    """Return signals low-passed forwards and backwards, without a phase lag.

    Parameters
    ----------
    x : ndarray, (samples, channels)
        Signals.
    cutoff_hz : float
        Cut-off; signals are unchanged when it reaches 0.45 of the sampling rate.
    dt_s : float
        Sampling period.
    """
    if cutoff_hz * dt_s >= 0.45:  # noqa: PLR2004 (of the sampling rate: nothing left to remove)
        return x
    sections = scipy.signal.butter(_ORDER, cutoff_hz, fs=1.0 / dt_s, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, x, axis=0))


def live_samples(record: IoData) -> FloatArray:
    """Return weights: 1.0 where an output was measured, 0.0 in holes and where its sensor was dead.

    An output that changes from sample to sample, as a gauge does and an encoder does not, is dead
    where it keeps exactly one value for more than 20 samples. Filtering hides dead sensors, so the
    record has to be as measured. The weights have the shape (samples, outputs).
    """
    measured = record.y_measured
    live = np.where(np.isnan(measured), 0.0, 1.0)
    for channel, y in enumerate(measured.T):
        for rows in _holds(y):
            live[rows.start : rows.stop, channel] = 0.0
    return live


def dead_stretches(record: IoData, channel: int) -> tuple[range, ...]:
    """Return the rows in which one output of a record as measured was dead while the rig moved.

    The output is dead as in `live_samples`, and another one or an input changes in most of the
    samples. A simulated rig without noise rests with all outputs constant: that is not a
    defect. The line that fills a hole between two equal values is none, either.
    """
    holds = _holds(record.y_measured[:, channel])
    if not holds:
        return ()
    others = np.delete(record.y, channel, axis=1)
    moves = np.any(np.diff(np.hstack([others, record.u]), axis=0) != 0.0, axis=1)
    return tuple(rows for rows in holds if np.mean(moves[rows.start : rows.stop - 1]) > _MOSTLY)


def look(x: FloatArray) -> FloatArray:
    """Return a few samples from all over a signal, which show a defect of the whole signal."""
    return x[:: max(1, len(x) // _LOOK)]


def constant_share(x: FloatArray) -> float:
    """Return the share of equal samples of a signal, rounding apart; 0 if it is small."""
    some = look(x)
    usual = np.median(some)
    near = ROUNDING * abs(usual)
    if np.mean(np.abs(some - usual) <= near) < _CONSTANT_LOOK:
        return 0.0
    return float(np.mean(np.abs(x - usual) <= near))


def _holds(y: FloatArray) -> list[range]:
    """Return the long runs of one value in a signal that otherwise changes from row to row."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(y) != 0.0) + 1, [len(y)]])
    lengths = np.diff(edges)
    holds = np.flatnonzero(lengths > _LONGEST_HOLD)
    elsewhere = len(y) - lengths[holds].sum()
    if len(lengths) - len(holds) < _CONTINUOUS * elsewhere or elsewhere == 0:
        return []
    return [range(int(edges[hold]), int(edges[hold + 1])) for hold in holds]


def in_range(data: IoData) -> IoData:
    """Return a record with every channel in a range that can be computed with.

    A channel whose largest value is beyond 1e-50 to 1e50 is multiplied by a power of ten, and a
    notice says so. The compensation is multiplied as its input, the reference as the first output.
    """
    inputs, outputs = _exponents(data.u), _exponents(data.y)
    if not (inputs.any() or outputs.any()):
        return data
    names = (*data.inputs, *data.outputs)
    notices = [
        _notice(name, int(exponent))
        for name, exponent in zip(names, (*inputs, *outputs), strict=True)
        if exponent
    ]
    compensation, reference = data.compensation, data.reference
    return replace(
        data,
        u=_times(data.u, inputs),
        y=_times(data.y, outputs),
        compensation=None if compensation is None else _times(compensation, inputs),
        reference=None if reference is None else _times(reference, data.of_tracked(outputs)),
        notices=(*data.notices, *notices),
    )


def check_magnitude(data: IoData) -> None:
    """Refuse a record that `in_range` would change.

    Raises
    ------
    DataError
        When the largest value of a channel is beyond 1e-50 to 1e50.
    """
    for names, values in ((data.inputs, data.u), (data.outputs, data.y)):
        for channel in np.flatnonzero(_exponents(values)):
            raise DataError(
                f"{data.label}: {names[channel]} reaches {np.abs(values[:, channel]).max():.3g}, "
                "too far from 1 to compute with: prepare the record with preprocess, or give it in "
                "another unit"
            )


def _exponents(values: FloatArray) -> NDArray[np.intp]:
    """Return the powers of ten that bring each channel near 1; 0 where it need not."""
    low, high = column_range(values)
    largest = np.maximum(np.abs(low), np.abs(high))
    within = (largest == 0.0) | ((largest >= _SMALLEST) & (largest <= _LARGEST))
    return -np.floor(np.log10(np.where(within, 1.0, largest))).astype(np.intp)


def _times(values: FloatArray, exponents: Any) -> FloatArray:  # noqa: ANN401 - one or an array
    # In two steps: one power of ten may be beyond the range itself.
    half = exponents // 2
    return np.asarray(values * 10.0**half * 10.0 ** (exponents - half))


def _notice(name: str, exponent: int) -> DataWarning:
    return CONVERTED(
        f"{name} was multiplied by 1e{exponent:+d} to compute with it: the model has that unit",
        {"exponent": float(exponent)},
        grade=Grade.CAUTION,
        channel=name,
    )
