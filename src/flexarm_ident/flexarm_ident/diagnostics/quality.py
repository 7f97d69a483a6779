"""Quality warnings of records, with their names and figures."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
import scipy

from flexarm_core.arrays import runs
from flexarm_core.labels import counted
from flexarm_ident.records.iodata import DataWarning
from flexarm_ident.records.signals import dead_stretches
from flexarm_ident.subspace.feedback import feedback_test

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram

# Condition of the inputs' product matrix, which is that of the inputs squared.
_SINGULAR_CONDITION = 1e12
# 40 dB below the maximum, more than the leakage of the window.
_EXCITED = 1e-4
_PARTS = 16
_EXCITED_SHARE = 0.8
_LOWEST_EXCITED = 0.02
_LARGEST_OFFSET = 10.0
_SHORT = 3.0
_CONSTANT_SHARE = 0.99
_CONSTANT_LOOK = 0.9
_ROUNDING = 1e-9
_SAME, _ALMOST_SAME = 1e-6, 1e-4
_LOOK = 2048
_FEW_LEVELS = 20
_PLATEAU_SHARE = 1e-3
_PLATEAU_SAMPLES = 3
_PLATEAU_COUNT = 5.0
_PLATEAU_SLOPE = 0.05
_NEIGHBOURS = 3


def assess(
    records: Sequence[IoData], gram: BlockGram, *, feedthrough: bool = False
) -> tuple[DataWarning, ...]:
    """Return the defects of an identification's data; none for good data.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    gram : BlockGram
        Their Gram, of as many block rows as the identification uses.
    feedthrough : bool
        Whether D is fitted.

    Returns
    -------
    tuple of DataWarning
        ``feedback``, ``input_condition``, ``too_short`` once; the notices of each record, such as
        ``lost_samples`` and ``clock_jitter`` from a bag; ``constant_channel``, ``offset``,
        ``saturation``, ``dead_sensor``, ``duplicated_channel`` and ``excitation_band`` per record
        and channel.
    """
    found = [*_feedback(records, gram, feedthrough=feedthrough), *_conditions(gram, records)]
    for record in records:
        found += [
            replace(notice, text=f"{record.label}: {notice.text}") for notice in record.notices
        ]
        found += _channels(record)
        found += _duplicates(record)
        found += _bands(record)
    return tuple(found)


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
    frequencies_hz, densities = scipy.signal.periodogram(parts, 1.0 / dt_s, window="hann")
    density = densities.mean(axis=0)
    # The increments' density follows from it. The mean of the record is left out of both.
    increments = density * np.sin(np.pi * frequencies_hz * dt_s) ** 2
    density, increments, frequencies_hz = density[1:], increments[1:], frequencies_hz[1:]
    excited = (density > _EXCITED * density.max()) | (increments > _EXCITED * increments.max())
    if not excited.any():
        return 0.0, 0.0, 0.0
    band = frequencies_hz[excited]
    return float(band[0]), float(band[-1]), float(excited.mean())


def _feedback(
    records: Sequence[IoData], gram: BlockGram, *, feedthrough: bool
) -> Iterator[DataWarning]:
    test = feedback_test(records, gram, feedthrough=feedthrough)
    declared = any(record.closed_loop for record in records)
    if not (test.detected or declared):
        return
    figures = {
        "statistic": test.statistic,
        "degrees": float(test.degrees),
        "p_value": test.p_value,
        "background": test.background,
    }
    if test.detected:
        evidence = (
            f"the inputs correlate with the outputs' noise, chi-square {test.statistic:.0f} where "
            f"{test.degrees} is usual"
        )
        if not declared:
            evidence += (
                ", though no loop is declared (or the output follows the input within a sample)"
            )
    else:
        evidence = "the record states it, and its noise is too small to tell"
    yield DataWarning(
        "feedback",
        f"closed-loop data: {evidence}; the controller feeds noise back into the input, so plain "
        "ORSE is biased and a small bias remains with the other methods",
        figures,
    )


def _conditions(gram: BlockGram, records: Sequence[IoData]) -> Iterator[DataWarning]:
    rows = gram.input_rows(0, gram.block_rows)
    inputs = gram.matrix[np.ix_(rows, rows)]
    scale = np.sqrt(np.diag(inputs))
    scale[scale == 0.0] = 1.0
    values = scipy.linalg.eigvalsh(inputs / np.outer(scale, scale))
    condition = float(values[-1] / max(values[0], np.finfo(float).eps * values[-1]))
    if condition >= _SINGULAR_CONDITION:
        yield DataWarning(
            "input_condition",
            f"the input excites few frequencies: U U' has the condition number {condition:.0e}, a "
            "pseudo-inverse was used and modes outside its band are not to be trusted",
            {"condition": condition},
        )
    needed = len(gram.matrix)
    if gram.columns < _SHORT * needed:
        samples = sum(len(record) for record in records)
        yield DataWarning(
            "too_short",
            f"{samples} samples are few for {gram.block_rows} block rows: {gram.columns} columns "
            f"for {needed} rows, {_SHORT:.0f} times as many would be good; record longer or lower "
            "block_rows",
            {"samples": float(samples), "columns": float(gram.columns), "rows": float(needed)},
        )


def _channels(record: IoData) -> Iterator[DataWarning]:
    for name, x in _named(record):
        constant = _constant_share(x)
        if constant > _CONSTANT_SHARE:
            yield DataWarning(
                "constant_channel",
                f"{record.label}: {name} is constant in {_percent(constant)} of the samples and "
                "carries no information: check the channel, or leave it out",
                {"share": constant},
            )
            continue
        mean, deviation = _mean_and_deviation(_look(x))
        if abs(mean) > _LARGEST_OFFSET * deviation:
            mean, deviation = _mean_and_deviation(x)
            yield DataWarning(
                "offset",
                f"{record.label}: {name} is almost all offset: remove its bias first "
                f"(mean {mean:.4g}, deviation {deviation:.2g})",
                {"mean": mean, "deviation": deviation},
            )
        dense = np.ascontiguousarray(x)
        limits = []
        for extreme, inward in ((float(dense.max()), -1.0), (float(dense.min()), 1.0)):
            share = _plateau_share(dense, extreme, inward)
            if share > 0.0:
                limits.append(extreme)
                yield DataWarning(
                    "saturation",
                    f"{record.label}: {name} reaches {extreme:.4g} and may be saturated: it stays "
                    f"there in {_percent(share)} of the samples; lower the drive or the gain",
                    {"level": extreme, "share": share},
                )
        yield from _dead_sensor(record, name, limits)


def _dead_sensor(record: IoData, name: str, limits: Sequence[float]) -> Iterator[DataWarning]:
    if name not in record.outputs:
        return
    channel = record.outputs.index(name)
    # A saturated signal is constant as well.
    dead = [
        rows
        for rows in dead_stretches(record, channel)
        if record.y[rows.start, channel] not in limits
    ]
    if not dead:
        return
    samples = sum(map(len, dead))
    longest = max(dead, key=len)
    stretches = counted(len(dead), "stretch", "stretches")
    yield DataWarning(
        "dead_sensor",
        f"{record.label}: {name} is dead in {_percent(samples / len(record))} of the samples, "
        f"{stretches}, the longest from row {longest.start} to {longest.stop - 1}: check the "
        "sensor, and leave those rows out",
        {
            "samples": float(samples),
            "share": samples / len(record),
            "stretches": float(len(dead)),
            "first_row": float(longest.start),
            "last_row": float(longest.stop - 1),
        },
    )


def _duplicates(record: IoData) -> Iterator[DataWarning]:
    channels = [(name, x) for name, x in _named(record) if _constant_share(x) <= _CONSTANT_SHARE]
    for (name, x), (other, y) in combinations(channels, 2):
        if abs(_correlation(_look(x), _look(y))) <= 1.0 - _ALMOST_SAME:
            continue
        correlation = _correlation(x, y)
        if abs(correlation) > 1.0 - _SAME:
            yield DataWarning(
                "duplicated_channel",
                f"{record.label}: {other} repeats {name} (correlation {correlation:+.7f}): check "
                "the wiring, or leave one out",
                {"correlation": correlation},
            )


def _bands(record: IoData) -> Iterator[DataWarning]:
    nyquist_hz = 0.5 / record.dt_s
    for name, u in zip(record.inputs, record.u.T, strict=True):
        if _constant_share(u) > _CONSTANT_SHARE:
            continue
        low_hz, high_hz, share = excited_band_hz(u, record.dt_s)
        if share < _EXCITED_SHARE or low_hz > _LOWEST_EXCITED * nyquist_hz:
            yield DataWarning(
                "excitation_band",
                f"{record.label}: {name} has power between {low_hz:.3g} and {high_hz:.3g} Hz only, "
                f"{_percent(share)} of the frequencies up to {nyquist_hz:.4g} Hz: modes outside "
                "are not to be trusted",
                {"low_hz": low_hz, "high_hz": high_hz, "share": share},
            )


def _named(record: IoData) -> list[tuple[str, FloatArray]]:
    names = (*record.outputs, *record.inputs)
    return list(zip(names, [*record.y.T, *record.u.T], strict=True))


def _look(x: FloatArray) -> FloatArray:
    """Return a few samples from all over a signal, which show a defect of the whole signal."""
    return x[:: max(1, len(x) // _LOOK)]


def _mean_and_deviation(x: FloatArray) -> tuple[float, float]:
    return float(x.mean()), float(x.std())


def _correlation(x: FloatArray, y: FloatArray) -> float:
    x, y = x - x.mean(), y - y.mean()
    power = float(x @ x) * float(y @ y)
    return float(x @ y) / np.sqrt(power) if power > 0.0 else 0.0


def _constant_share(x: FloatArray) -> float:
    """Return the share of equal samples, rounding apart; 0 if it is small."""
    some = _look(x)
    usual = np.median(some)
    near = _ROUNDING * abs(usual)
    if np.mean(np.abs(some - usual) <= near) < _CONSTANT_LOOK:
        return 0.0
    return float(np.mean(np.abs(x - usual) <= near))


def _plateau_share(x: FloatArray, extreme: float, inward: float) -> float:
    """Return the share of samples in which a signal is cut off at its extreme; mostly zero.

    A clipped signal runs into the plateau, and has far more samples there than at any level nearby.
    A signal of few levels, such as a square wave, cannot be judged.
    """
    on = x == extreme
    share = float(on.mean())
    if share < max(_PLATEAU_SHARE, _PLATEAU_SAMPLES / len(x)):
        return 0.0
    if len(np.unique(_look(x))) <= _FEW_LEVELS:
        return 0.0
    starts, stops = runs(on).T
    # A plateau from the first sample on may be a rest.
    plateaus = (stops - starts >= _PLATEAU_SAMPLES) & (starts > 1)
    if not plateaus.any():
        return 0.0
    steps = np.diff(x)
    entry = np.median(np.abs(steps[starts[plateaus] - 2]))
    if entry < _PLATEAU_SLOPE * np.sqrt(np.mean(steps**2)):
        return 0.0
    _, counts = np.unique(inward * x, return_counts=True)
    if counts[0] < _PLATEAU_COUNT * counts[1 : 1 + _NEIGHBOURS].max():
        return 0.0
    return float((stops - starts)[plateaus].sum() / len(x))


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
