"""Change of the plant or of the controller within a record, or from one record to another.

A record is cut into segments. Each is predicted one step ahead by a model of the other segments on
its side of a cut, and by a model of those on the other side. While nothing changes, the two models
are as good, and which is better is chance, from segment to segment. A change shows in the
logarithm of the ratio of both errors, whose mean over the segments exceeds zero by more than its
scatter allows.
Chow, "Tests of equality between sets of coefficients in two linear regressions", Econometrica 28
(1960); here with the scatter taken from the data, as the errors are neither white nor normal.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_core.errors import DataError
from flexarm_core.labels import instant
from flexarm_ident.diagnostics.check import Check, each_record
from flexarm_ident.diagnostics.excitation import is_stopped, moves_seldom
from flexarm_ident.records.data_warning import PLANT_CHANGED, Grade
from flexarm_ident.records.naming import short_names
from flexarm_ident.records.span import part_options, without
from flexarm_ident.subspace.feedback import SIGNIFICANCE, reaches_inputs
from flexarm_ident.subspace.gram import cut, segment_grams

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.diagnostics.check import Looked
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram, Segment

# Samples of the past. With fewer, the best predictor depends on how far a drifting output goes.
_MEMORY = 24
_SEGMENTS = 24
# Of each of several records.
_FEWEST_SEGMENTS = 8
# Ratio of the strongest drive to the weakest up to which records are compared.
_ALIKE = 3.0
# Cuts that are tried, as parts of the segments.
_CUTS = (0.25, 0.375, 0.5, 0.625, 0.75)
# The smallest change of the error that matters.
_SMALLEST_CHANGE = 0.1
# Records differ more than the parts of one where friction or the drive bend a linear model.
_SMALLEST_DIFFERENCE = 0.3
# Evidence of a change of the drive that makes the test of the plant void.
_DRIVE_SIGNIFICANCE = 0.01
# Deviation on one side in units of that on the other, below which an output has stopped moving.
_STOPPED = 0.1
# Samples of a side in units of the model's coefficients of one output.
_SAMPLES_PER_COEFFICIENT = 10
_SMALLEST_ERROR = 1e-12
# Weight of rounding in a regression on dependent signals.
_RIDGE = 1e-12


class _Change(NamedTuple):
    """Cut with the strongest evidence, the loss across it, and its probability by chance."""

    segment: int
    loss: float
    p_value: float

    @property
    def is_certain(self) -> bool:
        """Whether it is not by chance, and large enough to matter."""
        return self.p_value <= SIGNIFICANCE and self.loss >= _SMALLEST_CHANGE


def changes(record: IoData) -> Iterator[DataWarning]:
    """Yield the warnings that the plant, or the controller of a loop, changed within a record.

    A drive that changes by itself, such as a sweep, hides a change of the plant: a model is never
    as good at frequencies that it was not fitted to. So does one that was stopped.
    """
    if is_stopped(record):
        return
    signals = _with_reference(record)
    coefficients = _MEMORY * (len(signals.inputs) + len(signals.outputs))
    # Where the drive acts in a few places only, the segments are not alike.
    if len(record) < 4 * _SAMPLES_PER_COEFFICIENT * coefficients or moves_seldom(record):
        return
    try:
        parts = cut([signals], _MEMORY + 1, _SEGMENTS)
    except DataError:
        return
    if len(parts) < _SEGMENTS:
        return
    yield from _found(record, segment_grams([signals], _MEMORY + 1, parts), parts)


def differences(records: Sequence[IoData]) -> Iterator[DataWarning]:
    """Yield a warning where the plant of one of several records is not that of the others.

    Records whose drives are not alike are not compared, for the reason that `changes` has, nor are
    short ones. Parts of a record count as one.
    """
    keys = [record.part_of or id(record) for record in records]
    wholes = [list(dict.fromkeys(keys)).index(key) for key in keys]
    count = max(wholes) + 1
    lengths = np.bincount(wholes, [len(record) for record in records])
    coefficients = _MEMORY * (len(records[0].inputs) + len(records[0].outputs))
    is_short = lengths.min() < 2 * _SAMPLES_PER_COEFFICIENT * coefficients
    if count == 1 or is_short or any(map(is_stopped, records)) or any(map(moves_seldom, records)):
        return
    try:
        parts = cut(records, _MEMORY + 1, 2 * _FEWEST_SEGMENTS * count)
    except DataError:
        return
    of = np.array([wholes[part.record] for part in parts])
    if np.bincount(of, minlength=count).min() < _FEWEST_SEGMENTS or not _is_alike_driven(records):
        return
    grams = segment_grams([_centred(record) for record in records], _MEMORY + 1, parts)
    matrices, last = np.array([gram.matrix for gram in grams]), _MEMORY
    y, u = grams[0].output_rows, grams[0].input_rows
    drive = u(last, last + 1)
    closed = [bool(record.closed_loop) for record in records]
    before = y(last - 1, last + 1) + u(last - 1, last) if any(closed) else u(0, last)
    found = []
    for number in range(count):
        sides = of == number
        if _evidence(matrices, before, drive, sides)[1] < _DRIVE_SIGNIFICANCE:
            return
        loss, p_value = _evidence(matrices, y(0, last) + u(0, last), y(last, last + 1), sides)
        found.append(_Change(number, loss, min(1.0, count * p_value)))
    change = min(found, key=lambda each: each.p_value)
    if change.is_certain and change.loss >= _SMALLEST_DIFFERENCE:
        labels = [record.part_of or record.label for record in records]
        label = labels[wholes.index(change.segment)]
        name = short_names(labels)[label]
        if len(set(labels)) < count:
            name = f"record {change.segment + 1}"
        others = "the other record" if count == 2 else "the other records"  # noqa: PLR2004
        yield PLANT_CHANGED(
            f"the plant of {name} is not that of {others}: a model of one side predicts the other "
            f"{_worse(change.loss)} its own; identify each alone (--each), or those of the same "
            "arm and load together",
            {"loss": change.loss, "p_value": change.p_value},
        )


def _is_alike_driven(records: Sequence[IoData]) -> bool:
    """Return whether the inputs of all records are about as strong."""
    deviations = np.array([record.u.std(axis=0) for record in records])
    return bool(np.all(deviations.max(axis=0) <= _ALIKE * deviations.min(axis=0)))


def _centred(record: IoData) -> IoData:
    """Return a record without its means: an offset of a sensor does not make another plant."""
    return replace(
        record,
        u=record.u - record.u.mean(axis=0),
        y=record.y_usable - record.y[record.usable].mean(axis=0),
    )


def _found(
    record: IoData, grams: Sequence[BlockGram], parts: Sequence[Segment]
) -> Iterator[DataWarning]:
    """Yield the warnings, given the products of the segments; the set-point is the last output."""
    matrices, last = np.array([gram.matrix for gram in grams]), _MEMORY
    y, u = grams[0].output_rows, grams[0].input_rows
    present, drive = y(last, last + 1), u(last, last + 1)
    set_point = slice(len(record.outputs), None)
    if record.closed_loop:
        # A controller answers the last samples.
        law = _strongest(matrices, y(last - 1, last + 1) + u(last - 1, last), drive)
        if law.is_certain:
            yield _warning(record, "controller", law, parts)
        exogenous = [law]
        if present[set_point]:
            before = [row for shift in range(last) for row in y(shift, shift + 1)[set_point]]
            exogenous.append(_strongest(matrices, before, present[set_point]))
    else:
        exogenous = [_strongest(matrices, u(0, last), drive)]
    if min(each.p_value for each in exogenous) < _DRIVE_SIGNIFICANCE:
        return
    plant = _strongest(matrices, y(0, last) + u(0, last), present[: len(record.outputs)])
    if plant.is_certain:
        yield _warning(record, "plant", plant, parts)


def _with_reference(record: IoData) -> IoData:
    """Return a record with its set-point, if it is known, as a further output."""
    if record.reference is None or not np.ptp(record.reference, axis=0).any():
        return record
    set_points = record.reference.reshape(len(record), -1)
    return replace(
        record,
        y=np.column_stack([record.y_usable, set_points]),
        outputs=(*record.outputs, *(f"set-point {k + 1}" for k in range(set_points.shape[1]))),
        missing=None,
        input_held=None,
    )


def _warning(record: IoData, changed: str, found: _Change, parts: Sequence[Segment]) -> DataWarning:
    row = parts[found.segment].first
    return PLANT_CHANGED(
        f"the {changed} changes within the record, near {instant(row, record.dt_s)}: a model of "
        f"one side predicts the other {_worse(found.loss)} its own; {_remedy(record, row)}",
        {"row": float(row), "loss": found.loss, "p_value": found.p_value},
        grade=Grade.CAUTION if changed == "plant" else Grade.INFORMATION,
    )


def _remedy(record: IoData, row: int) -> str:
    """Return what to do, given the first row behind the change."""
    sides = [part.std(axis=0) for part in (record.y[:row], record.y[row:])]
    stopped = np.min(sides, axis=0) < _STOPPED * np.max(sides, axis=0)
    if not stopped.any() or stopped.all():
        cut_s = record.begins_s + row * record.dt_s
        before, after = part_options(0.0, cut_s), part_options(cut_s, None)
        return f"identify the parts separately ({before}, {after})"
    names = ", ".join(np.array(record.outputs)[stopped].tolist())
    # Where one output or more stood still.
    still = sides[0] < sides[1]
    rows = (0, row) if np.all(still[stopped]) else (row, len(record))
    option = without(record, [rows])
    return f"{names} hardly moves on one side: check the sensor, and leave that out ({option})"


def _worse(loss: float) -> str:
    return (
        f"{100.0 * loss:.0f} % worse than" if loss < 1.0 else f"{1.0 + loss:.0f} times as badly as"
    )


def _strongest(matrices: FloatArray, known: list[int], predicted: list[int]) -> _Change:
    """Return the cut across which the prediction of some rows from others loses most certainly."""
    count = len(matrices)
    tried = []
    for place in _CUTS:
        middle = round(place * count)
        loss, p_value = _evidence(matrices, known, predicted, np.arange(count) < middle)
        tried.append(_Change(middle, loss, min(1.0, len(_CUTS) * p_value)))
    return min(tried, key=lambda each: each.p_value)


def _evidence(
    matrices: FloatArray, known: list[int], predicted: list[int], sides: BoolArray
) -> tuple[float, float]:
    """Return the loss across two sides, of the row that shows most, and its chance."""
    loss = _losses(matrices, known, predicted, sides)
    # The models of the two sides lose differently: each side has its own mean.
    parts = loss[sides], loss[~sides]
    mean = np.mean([part.mean(axis=0) for part in parts], axis=0)
    variance = np.sum([part.var(axis=0, ddof=1) / len(part) for part in parts], axis=0)
    scatter = 0.5 * np.sqrt(variance)
    # Signals without a remainder lose nothing.
    p_values = scipy.special.stdtr(
        len(matrices) - 2, -mean / np.where(scatter > 0.0, scatter, np.inf)
    )
    row = int(np.argmin(p_values))
    return float(np.expm1(0.5 * mean[row])), min(1.0, float(len(predicted) * p_values[row]))


def _losses(
    matrices: FloatArray, known: list[int], predicted: list[int], sides: BoolArray
) -> FloatArray:
    """Return the logarithms of the error power by the other side's model over that by the own.

    There is one for each segment and each row that is predicted, (segments, predicted).
    """
    known_known, crossed = matrices[:, known][:, :, known], matrices[:, known][:, :, predicted]
    total = matrices[:, predicted, predicted]
    rounding = _SMALLEST_ERROR * total.mean(axis=0)
    rounding[rounding == 0.0] = 1.0
    # Per segment, the sums over its own side without itself, and over the other side.
    same = np.equal.outer(sides, sides)
    own = same & ~np.eye(len(sides), dtype=np.bool_)
    powers = []
    for chosen in (~same, own):
        weights = chosen.astype(np.float64)
        models = _models(np.tensordot(weights, known_known, 1), np.tensordot(weights, crossed, 1))
        explained = np.sum(models * (2.0 * crossed - known_known @ models), axis=1)
        powers.append(np.maximum(total - explained, rounding))
    return np.asarray(np.log(powers[0] / powers[1]))


def _models(known: FloatArray, crossed: FloatArray) -> FloatArray:
    """Return the coefficients of predictions, (segments, known, predicted)."""
    scale = np.sqrt(np.diagonal(known, axis1=1, axis2=2))
    scale = np.where(scale > 0.0, scale, 1.0)
    unit = known / (scale[:, :, np.newaxis] * scale[:, np.newaxis])
    unit += _RIDGE * np.eye(known.shape[1])
    scale = scale[..., np.newaxis]
    return np.asarray(np.linalg.solve(unit, crossed / scale) / scale)


def _judged(data: Looked) -> Looked:
    """Return the data with loops that no record declares as the choice of a method judges them."""
    if all(each.closed_loop is not None for each in data.records):
        return data
    reached = reaches_inputs(data.gram)
    judged = [
        replace(each, closed_loop=reached) if each.closed_loop is None else each
        for each in data.records
    ]
    return replace(data, records=tuple(judged))


def _within_and_between(data: Looked) -> Iterator[DataWarning]:
    judged = _judged(data)
    yield from each_record(changes)(judged)
    yield from differences(judged.records)


CHECKS = (Check(_within_and_between, (PLANT_CHANGED,)),)
