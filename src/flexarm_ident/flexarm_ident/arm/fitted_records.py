"""Records as the fit of an arm takes them: smoothed, at a lower rate, weighted by their power."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.arm.equations import FlexibleArm
from flexarm_ident.arm.simulation_error import Part, SimulationError
from flexarm_ident.friction.layout import drive_columns
from flexarm_ident.records.signals import smoothed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.friction.layout import Drive
    from flexarm_ident.records.iodata import IoData

# Samples per period of the highest frequency, and the anti-alias cut-off by the new rate.
_SAMPLES_PER_PERIOD = 10.0
_ANTI_ALIAS = 0.3
_ZERO_ERROR = 0.01
COST_OF_ZERO_ERROR = 0.05
"""Error of one output that costs as much as a zero error of the input of 1 % of its peak."""
# Samples of all records together at the lower rate; more would take minutes for little more.
_MOST_SAMPLES = 3000


def simulation_error(
    records: Sequence[IoData],
    lives: Sequence[FloatArray],
    drives: Sequence[Drive],
    band_hz: float,
) -> SimulationError:
    """Return the simulation error of an arm over the leading parts of records.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    lives : sequence of ndarray, (samples, outputs)
        Where the sensors of each work, 1, and where they do not, 0.
    drives : sequence of Drive
        The position that each input drives.
    band_hz : float
        Frequency below which the outputs' power lies.

    Raises
    ------
    IdentificationError
        If not every input drives one position.
    """
    positions = _positions(records[0], drives)
    dt_s = records[0].dt_s
    decimation = max(1, int(1.0 / (dt_s * _SAMPLES_PER_PERIOD * max(band_hz, 1e-9))))
    decimation = min(decimation, max(1, min(len(record) for record in records) // 100))
    most = -(-_MOST_SAMPLES * decimation // len(records))
    heads = [record.head(most) for record in records]
    return _of_heads(heads, [live[:most] for live in lives], positions, decimation)


def _positions(record: IoData, drives: Sequence[Drive]) -> tuple[int, ...]:
    outputs = dict(drive_columns(record, drive) for drive in drives)
    missing = [name for i, name in enumerate(record.inputs) if i not in outputs]
    if missing or any(drive.is_speed for drive in drives) or len(outputs) != len(drives):
        raise IdentificationError(
            f"{record.label}: a model with friction needs one position for every input, "
            f"{', '.join(missing) or 'a drive'} has none"
        )
    return tuple(outputs[i] for i in range(len(record.inputs)))


def _of_heads(
    records: Sequence[IoData],
    lives: Sequence[FloatArray],
    positions: tuple[int, ...],
    decimation: int,
) -> SimulationError:
    dt_s = records[0].dt_s * decimation
    cutoff_hz = _ANTI_ALIAS / dt_s if decimation > 1 else np.inf
    outputs = records[0].y.shape[1]
    power = np.sum(
        [np.sum(live * record.y**2, axis=0) for live, record in zip(lives, records, strict=True)],
        axis=0,
    )
    scale = np.sqrt(np.divide(decimation, power, out=np.zeros_like(power), where=power > 0.0))
    peak = np.max([np.abs(record.u).max(axis=0) for record in records], axis=0)
    smooth = [
        (smoothed(record.u, cutoff_hz, record.dt_s), smoothed(record.y, cutoff_hz, record.dt_s))
        for record in records
    ]
    arm = FlexibleArm(positions, _signs(smooth, positions, records[0].dt_s), outputs)
    step = slice(None, None, decimation)
    parts = tuple(
        Part(
            _held(u, decimation),
            _held(np.abs(record.u), decimation),
            y[step],
            live[step] * scale,
        )
        for record, (u, y), live in zip(records, smooth, lives, strict=True)
    )
    return SimulationError(arm, parts, dt_s, COST_OF_ZERO_ERROR / (_ZERO_ERROR * peak))


def _held(u: FloatArray, decimation: int) -> FloatArray:
    """Return the mean input from each kept sample to the next."""
    starts = np.arange(0, len(u), decimation)
    lengths = np.diff(np.append(starts, len(u)))
    return np.asarray(np.add.reduceat(u, starts, axis=0) / lengths[:, np.newaxis])


def _signs(
    smooth: Sequence[tuple[FloatArray, FloatArray]], positions: tuple[int, ...], dt_s: float
) -> tuple[float, ...]:
    power = np.zeros(len(positions))
    for u, y in smooth:
        # Mean power: an input that drives its position supplies more energy than it takes out.
        power += np.sum(u * np.gradient(y[:, list(positions)], dt_s, axis=0), axis=0)
    return tuple(float(sign) for sign in np.where(power < 0.0, -1.0, 1.0))
