"""Records that need not fit into memory: leading parts, biases, validation in chunks."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.validation import Dmv, mean_error
from flexarm_ident.models.free_run import BlockSimulation
from flexarm_ident.records.iodata import IoData
from flexarm_ident.records.magnitude import check_magnitude
from flexarm_ident.records.preprocess import ZERO_MEAN_OUTPUTS, preprocess

if TYPE_CHECKING:
    from collections.abc import Iterator

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.source import Source

EXCERPT_SAMPLES = 65_536
"""Samples of a record that are held in memory."""
_CHUNK = 16_384


class Part:
    """Leading samples of a source, with a constant subtracted from each output.

    Parameters
    ----------
    source : Source
        The source, whose names, period and notices stay.
    samples : int
        Number of samples, at most that of the source.
    bias : ndarray, (outputs,)
        Constants to subtract.
    """

    def __init__(self, source: Source, samples: int, bias: FloatArray) -> None:
        self.source, self.samples, self.bias = source, samples, bias
        self.inputs, self.outputs = source.inputs, source.outputs
        self.dt_s, self.label = source.dt_s, source.label
        self.closed_loop, self.notices = source.closed_loop, source.notices
        self.whole_samples = source.whole_samples

    def __len__(self) -> int:
        return self.samples

    def head(self, samples: int) -> IoData:
        """Return the first `samples` samples as a record in memory."""
        first = self.source.head(min(samples, self.samples))
        return replace(first, y=first.y - self.bias)

    def chunks(self, samples: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Return u and y from the start, `samples` rows each, as `Samples.chunks` says."""
        left = self.samples
        for u, y in self.source.chunks(samples):
            yield u[:left], y[:left] - self.bias
            left -= len(u)
            if left <= 0:
                return


def leading(source: Source, samples: int) -> Part:
    """Return the first `samples` samples of a source, or all if there are fewer."""
    return Part(source, min(samples, len(source)), np.zeros(len(source.outputs)))


def excerpt(source: Source) -> IoData:
    """Return the first samples of a source as a record in memory; a record itself is unchanged."""
    return source if isinstance(source, IoData) else source.head(EXCERPT_SAMPLES)


def without_bias(source: Source) -> Part:
    """Remove the outputs' biases from a source as `preprocess` does by default (section 2.5).

    The inputs must not contain Coulomb compensation.
    """
    first = excerpt(source)
    check_magnitude(first)
    prepared = preprocess(first, zero_mean=())
    bias = first.y[0] - prepared.y[0]
    # An offset of an input stays.
    notices = [
        each for each in prepared.notices[len(first.notices) :] if each.channel in source.outputs
    ]
    total, count = np.zeros(len(source.outputs)), 0
    for _, y in source.chunks(_CHUNK):
        total += np.nansum(y, axis=0)
        count += int(np.count_nonzero(~np.isnan(y[:, 0])))
    gauges = np.isin(source.outputs, ZERO_MEAN_OUTPUTS)
    part = Part(source, len(source), np.where(gauges, total / max(count, 1), bias))
    part.notices = (*source.notices, *notices)
    return part


def validate_stream(model: control.StateSpace, record: Source, x0: FloatArray) -> Dmv:
    """Compare measured outputs with a free simulation in chunks, as `validate_dmv` does.

    The simulation starts from x0, (states,). Its first `EXCERPT_SAMPLES` outputs are kept.
    """
    run = BlockSimulation(model.A, model.B, model.C, model.D, x0)
    missed, power, total, count = np.zeros((4, model.noutputs))
    shown: list[FloatArray] = []
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for u, y in record.chunks(_CHUNK):
            simulated = run.advance(u)
            missed += np.nansum((y - simulated) ** 2, axis=0)
            power += np.nansum(y**2, axis=0)
            total += np.nansum(y, axis=0)
            count += np.count_nonzero(~np.isnan(y), axis=0)
            if len(shown) * _CHUNK < EXCERPT_SAMPLES:
                shown.append(simulated)
        delta = np.sqrt(missed / power)
        about_mean = np.sqrt(power / (power - total**2 / count))
    delta = np.where(power > 0.0, np.where(np.isfinite(delta), delta, np.inf), np.nan)
    shown_y = np.concatenate(shown)[:EXCERPT_SAMPLES]
    return Dmv(delta, mean_error(delta), delta * about_mean, shown_y, x0)
