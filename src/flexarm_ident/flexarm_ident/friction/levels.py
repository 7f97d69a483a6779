"""Coulomb friction levels from records without a compensation signal.

Section 2.4.3 of the thesis subtracts a recorded compensation signal from the input. Without one the
record still shows friction: where a drive slips, friction is a constant against the motion, so the
level is one more coefficient of a linear regression of the input.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_core.errors import IdentificationError
from flexarm_ident.friction.layout import SMOOTHING, drive_columns
from flexarm_ident.records.iodata import as_records
from flexarm_ident.records.signals import bandwidth_hz, smoothed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.records.iodata import IoData

_SLIPPING = 0.05
_RESAMPLES = 200
_FEWEST_BLOCKS, _MOST_BLOCKS = 10, 1000
SIGNIFICANT = 3.0
"""Level in units of its standard deviation above which there is friction."""
# A friction that is held from sample to sample cost up to 1.4 % in simulation.
SYSTEMATIC = 0.015
"""Part of a level that its deviation has beside its random part."""
_RELEVANT = 0.05


@dataclass(frozen=True, eq=False)
class CoulombEstimate:
    """Coulomb friction of each drive by regression over its slipping samples.

    Attributes
    ----------
    drives : tuple of Drive
        The drives.
    levels, deviations : ndarray, (drives,)
        Level and its standard deviation by block bootstrap, in units of the input.
    offsets : ndarray, (drives,)
        Constant part of the input without motion.
    samples : tuple of int
        Number of slipping samples.
    significant : tuple of bool
        Whether the level is above three standard deviations and 5 % of the RMS input of the drive.
        A lower level does not bias a linear model.
    """

    drives: tuple[Drive, ...]
    levels: FloatArray
    deviations: FloatArray
    offsets: FloatArray
    samples: tuple[int, ...]
    significant: tuple[bool, ...]

    @property
    def possible(self) -> bool:
        """Whether any level is above its standard deviation."""
        return bool(np.any(self.levels > self.deviations))

    @property
    def present(self) -> bool:
        """Whether the friction of any drive is significant."""
        return any(self.significant)


def estimate_coulomb(data: IoData | Sequence[IoData], drives: Sequence[Drive]) -> CoulombEstimate:
    """Estimate Coulomb friction levels jointly with a linear model of the load.

    Where a drive moves faster than 5 % of its peak speed, its input is regressed on the
    accelerations of all drives, its own speed, the other outputs, the direction of motion and a
    constant. Speeds and accelerations are differences of outputs smoothed without lag at three
    times their bandwidth.

    Parameters
    ----------
    data : IoData or sequence of IoData
        Records without compensation in the input.
    drives : sequence of Drive
        The output whose motion the friction at each input opposes.

    Returns
    -------
    CoulombEstimate
        Levels with their standard deviations.

    Raises
    ------
    IdentificationError
        If a drive names channels the records lack, or hardly ever slips.
    """
    records = as_records(data)
    columns = [drive_columns(records[0], drive) for drive in drives]
    parts = [_motion(record, drives, columns) for record in records]
    rng = np.random.default_rng(0)
    levels, deviations, offsets, samples, significant = [], [], [], [], []
    for i, drive in enumerate(drives):
        rows = [_slipping_rows(part, i, columns[i][0]) for part in parts]
        regressors = np.vstack([left for left, _ in rows])
        effort = np.concatenate([right for _, right in rows])
        block = max(1, round(0.5 / (bandwidth_hz(records) * records[0].dt_s)))
        if len(effort) < 2 * regressors.shape[1] or len(effort) < block:
            raise IdentificationError(
                f"{records[0].label}: {drive.output} slips in {len(effort)} samples only, too few "
                "for its friction: record longer moves"
            )
        solution = np.linalg.lstsq(regressors, effort, rcond=None)[0]
        scatter = _bootstrap(regressors, effort, block, rng)
        levels.append(solution[0])
        offsets.append(solution[1])
        deviations.append(scatter)
        samples.append(len(effort))
        floor = max(SIGNIFICANT * scatter, _RELEVANT * float(np.sqrt(np.mean(effort**2))))
        significant.append(bool(solution[0] > floor))
    return CoulombEstimate(
        tuple(drives),
        np.array(levels),
        np.array(deviations),
        np.array(offsets),
        tuple(samples),
        tuple(significant),
    )


def net_record(record: IoData, estimate: CoulombEstimate) -> IoData:
    """Return a record whose inputs lack the friction of an estimate, as far as motion shows it.

    It is the level against the direction of motion, and a part of it where a drive does not slip.
    """
    columns = [drive_columns(record, drive) for drive in estimate.drives]
    speed = _motion(record, estimate.drives, columns).speed
    direction = np.clip(speed / (_SLIPPING * np.abs(speed).max(axis=0)), -1.0, 1.0)
    u = record.u.copy()
    u[:, [given for given, _ in columns]] -= estimate.levels * direction
    return replace(record, u=u)


class _Motion(NamedTuple):
    """Smoothed inputs, speeds and accelerations of the drives, and the other outputs.

    `usable` excludes rows whose smoothed values depend on holes.
    """

    u: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    others: FloatArray
    usable: BoolArray


def _motion(record: IoData, drives: Sequence[Drive], columns: Sequence[tuple[int, int]]) -> _Motion:
    cutoff_hz = SMOOTHING * bandwidth_hz([record])
    y = smoothed(record.y, cutoff_hz, record.dt_s)
    u = smoothed(record.u, cutoff_hz, record.dt_s)
    driven = [output for _, output in columns]
    speed = y[:, driven].copy()
    for i, drive in enumerate(drives):
        if not drive.is_speed:
            speed[:, i] = np.gradient(speed[:, i], record.dt_s)
    acceleration = np.gradient(speed, record.dt_s, axis=0)
    reach = round(1.0 / (cutoff_hz * record.dt_s))
    usable = scipy.ndimage.binary_erosion(record.usable, iterations=reach, border_value=1)
    return _Motion(u, speed, acceleration, np.delete(y, driven, axis=1), usable)


def _slipping_rows(motion: _Motion, drive: int, column: int) -> tuple[FloatArray, FloatArray]:
    """Return regressors, direction and constant first, and effort of the slipping samples."""
    v = motion.speed[:, drive]
    slips = motion.usable & (np.abs(v) > _SLIPPING * np.abs(v).max())
    terms = [np.sign(v), np.ones(len(v)), v, *motion.acceleration.T, *motion.others.T]
    return np.stack(terms, axis=1)[slips], motion.u[slips, column]


def _bootstrap(
    regressors: FloatArray, effort: FloatArray, block: int, rng: np.random.Generator
) -> float:
    """Return the standard deviation of the first coefficient under resampling of whole blocks."""
    length = np.linalg.norm(regressors, axis=0)
    length[length == 0.0] = 1.0
    rows = np.column_stack([regressors / length, effort])
    count = min(max(len(rows) // block, _FEWEST_BLOCKS), _MOST_BLOCKS)
    products = np.array([part.T @ part for part in np.array_split(rows, count)])
    levels = []
    for _ in range(_RESAMPLES):
        total = products[rng.integers(count, size=count)].sum(axis=0)
        levels.append(np.linalg.lstsq(total[:-1, :-1], total[:-1, -1], rcond=None)[0][0])
    return float(np.std(levels) / length[0])
