"""Roles of the channels of a flexible arm: driven positions and their inputs.

They follow from the signals, not from names. A driven position holds its place, so it moves slowly
for its amplitude, while elastic coordinates swing back. Each input accelerates its own position.
The inverse of joint masses is positive definite: among all assignments of inputs to positions, the
right one has the largest product of accelerations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_core.errors import IdentificationError
from flexarm_ident.records.signals import bandwidth_hz, smoothed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.iodata import IoData

# RMS speed over RMS deviation of the fastest position, as a part of that of the slowest other.
_SLOW = 0.5
# Correlation of an input with the speed of its position, at least.
_WORK = 0.1
# An output that follows a position's speed as closely as this is a speed sensor, and one that
# follows the position shows the same motion.
_SAME = 0.8
SMOOTHING = 3.0
"""Cut-off before signals are differentiated, as a multiple of the outputs' bandwidth."""


class Drive(NamedTuple):
    """Input and the output whose motion its friction opposes.

    Attributes
    ----------
    input : str
        Name of the input.
    output : str
        Name of the position it drives, or of the speed.
    is_speed : bool
        Whether `output` is a speed.
    """

    input: str
    output: str
    is_speed: bool = False


class ArmLayout(NamedTuple):
    """Roles of the channels of a flexible arm.

    Attributes
    ----------
    drives : tuple of Drive
        The position of each input, in the order of the inputs.
    speeds : tuple of Drive
        The same drives by outputs that measure the speeds, for those that have one.
    """

    drives: tuple[Drive, ...]
    speeds: tuple[Drive, ...]

    @property
    def slipping(self) -> tuple[Drive, ...]:
        """The drives by measured speeds where there are any, else by positions."""
        measured = {drive.input: drive for drive in self.speeds}
        return tuple(measured.get(drive.input, drive) for drive in self.drives)


def arm_layout(records: Sequence[IoData]) -> ArmLayout | None:
    """Assign a position to each input, or return None for data unlike a flexible arm.

    There must be as many positions as inputs and at least one output more. The slowest outputs, by
    RMS speed over RMS deviation, must move at most half as fast as any other. Inputs are paired
    with the positions that they accelerate; an input does work on its position, so that it is
    correlated with the speed, by 0.1 at least.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    """
    found = _assigned(records)
    return found[0] if found is not None and found[1] else None


def joints(records: Sequence[IoData]) -> tuple[Drive, ...] | None:
    """Return the output that measures each input's joint, the slowest that its input works on.

    It need not be slower than the others, as in `arm_layout`: gyroscopes and accelerometers may be
    among them, and joints of different pace. Of several outputs that tell one motion, as hub and
    tip do, it is the one that its input works on most. A joint that turns freely takes little work,
    so that none is asked for. None where there is no output more than inputs.
    """
    found = _assigned(records)
    return None if found is None else found[0].drives


def _assigned(records: Sequence[IoData]) -> tuple[ArmLayout, bool] | None:
    """Return the roles of the slowest outputs, and whether the others are much faster."""
    first = records[0]
    count, outputs = len(first.inputs), len(first.outputs)
    if outputs <= count:
        return None
    parts = [_smoothed_motion(record) for record in records]
    u, y, speed, acceleration = map(np.concatenate, zip(*parts, strict=True))
    size, pace = y.std(axis=0), np.sqrt(np.mean(speed**2, axis=0))
    if np.any(size == 0.0) or np.any(u.std(axis=0) == 0.0):
        return None
    work = np.abs(_correlation(u, speed))
    by_pace = _collocated(np.argsort(pace / size, kind="stable"), work, y)
    slowest_other = (pace / size)[by_pace[count]]
    positions = np.sort(by_pace[:count])
    apart = bool(np.max((pace / size)[positions]) <= _SLOW * slowest_other)
    # Beside what links and dampers do to the positions.
    causes = np.hstack([u, y[:, by_pace[count:]], speed[:, positions]])
    scale = causes.std(axis=0)
    answer = np.linalg.lstsq(causes / scale, acceleration[:, positions], rcond=None)[0][:count]
    answer = np.abs(answer)
    cost = -np.log(np.maximum(answer / answer.max(), np.finfo(float).tiny))
    inputs, own = scipy.optimize.linear_sum_assignment(cost)
    apart = apart and bool(np.min(work[inputs, positions[own]]) >= _WORK)
    drives = tuple(
        Drive(first.inputs[i], first.outputs[positions[j]])
        for i, j in zip(inputs, own, strict=True)
    )
    others = np.sort(by_pace[count:])
    same = np.abs(_correlation(speed[:, positions[own]], y[:, others]))
    speeds = tuple(
        Drive(first.inputs[i], first.outputs[others[k]], is_speed=True)
        for i, row in zip(inputs, same, strict=True)
        for k in [int(np.argmax(row))]
        if row[k] >= _SAME
    )
    return ArmLayout(drives, speeds), apart


def _collocated(by_pace: NDArray[np.intp], work: FloatArray, y: FloatArray) -> NDArray[np.intp]:
    """Return the outputs with those in front that the inputs work on, of several for one motion.

    The tip of an arm moves as its hub does, and the hub alone shows where friction acts.
    """
    count, order, most = len(work), by_pace.copy(), work.max(axis=0)
    together = np.abs(_correlation(y, y)) >= _SAME
    for slot in range(count):
        others = [k for k in range(count, len(order)) if together[order[slot], order[k]]]
        best = max((slot, *others), key=lambda k: most[order[k]])
        order[[slot, best]] = order[[best, slot]]
    return order


def drive_columns(record: IoData, drive: Drive) -> tuple[int, int]:
    """Return the columns of a drive's input and output.

    Raises
    ------
    IdentificationError
        If the record has no such channel.
    """
    for name, names in ((drive.input, record.inputs), (drive.output, record.outputs)):
        if name not in names:
            raise IdentificationError(
                f"{record.label}: no channel {name!r} for the friction, there are "
                f"{', '.join(names)}"
            )
    return record.inputs.index(drive.input), record.outputs.index(drive.output)


def _smoothed_motion(record: IoData) -> tuple[FloatArray, ...]:
    """Return inputs, outputs, and the outputs' speeds and accelerations."""
    cutoff_hz = SMOOTHING * bandwidth_hz([record])
    y = smoothed(record.y, cutoff_hz, record.dt_s)
    speed = np.asarray(np.gradient(y, record.dt_s, axis=0))
    u = smoothed(record.u, cutoff_hz, record.dt_s)
    return u - u.mean(axis=0), y - y.mean(axis=0), speed, np.gradient(speed, record.dt_s, axis=0)


def _correlation(left: FloatArray, right: FloatArray) -> FloatArray:
    left, right = left - left.mean(axis=0), right - right.mean(axis=0)
    scale = np.outer(np.linalg.norm(left, axis=0), np.linalg.norm(right, axis=0))
    product = left.T @ right
    return np.asarray(np.divide(product, scale, out=np.zeros_like(product), where=scale > 0.0))
