"""Excitation of the data: activity, band and persistence of inputs, and length of records."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view

from flexarm_core.arrays import runs
from flexarm_core.labels import counted, instant
from flexarm_ident.diagnostics.check import Check, each_record
from flexarm_ident.records.data_warning import Grade, Kind
from flexarm_ident.records.signals import CONSTANT_SHARE, constant_share, hann_transforms
from flexarm_ident.records.span import without

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import BoolArray, FloatArray
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
# The same sign of four answers may be chance (one in sixteen), that of five is not at 5 %.
_MOVES = 5
# Windows of a record, and the samples that a window needs at least.
_WINDOWS = 256
_WINDOW_SAMPLES = 32
# The drive acts where this share of its power is.
_POWER = 0.9
_ACTIVE_SHARE = 0.1
# Longest hold of the record, and the probability of one as long if the moves came at random.
_HOLD_SHARE = 0.1
_STOP_SHARE = 0.05
_CHANCE = 1e-4
_ROUNDING = 1e-9


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


def drive_defects(record: IoData) -> Iterator[DataWarning]:
    """Yield what is wrong with the times at which the inputs of a record move."""
    if not moves_seldom(record):
        yield from _hold(record)
        return
    active = _active_windows(record)
    moves, share = len(runs(active)), float(active.mean())
    total_s = len(record) * record.dt_s
    yield _DRIVE(
        f"the inputs act in {share * total_s:.3g} of {total_s:.4g} s only, with "
        f"{counted(moves, 'transition')}: a response and a disturbance look alike; record {_MOVES} "
        "input transitions or more, all over the record",
        {"moves": float(moves), "active_s": share * total_s, "total_s": total_s},
    )


def moves_seldom(record: IoData) -> bool:
    """Return whether the inputs move a few times only, in a small part of the record."""
    active = _active_windows(record)
    return bool(len(active) and len(runs(active)) < _MOVES and active.mean() <= _ACTIVE_SHARE)


def is_stopped(record: IoData) -> bool:
    """Return whether the inputs end at zero and stay there, as after an emergency stop."""
    hold = _longest_hold(record)
    return hold is not None and _is_stop(record, hold)


class _Hold(NamedTuple):
    """Stretch without a change of an input, its share of the record, and changes elsewhere."""

    first: int
    last: int
    share: float
    moves: int

    @property
    def is_chance(self) -> bool:
        """Whether moves at random leave a gap as long."""
        return (self.moves + 1) * (1.0 - self.share) ** self.moves > _CHANCE


def _longest_hold(record: IoData) -> _Hold | None:
    """Return the longest stretch in which no input changes; None without inputs that move."""
    inputs = [u for u in record.u.T if np.ptp(u) > 0.0]
    if not inputs:
        return None
    still = np.all([np.abs(np.diff(u)) <= _ROUNDING * np.ptp(u) for u in inputs], axis=0)
    holds = runs(still)
    if not len(holds):
        return None
    first, last = max(holds.tolist(), key=lambda hold: hold[1] - hold[0])
    return _Hold(first, last, (last - first) / len(still), int(np.count_nonzero(~still)))


def _is_stop(record: IoData, hold: _Hold) -> bool:
    at_zero = bool(np.all(np.abs(record.u[-1]) <= _ROUNDING * np.ptp(record.u, axis=0)))
    is_last = hold.last == len(record) - 1
    return at_zero and is_last and hold.share >= _STOP_SHARE and not hold.is_chance


def _hold(record: IoData) -> Iterator[DataWarning]:
    """Yield the longest stretch in which no input changes, if chance does not explain it."""
    hold = _longest_hold(record)
    if hold is None:
        return
    first, last, share, moves = hold
    figures = {
        "first_row": float(first),
        "last_row": float(last),
        "share": share,
        "moves": float(moves),
    }
    if _is_stop(record, hold):
        yield _DRIVE(
            f"the input is idle at zero from {instant(first, record.dt_s)} to the end, "
            f"{100.0 * share:.3g} % of the record, as after a stop: leave those rows out "
            f"({without(record, [(first, last)])})",
            figures,
        )
        return
    if share < _HOLD_SHARE or hold.is_chance:
        return
    yield _DRIVE(
        f"the input is idle from {instant(first, record.dt_s)} to {instant(last, record.dt_s)}, "
        f"{100.0 * share:.3g} % of the record, and changes {moves} times elsewhere: leave those "
        f"rows out ({without(record, [(first, last)])}), or excite throughout",
        figures,
    )


def _active_windows(record: IoData) -> BoolArray:
    """Return which of the half overlapping windows hold most of an input's power; none if short."""
    samples = len(record)
    width = max(_WINDOW_SAMPLES, 2 * (samples // _WINDOWS))
    if samples < _WINDOW_SAMPLES * width // 2:
        return np.zeros(0, dtype=np.bool_)
    power = sliding_window_view(record.u, width, axis=0)[:: width // 2].var(axis=-1)
    active = np.zeros(len(power), dtype=np.bool_)
    for each in power.T:
        order = np.argsort(-each)
        total = np.cumsum(each[order])
        if total[-1] > 0.0:
            active[order[: 1 + np.searchsorted(total, _POWER * total[-1])]] = True
    return active


_DRIVE = Kind(
    "drive",
    "Input activity",
    "too few input transitions: nine tenths of the input's power in a tenth of the record, with "
    "fewer than 5 transitions; input idle: no change in a tenth of the record or more, where "
    "random transitions leave such a gap once in 10,000 records; or the input ends at zero, as "
    "after a stop, for a twentieth or more",
    "five input transitions or more; excite throughout, or leave those rows out (`--from`, `--to`)",
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
    Check(each_record(drive_defects), (_DRIVE,)),
    Check(lambda data: persistence(data.gram), (_EXCITATION,)),
    Check(each_record(excited_bands), (_EXCITATION,)),
    Check(lambda data: few_values(data.records, data.order), (_FEW_VALUES,)),
)
