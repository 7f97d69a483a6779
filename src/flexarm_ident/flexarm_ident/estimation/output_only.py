"""Modes from outputs alone: what shakes a machine was not measured.

Where the unknown forces have a smooth spectrum, the covariances of the outputs decay as the free
vibrations do, so the range space of the future outputs that past ones explain gives A and C as with
inputs (2-21). Such a record has frequencies, damping ratios and the shapes at the sensors. It
cannot tell a gain, and no shape's scale.
Van Overschee, De Moor, "Subspace Identification for Linear Systems", chapter 3 (1996); Peeters, De
Roeck, "Stochastic system identification for operational modal analysis: a review", Journal of
Dynamic Systems, Measurement, and Control 123 (2001).

A mode that is sampled hundreds of times a period hides in the block rows. The record is therefore
looked at several times, each time at a quarter of the rate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_core.errors import DataError
from flexarm_ident.diagnostics.spectra import spectra
from flexarm_ident.diagnostics.stabilisation import Criteria, stabilisation, subspace_matrices
from flexarm_ident.diagnostics.uncertainty import deviation
from flexarm_ident.models.modes import frequency_and_damping
from flexarm_ident.records.iodata import IoData, as_records
from flexarm_ident.subspace.gram import cut, segment_grams
from flexarm_ident.subspace.orse import past_instruments

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.diagnostics.spectra import Spectra
    from flexarm_ident.diagnostics.stabilisation import RecurringMode
    from flexarm_ident.subspace.gram import BlockGram

BLOCK_ROWS = 30
"""Block rows of the past, and of the future."""
# Parts of half the rate between which a look shows modes: the filter before it falls off above.
_SLOWEST, _SHOWN = 0.05, 0.8
_SLOWER = 4
# A look at fewer samples for each of the block rows shows little.
_SAMPLES_PER_ROW = 10
# Periods in a record, below which a vibration is not told from a drift.
_FEWEST_PERIODS = 10.0
# Pieces of the records, which are left out in turn by every tenth: a sweep passes each frequency
# in few of them.
_PIECES, _GROUPS = 60, 10
# Deviations of a damping ratio that it exceeds.
_CLEAR = 1.5
# Lines of the spectrum of all records, fewer of which are not the width of a resonance.
_FEWEST_WIDTHS = 2.0
# Half width of the band of an envelope, in half-power widths: almost all of a mode.
_WIDE = 3.0
# Deviation of the frequency, beyond which a mode is at no place.
_SCATTER = 0.02
# Neighbourhood of a mode in the spectrum, in units of its frequency.
_AROUND = 1.6
# A peak of the spectrum in units of its neighbourhood, and deviations of the latter beside that.
_STANDS_OUT, _DEVIATIONS = 1.5, 4.0
# Lines of a spectrum to each side that a pure vibration reaches through the window.
_REACH = 3.0
# Frequencies of one mode in two looks differ less.
_SAME = 0.02
_CRITERIA = Criteria(spread=0.02, share=0.4, smallest_damping=-0.002)


@dataclass(frozen=True, eq=False)
class OutputMode:
    """Vibration that outputs alone show.

    Attributes
    ----------
    frequency_hz, damping_ratio : float
        Natural frequency and damping ratio (2-28).
    frequency_std_hz, damping_std : float
        Their standard deviations.
    shape : ndarray, (outputs,)
        Complex amplitudes of the outputs; that of the one that moves most is 1. Its scale is not
        known.
    share : ndarray, (outputs,)
        Part of the power of each output, about its mean, in the half-power band of the mode.
    is_line : bool
        Whether it has no damping that the record shows: a harmonic of a rotating part, or of
        repeated moves, and no mode.
    """

    frequency_hz: float
    damping_ratio: float
    frequency_std_hz: float
    damping_std: float
    shape: ComplexArray
    share: FloatArray
    is_line: bool


@dataclass(frozen=True, eq=False)
class OutputModes:
    """Modes of one rig from outputs alone.

    Attributes
    ----------
    outputs : tuple of str
        Names of the outputs.
    found : tuple of OutputMode
        Modes and lines, by rising frequency.
    frequencies_hz : ndarray, (frequencies,)
        Frequencies of the spectra, up to those of the highest mode.
    density : ndarray, (frequencies, outputs)
        Power spectral density of each output, in its unit squared per Hz.
    """

    outputs: tuple[str, ...]
    found: tuple[OutputMode, ...]
    frequencies_hz: FloatArray
    density: FloatArray

    @property
    def modes(self) -> tuple[OutputMode, ...]:
        """Those that are modes."""
        return tuple(each for each in self.found if not each.is_line)

    def without_lines(self) -> FloatArray:
        """Return the density, (frequencies, outputs), with straight lines across the lines."""
        density, step_hz = self.density.copy(), self.frequencies_hz[0]
        for line in (each for each in self.found if each.is_line):
            near = np.abs(self.frequencies_hz - line.frequency_hz) <= _REACH * step_hz
            for column in density.T:
                column[near] = np.interp(
                    self.frequencies_hz[near], self.frequencies_hz[~near], column[~near]
                )
        return density


class _Look(NamedTuple):
    """Records at one rate, with the frequencies that are taken from them."""

    records: tuple[IoData, ...]
    lowest_hz: float
    highest_hz: float


def identify_modes(data: IoData | Sequence[IoData]) -> OutputModes:
    """Return the modes that the outputs of records show, whatever the inputs were.

    Parameters
    ----------
    data : IoData or sequence of IoData
        Records of one rig; inputs are left out, and there may be none.

    Returns
    -------
    OutputModes
        Modes and undamped lines with their deviations, and the spectra of the outputs. There is no
        mode where the outputs show noise alone.

    Raises
    ------
    DataError
        If the records are too short, or no output varies.
    """
    records = tuple(map(_outputs_alone, as_records(data)))
    looks = tuple(_looks(records))
    seen = [(look, mode) for look in looks for mode in _modes_of(look)]
    kept: list[tuple[_Look, OutputMode]] = []
    for look, mode in sorted(seen, key=lambda pair: pair[1].frequency_std_hz):
        if not any(look is not other and _is_same(mode, known) for other, known in kept):
            kept.append((look, mode))
    shown = max((look for look, _ in kept), key=lambda look: look.highest_hz, default=looks[0])
    known = spectra(shown.records)
    if known is None:
        raise _too_short(records)
    line_hz = known.frequencies_hz[0]
    power = np.mean([np.nanvar(record.y_usable, axis=0) for record in shown.records], axis=0)
    density = known.power * power / (known.power.sum(axis=0) * line_hz)
    found = tuple(sorted((mode for _, mode in kept), key=lambda mode: mode.frequency_hz))
    return OutputModes(records[0].outputs, found, known.frequencies_hz, density)


def _outputs_alone(record: IoData) -> IoData:
    y = record.y_usable - np.nanmean(record.y_usable, axis=0)
    if not np.nanmax(np.abs(y), axis=0).all():
        name = record.outputs[int(np.argmin(np.nanmax(np.abs(y), axis=0)))]
        raise DataError(f"{record.label}: {name} does not vary: leave it out")
    return IoData(
        np.empty((len(y), 0)),
        y,
        dt_s=record.dt_s,
        inputs=(),
        outputs=record.outputs,
        source=record.source,
    )


def _looks(records: tuple[IoData, ...]) -> Iterator[_Look]:
    """Yield the records at their rate, and at a quarter of it each as long as samples suffice."""
    lowest_hz = _FEWEST_PERIODS / max(len(record) * record.dt_s for record in records)
    highest_hz = 0.5 / records[0].dt_s
    while True:
        slower = tuple(map(_decimated, records))
        is_last = min(map(len, slower)) < _SAMPLES_PER_ROW * 2 * BLOCK_ROWS
        yield _Look(records, lowest_hz if is_last else _SLOWEST * 0.5 / records[0].dt_s, highest_hz)
        if is_last:
            return
        records, highest_hz = slower, _SHOWN * 0.5 / slower[0].dt_s


def _decimated(record: IoData) -> IoData:
    """Return a record at a quarter of its rate; what a hole reaches through the filter is left out.

    The filter is the one of `scipy.signal.resample_poly`, symmetric, 10 new samples to each side.
    """
    y = scipy.signal.resample_poly(record.y, 1, _SLOWER, axis=0)
    holes = scipy.ndimage.binary_dilation(~record.usable, iterations=10 * _SLOWER)
    y[holes[::_SLOWER]] = np.nan
    return replace(record, u=np.empty((len(y), 0)), y=y, missing=None, dt_s=_SLOWER * record.dt_s)


def _modes_of(look: _Look) -> list[OutputMode]:
    records = look.records
    known = spectra(records)
    if known is None:
        raise _too_short(records)
    whole, parts = _grams(records)
    space = past_instruments(whole)
    matrices = subspace_matrices(space)
    dt_s = records[0].dt_s
    diagram = stabilisation(matrices, space.output_scale, dt_s, _CRITERIA)
    inside = [
        mode for mode in diagram.modes if look.lowest_hz < mode.frequency_hz <= look.highest_hz
    ]
    replicates = [_poles_of(part, matrices, dt_s) for part in parts] if inside else []
    found = []
    for mode in inside:
        figures = np.array([_followed(mode, poles) for poles in replicates])
        frequency_std_hz, damping_std = deviation(figures).tolist()
        shape = mode.shape / space.output_scale
        is_line = _is_line(mode, records, int(np.argmax(np.abs(shape))))
        is_damped = mode.damping_ratio > _CLEAR * damping_std
        is_placed = frequency_std_hz <= _SCATTER * mode.frequency_hz
        if is_placed and (is_line or is_damped) and _stands_out(mode, known):
            found.append(
                OutputMode(
                    mode.frequency_hz,
                    max(mode.damping_ratio, 0.0),
                    frequency_std_hz,
                    damping_std,
                    shape / shape[np.argmax(np.abs(shape))],
                    _band(mode, known).sum(axis=0) / known.power.sum(axis=0),
                    is_line,
                )
            )
    return found


def _grams(records: Sequence[IoData]) -> tuple[BlockGram, list[BlockGram]]:
    """Return the products of the records, and those without every tenth piece, for each tenth."""
    pieces = segment_grams(records, 2 * BLOCK_ROWS, cut(records, 2 * BLOCK_ROWS, _PIECES))
    whole = _sum(pieces)
    groups = [pieces[number::_GROUPS] for number in range(min(_GROUPS, len(pieces)))]
    return whole, [_sum([whole, _sum(group, -1)]) for group in groups]


def _sum(grams: Sequence[BlockGram], sign: int = 1) -> BlockGram:
    matrix = np.sum([sign * each.matrix for each in grams], axis=0)
    return replace(grams[0], matrix=matrix, columns=sum(sign * each.columns for each in grams))


def _poles_of(gram: BlockGram, orders: Iterable[int], dt_s: float) -> dict[int, FloatArray]:
    """Return frequencies and damping ratios, (pairs, 2), of the models of some orders."""
    space = past_instruments(gram)
    poles = {order: np.linalg.eigvals(space.matrices(order).A) for order in orders}
    return {
        order: np.array(
            [frequency_and_damping(complex(pole), dt_s) for pole in each if pole.imag > 0.0]
        )
        for order, each in poles.items()
    }


def _followed(mode: RecurringMode, poles: Mapping[int, FloatArray]) -> FloatArray:
    """Return frequency and damping ratio of a mode in other estimates: medians of its orders."""
    own = np.array([mode.frequency_hz, mode.damping_ratio])
    unit = np.array([mode.frequency_hz, 1.0])
    found = [poles[order] for order in mode.orders if len(poles[order])]
    nearest = [each[np.argmin(np.linalg.norm((each - own) / unit, axis=1))] for each in found]
    return np.asarray(np.median(np.array(nearest), axis=0))


def _band(mode: RecurringMode, known: Spectra) -> FloatArray:
    """Return the powers in the half-power band of a mode, (frequencies, outputs)."""
    half_hz = max(mode.damping_ratio * mode.frequency_hz, known.frequencies_hz[0])
    return np.asarray(known.power[np.abs(known.frequencies_hz - mode.frequency_hz) <= half_hz])


def _stands_out(mode: RecurringMode, known: Spectra) -> bool:
    """Return whether the spectrum of any output has a peak at a mode."""
    ratio = known.frequencies_hz / mode.frequency_hz
    around = known.power[(ratio > 1.0 / _AROUND) & (ratio < _AROUND)]
    peak = _band(mode, known).max(axis=0) / np.median(around, axis=0)
    return bool(np.max(peak) > _STANDS_OUT + _DEVIATIONS / np.sqrt(known.segments))


def _is_line(mode: RecurringMode, records: Sequence[IoData], output: int) -> bool:
    """Return whether a vibration does not decay within the records, or has a constant envelope.

    The squared envelope of a vibration that noise excites has an exponential distribution: the mean
    of its square is twice the square of its mean. That of a rotating part has a ratio of 1, also
    where its speed wanders; that of blows and sweeps has more than 2.
    """
    width_hz = 2.0 * mode.damping_ratio * mode.frequency_hz
    duration_s = sum(len(record) * record.dt_s for record in records)
    if width_hz * duration_s < _FEWEST_WIDTHS:
        return True
    power = np.concatenate([_envelope(record, mode, output) ** 2 for record in records])
    ratio = np.mean(power**2) / np.mean(power) ** 2
    # Independent values of the envelope, by the noise bandwidth of a resonance.
    independent = 0.5 * np.pi * width_hz * duration_s
    return bool(ratio < 2.0 - _DEVIATIONS / np.sqrt(independent))


def _envelope(record: IoData, mode: RecurringMode, output: int) -> FloatArray:
    """Return the envelope of an output around a mode, (samples,), without the rows in holes."""
    lines_hz = np.fft.fftfreq(len(record), record.dt_s)
    half_hz = max(_WIDE * mode.damping_ratio * mode.frequency_hz, 4.0 * lines_hz[1])
    inside = np.abs(lines_hz - mode.frequency_hz) <= half_hz
    analytic = np.fft.ifft(np.where(inside, np.fft.fft(record.y[:, output]), 0.0))
    return np.asarray(np.abs(analytic[record.usable]))


def _is_same(one: OutputMode, other: OutputMode) -> bool:
    return abs(one.frequency_hz - other.frequency_hz) <= _SAME * other.frequency_hz


def _too_short(records: Sequence[IoData]) -> DataError:
    samples = sum(map(len, records))
    return DataError(
        f"{records[0].label}: {samples} samples are too few for modes from outputs alone: "
        "record longer"
    )
