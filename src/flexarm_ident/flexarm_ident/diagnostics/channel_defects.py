"""Defects of single channels: constant, all offset, saturated, dead, duplicated, with holes."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.arrays import runs
from flexarm_core.labels import counted, instant
from flexarm_ident.diagnostics.check import Check, each_record, each_whole
from flexarm_ident.records.data_warning import LOST_SAMPLES, Grade, Kind
from flexarm_ident.records.holes import holes_text
from flexarm_ident.records.signals import (
    CONSTANT_SHARE,
    FEW_LEVELS,
    ROUNDING,
    constant_share,
    dead_stretches,
    look,
)
from flexarm_ident.records.span import without

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

LARGEST_OFFSET = 10.0
"""Mean in units of the deviation above which a channel counts as almost all offset."""
_SAME, _ALMOST_SAME = 1e-6, 1e-4
_PLATEAU_SHARE = 1e-3
_PLATEAU_SAMPLES = 3
_PLATEAU_COUNT = 5.0
_PLATEAU_SLOPE = 0.05
_NEIGHBOURS = 3
# Part by which the steps of times may differ.
_JITTER = 0.5
# Length of a plateau in rests at other turns up to which it is a rest itself, and the least number
# of such rests for each.
_LONGER, _MORE = 1.5, 2
# Separate blows, as of a hammer, that make a record of an input which is otherwise at rest.
_BLOWS = 3


def constant_channels(record: IoData) -> Iterator[DataWarning]:
    """Yield the channels that are constant, and the inputs that count."""
    for name, x in _named(record):
        constant = constant_share(x)
        if not np.any(x):
            # As a rig without that sensor has it, whose other channels are as good.
            yield _CONSTANT(
                f"{name} is 0 in every sample: leave it out where it has no sensor, else check it",
                {"share": constant},
                channel=name,
            )
        elif constant > CONSTANT_SHARE:
            yield from _rest(record, name, x, constant)
        elif _counts(x, _JITTER if name in record.inputs else ROUNDING):
            instead = "take the column of the input" if name in record.inputs else "leave it out"
            yield _CONSTANT(
                f"{name} goes on by nearly the same step in every sample, as a time or a counter "
                f"of samples does: {instead}",
                {"step": float(np.median(np.diff(x)))},
                grade=Grade.DO_NOT_USE,
                channel=name,
            )


def limited_channels(record: IoData) -> Iterator[DataWarning]:
    """Yield the channels that are cut off at an extreme."""
    for name, x in _named(record):
        for extreme, share in _limits(x):
            yield _SATURATION(
                f"{name} reaches {extreme:.4g} and may be saturated: it stays there in "
                f"{_percent(share)} of the samples; reduce the excitation amplitude or the gain",
                {"level": extreme, "share": share},
                channel=name,
            )


def dead_sensors(record: IoData) -> Iterator[DataWarning]:
    """Yield the outputs that stand still for a stretch while others move."""
    for channel, (name, x) in enumerate(zip(record.outputs, record.y.T, strict=True)):
        if constant_share(x) > CONSTANT_SHARE:
            continue
        found = dead_stretches(record, channel)
        # A saturated signal is constant as well.
        limits = [extreme for extreme, _ in _limits(x)] if found else []
        dead = [rows for rows in found if x[rows.start] not in limits]
        if dead:
            yield _dead_sensor(record, name, dead)


def offsets(records: Sequence[IoData]) -> Iterator[DataWarning]:
    """Yield the channels that are almost all offset in a whole record, given in its parts.

    A signal that wanders stays near one value in a part of a second or two.
    """
    for parts in zip(*map(_named, records), strict=True):
        name, x = parts[0][0], np.concatenate([values for _, values in parts])
        if constant_share(x) > CONSTANT_SHARE:
            continue
        mean, deviation = _mean_and_deviation(look(x))
        if abs(mean) > LARGEST_OFFSET * deviation:
            mean, deviation = _mean_and_deviation(x)
            remedy = (
                "remove its bias (--bias mean)"
                if name in records[0].outputs
                else "subtract its mean where the outputs keep their level under it"
            )
            yield _OFFSET(
                f"{name} is almost all offset (mean {mean:.4g}, deviation {deviation:.2g}): "
                f"{remedy}",
                {"mean": mean, "deviation": deviation},
                channel=name,
            )


def _rest(record: IoData, name: str, x: FloatArray, constant: float) -> Iterator[DataWarning]:
    """Yield what is wrong with a channel that is constant in nearly all samples."""
    usual = np.median(x)
    blows = len(runs(np.abs(x - usual) > ROUNDING * abs(usual)))
    if name not in record.inputs or not blows:
        yield _CONSTANT(
            f"{name} is constant in {_percent(constant)} of the samples and carries no "
            "information: check the channel, or leave it out",
            {"share": constant},
            grade=Grade.DO_NOT_USE,
            channel=name,
        )
    elif blows < _BLOWS:
        yield _CONSTANT(
            f"{name} is constant in {_percent(constant)} of the samples and leaves that value in "
            f"{counted(blows, 'place')}: check the channel, or excite throughout",
            {"share": constant},
            channel=name,
        )


def _dead_sensor(record: IoData, name: str, dead: Sequence[range]) -> DataWarning:
    samples = sum(map(len, dead))
    longest = max(dead, key=len)
    stretches = counted(len(dead), "stretch", "stretches")
    return _DEAD(
        f"{name} is dead in {_percent(samples / len(record))} of the samples, {stretches}, the "
        f"longest from {instant(longest.start, record.dt_s)} to "
        f"{instant(longest.stop - 1, record.dt_s)}: check the sensor, and leave those rows out "
        f"({without(record, ((rows.start, rows.stop) for rows in dead))})",
        {
            "samples": float(samples),
            "share": samples / len(record),
            "stretches": float(len(dead)),
            "first_row": float(longest.start),
            "last_row": float(longest.stop - 1),
        },
        channel=name,
    )


def _counts(x: FloatArray, jitter: float) -> bool:
    """Return whether nearly all steps of a signal are its usual one within a part, and not zero."""
    with np.errstate(over="ignore"):
        steps = np.diff(x)
    usual = float(np.median(steps))
    if usual == 0.0 or not np.isfinite(usual):
        return False
    return float(np.mean(np.abs(steps / usual - 1.0) <= jitter)) > CONSTANT_SHARE


def unmeasured(record: IoData) -> Iterator[DataWarning]:
    """Yield the outputs that lack more samples than the recording lost in all channels."""
    if record.missing is None:
        return
    lost = sum(each.figures.get("missing", 0.0) for each in record.notices)
    alike: dict[bytes, list[str]] = {}
    for name, missing in zip(record.outputs, record.missing.T, strict=True):
        if missing.sum() > lost:
            alike.setdefault(missing.tobytes(), []).append(name)
    for names in alike.values():
        missing = record.missing[:, record.outputs.index(names[0])]
        text, figures = holes_text(missing, record.dt_s)
        channel = names[0] if len(names) == 1 else ""
        yield LOST_SAMPLES(f"{', '.join(names)}: {text}", figures, channel=channel)


def duplicates(record: IoData) -> Iterator[DataWarning]:
    """Yield the channels that repeat another one."""
    channels = [(name, x) for name, x in _named(record) if constant_share(x) <= CONSTANT_SHARE]
    for (name, x), (other, y) in combinations(channels, 2):
        # A proportional law makes its command a multiple of an output, but hardly the same numbers.
        of_a_law = record.closed_loop and other in record.inputs and name in record.outputs
        if of_a_law and not np.array_equal(x, y):
            continue
        if abs(_correlation(look(x), look(y))) <= 1.0 - _ALMOST_SAME:
            continue
        correlation = _correlation(x, y)
        if abs(correlation) > 1.0 - _SAME:
            yield _DUPLICATE(
                f"{other} repeats {name} (correlation {correlation:+.7f}): check the wiring, or "
                "leave one out",
                {"correlation": correlation},
                channel=other,
            )


def _named(record: IoData) -> list[tuple[str, FloatArray]]:
    names = (*record.outputs, *record.inputs)
    return list(zip(names, [*record.y.T, *record.u.T], strict=True))


def _mean_and_deviation(x: FloatArray) -> tuple[float, float]:
    return float(x.mean()), float(x.std())


def _correlation(x: FloatArray, y: FloatArray) -> float:
    x, y = x - x.mean(), y - y.mean()
    power = float(x @ x) * float(y @ y)
    return float(x @ y) / np.sqrt(power) if power > 0.0 else 0.0


def _limits(x: FloatArray) -> list[tuple[float, float]]:
    """Return the extremes at which a signal is cut off, and the share of the samples there."""
    if constant_share(x) > CONSTANT_SHARE:
        return []
    dense = np.ascontiguousarray(x)
    ends = ((float(dense.max()), -1.0), (float(dense.min()), 1.0))
    found = [(extreme, _plateau_share(dense, extreme, inward)) for extreme, inward in ends]
    return [(extreme, share) for extreme, share in found if share > 0.0]


def _plateau_share(x: FloatArray, extreme: float, inward: float) -> float:
    """Return the share of samples in which a signal is cut off at its extreme; mostly zero.

    A clipped signal runs into the plateau, and has far more samples there than at any level nearby.
    One with dry friction rests wherever it turns, so it stays no longer there than at its other
    turns. A signal of few levels, such as a square wave, cannot be judged.
    """
    on = x == extreme
    share = float(on.mean())
    if share < max(_PLATEAU_SHARE, _PLATEAU_SAMPLES / len(x)):
        return 0.0
    if len(np.unique(look(x))) <= FEW_LEVELS:
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
    lengths = (stops - starts)[plateaus]
    is_frequent = counts[0] >= _PLATEAU_COUNT * counts[1 : 1 + _NEIGHBOURS].max()
    if not is_frequent or _are_rests(lengths, _rests_at_turns(x, extreme, inward)):
        return 0.0
    return float(lengths.sum() / len(x))


def _are_rests(lengths: NDArray[np.intp], rests: NDArray[np.intp]) -> bool:
    """Return whether plateaus are rests themselves: rare and no longer than those elsewhere."""
    is_rare = len(rests) > _MORE * len(lengths)
    return bool(is_rare and np.median(lengths) <= _LONGER * np.median(rests))


def _rests_at_turns(x: FloatArray, extreme: float, inward: float) -> NDArray[np.intp]:
    """Return the lengths of the rests, in samples, at the turns that do not reach an extreme."""
    starts = np.flatnonzero(np.concatenate([[True], x[1:] != x[:-1]]))
    lengths, levels = np.diff(np.append(starts, len(x))), inward * x[starts]
    steps = np.sign(np.diff(levels))
    turns = 1 + np.flatnonzero((steps[:-1] < 0.0) & (steps[1:] > 0.0))
    rests = lengths[turns[levels[turns] > inward * extreme]]
    return np.asarray(rests[rests >= _PLATEAU_SAMPLES])


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"


_CONSTANT = Kind(
    "constant_channel",
    "Constant channel",
    "more than 99 % of the samples are one value, but for an input at rest between three blows "
    "or more; an input goes on by the same step within a half in 99 % of them, as a time or a "
    "counter does, an output by exactly the same",
    "check the wire, or leave it out; take the column of the input",
)
_SATURATION = Kind(
    "saturation",
    "Saturation",
    "0.1 % of the samples at an extreme that the signal runs into, in stretches of 3 or more",
    "a smaller excitation amplitude or gain",
)
_DEAD = Kind(
    "dead_sensor",
    "Dead sensor",
    "a continuous output keeps one value for over 20 samples while others move",
    "check the sensor, leave the rows out (`--from`, `--to`)",
)
_DUPLICATE = Kind(
    "duplicated_channel",
    "Duplicated channel",
    "two channels correlate within 1e-6 of 1",
    "check the wiring, or leave one out",
)
_OFFSET = Kind(
    "offset",
    "Offset",
    "mean above ten standard deviations of the whole record",
    "remove the bias (`preprocess`, `--bias mean`)",
)
CHECKS = (
    Check(each_record(constant_channels), (_CONSTANT,)),
    Check(each_record(limited_channels), (_SATURATION,)),
    Check(each_record(dead_sensors), (_DEAD,)),
    Check(each_record(unmeasured), (LOST_SAMPLES,)),
    Check(each_record(duplicates), (_DUPLICATE,)),
    Check(each_whole(offsets), (_OFFSET,)),
)
