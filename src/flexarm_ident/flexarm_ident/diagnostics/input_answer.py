"""Answer of the outputs to the inputs: delayed, without dynamics, or none.

The part of each input that the past and the present outputs do not tell is white, mostly, and then
independent of what the outputs did before. Where no cause reaches an output, its correlation with
what the output's own past does not tell has the variance one over the number of samples, whatever
the output's noise is like, and also under feedback. The lag of the first correlation above chance
is that of the first answer.
Haugh, "Checking the independence of two covariance-stationary time series", JASA 71 (1976).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_ident.diagnostics.check import Check, each_record
from flexarm_ident.diagnostics.excitation import moves_seldom
from flexarm_ident.diagnostics.spectra import spectra
from flexarm_ident.records.data_warning import Grade, Kind
from flexarm_ident.records.iodata import IoData
from flexarm_ident.records.signals import CONSTANT_SHARE, constant_share
from flexarm_ident.subspace.feedback import SIGNIFICANCE, SMALLEST_REMAINDER, whitening
from flexarm_ident.subspace.innovations import (
    MEMORY,
    Innovations,
    centred,
    innovations_of,
    longest,
    remainder,
    shifted,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.records.data_warning import DataWarning

_LAGS = 500
_SAMPLES_PER_LAG = 8
# A delay costs a state per sample and input: fewer samples do not matter.
_SHORTEST_DELAY = 4
# Squared correlation of what is new of an input with itself, at any lag. A sweep leaves waves,
# which tell no delay; what a clocked input leaves repeats a little, and a part of the answer leaks
# so to earlier lags.
_LARGEST_REPETITION = 0.1
_LEAK = 4.0
# The answer of an arm may begin gradually. One whose power grows with the eighth power of the lag,
# as that of four integrators in a row, would show before it passes the limit of chance.
_GRADUAL = 8
_DEVIATIONS = 3.0
# The input of the same row explains so much of an output's power, and the past of both no more than
# chance, or so little: a slow output under a slow input looks alike, but its own past explains it.
_EXPLAINED_AT_ONCE = 0.5
_EXPLAINED_LATER = 1e-4
# An answer is denied only where it would hardly be missed: a twentieth of the power shows in 99 of
# 100 records of so many samples, and chance looks like an answer in 3 of 100.
_FEWEST = 2000
_ANSWER_CHANCE = 0.01
_ANSWER_LAGS = 50
# A slow answer hides in each of these tests, but not from a regression on the smoothed inputs.
_SMOOTHING = (0.0, 0.9, 0.99, 0.999, 1.0)
_SLOW_SHARE = 0.05
# Two thirds of the samples lie in the unit of this reach.
_REACH = 5.0


class _Correlation(NamedTuple):
    """Squared correlations by lags, summed over the outputs, and the same as a chi-square."""

    share: FloatArray
    evidence: FloatArray


def answer_defects(record: IoData) -> Iterator[DataWarning]:
    """Yield the outputs with no response or a static one, and the inputs with a delay."""
    static = static_outputs(record)
    for name, gain_share in static.items():
        yield _NO_ANSWER(
            f"{name} responds within the sample and has no dynamics "
            f"({100.0 * gain_share:.4g} % of its power): leave it out, or fit with feedthrough",
            {"share": gain_share},
            channel=name,
        )
    part = record.rows(longest(record.y_usable))
    tame = replace(part, y=_without_extremes(part.y_measured))
    innovations = innovations_of(tame)
    if innovations is None:
        return
    # A few answers are lost among the noise of the rest of the record.
    if not moves_seldom(record):
        yield from _unanswered(tame, innovations, static)
    yield from _delays(tame, innovations)


def static_outputs(record: IoData) -> dict[str, float]:
    """Return the outputs that the inputs of the same row alone explain, with that share.

    A record that is known to be made in closed loop has none: there, the inputs follow the outputs.
    """
    if record.closed_loop:
        return {}
    rows = longest(record.y_usable)
    u, y = centred(record.u[rows]), centred(record.y[rows])
    if len(u) < 2 * _ANSWER_LAGS + _FEWEST // 10:
        return {}
    now, past = u[MEMORY:], np.hstack([shifted(u, 0), shifted(y, 1)])
    at_once, later = _left(now, y[MEMORY:]), _left(past, y[MEMORY:])
    # An input that seldom changes shows no dynamics: the changes have to be explained as well.
    unexplained = np.maximum(at_once, _left(np.diff(u, axis=0), np.diff(y, axis=0)))
    is_explained = unexplained < 1.0 - _EXPLAINED_AT_ONCE
    chance = scipy.special.chdtri(past.shape[1], _ANSWER_CHANCE) / len(past)
    is_static = at_once - later < np.maximum(_EXPLAINED_LATER, chance * later)
    return {
        record.outputs[i]: float(1.0 - at_once[i]) for i in np.flatnonzero(is_explained & is_static)
    }


def _left(known: FloatArray, signals: FloatArray) -> FloatArray:
    """Return the share of the signals' power that a regression on known ones leaves."""
    power, left = (np.sum(x**2, axis=0) for x in (signals, remainder(known, signals)))
    return np.asarray(np.divide(left, power, out=np.ones_like(power), where=power > 0.0))


def _delays(record: IoData, innovations: Innovations) -> Iterator[DataWarning]:
    """Yield the inputs whose first effect on any output comes late."""
    covariance = innovations.outputs.T @ innovations.outputs / len(innovations.outputs)
    white = innovations.outputs @ whitening(covariance)
    degrees = white.shape[1]
    if degrees == 0:
        return
    for name, u, fresh in zip(record.inputs, record.u.T, innovations.inputs.T, strict=True):
        if fresh.std() <= SMALLEST_REMAINDER * u.std():
            continue
        share, evidence = _correlation(white, fresh)
        repeated = float(_correlation(fresh[:, np.newaxis] / fresh.std(), fresh).share.max())
        if repeated > _LARGEST_REPETITION:
            continue
        chance = scipy.special.chdtri(degrees, SIGNIFICANCE / len(evidence))
        above = np.flatnonzero((evidence > chance) & (share > _LEAK * repeated * share.max()))
        if not len(above) or above[0] < _SHORTEST_DELAY:
            continue
        delay = int(above[0])
        early = evidence[:delay]
        lags = np.arange(1, delay + 1) / (delay + 1.0)
        gradual = evidence[delay] * np.sum(lags**_GRADUAL)
        excess, scatter = np.sum(early - degrees), np.sqrt(2.0 * degrees * delay)
        if excess + _DEVIATIONS * scatter >= gradual:
            continue
        yield _DELAY(
            f"no output responds to {name} before {delay + 1} samples "
            f"({(delay + 1) * record.dt_s:.3g} s): a delay of {delay} samples costs a state each; "
            f"shift {name} by them, or find it",
            {"samples": float(delay), "delay_s": delay * record.dt_s, "evidence": evidence[delay]},
            channel=name,
        )


def _unanswered(
    record: IoData, innovations: Innovations, static: dict[str, float]
) -> Iterator[DataWarning]:
    """Yield the outputs in which no input shows."""
    if len(innovations.outputs) < _FEWEST:
        return
    fresh = innovations.inputs[
        :, innovations.inputs.std(axis=0) > SMALLEST_REMAINDER * record.u.std(axis=0)
    ]
    silent = [
        i
        for i, (name, y) in enumerate(zip(record.outputs, record.y.T, strict=True))
        if name not in static
        and constant_share(y) <= CONSTANT_SHARE
        and not _is_correlated(innovations.outputs[:, i], fresh)
        and _slowly_explained(record.u, y) < _SLOW_SHARE
    ]
    welch = spectra([record]) if silent else None
    if welch is None:
        return
    chance = welch.chance(_ANSWER_CHANCE / len(welch.coherence))
    for i in silent:
        name = record.outputs[i]
        if np.any(welch.coherence[:, i] > chance):
            if welch.explained[i] > _EXPLAINED_AT_ONCE and (answering := _answering(record, i)):
                yield _NO_ANSWER(
                    f"{name} responds to no input, but {', '.join(answering)} to {name}: exchange "
                    "input and output where their names are the wrong way round",
                    {"explained": float(welch.explained[i])},
                    channel=name,
                )
            continue
        yield _NO_ANSWER(
            f"{name} has no response to any input in {len(record)} samples, only noise: check the "
            "sensor and its wiring, or leave it out",
            {"samples": float(len(record)), "explained": float(welch.explained[i])},
            grade=Grade.DO_NOT_USE,
            channel=name,
        )


def _answering(record: IoData, output: int) -> list[str]:
    """Return the inputs that respond to an output."""
    names = (record.outputs[output],), record.inputs
    exchanged = IoData(
        record.y[:, [output]], record.u, dt_s=record.dt_s, inputs=names[0], outputs=names[1]
    )
    found = innovations_of(exchanged)
    if found is None:
        return []
    return [
        name
        for name, e in zip(record.inputs, found.outputs.T, strict=True)
        if _is_correlated(e, found.inputs)
    ]


def _is_correlated(e: FloatArray, fresh: FloatArray) -> bool:
    """Return whether an output correlates with earlier inputs, at one lag or over several."""
    deviation = float(e.std())
    if deviation == 0.0 or fresh.shape[1] == 0:
        return False
    power = np.array(
        [_correlation(e[:, np.newaxis] / deviation, each).evidence for each in fresh.T]
    )
    single = scipy.special.chdtri(1, _ANSWER_CHANCE / power.size)
    near = power[:, :_ANSWER_LAGS]
    joint = scipy.special.chdtri(near.size, _ANSWER_CHANCE)
    return bool(power.max() > single or near.sum() > joint)


def _slowly_explained(u: FloatArray, y: FloatArray) -> float:
    """Return the share of an output's power that a regression on the smoothed inputs explains."""
    smooth = [scipy.signal.lfilter([1.0], [1.0, -a], centred(u), axis=0) for a in _SMOOTHING]
    signal = centred(y[:, np.newaxis])
    return 1.0 - float(np.mean(remainder(centred(np.hstack(smooth)), signal) ** 2))


def _correlation(white: FloatArray, fresh: FloatArray) -> _Correlation:
    """Return the correlation with an input 1, 2, ... samples earlier.

    The outputs are uncorrelated and have unit variance. Where both signals jump at the same
    instants, these count alone: the variance of the products is then larger than that of
    independent signals, and stands in its place.
    White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 48 (1980).
    """
    unit = (fresh / fresh.std())[:, np.newaxis]
    lags = np.arange(1, min(_LAGS, len(white) // _SAMPLES_PER_LAG) + 1)
    rows = (len(white) - lags)[:, np.newaxis]
    squares = _lagged_sums(white, unit)[lags] ** 2
    variance = np.maximum(_lagged_sums(white**2, unit**2)[lags], rows)
    share, evidence = (np.sum(squares / scale, axis=1) for scale in (rows**2, variance))
    return _Correlation(share, evidence)


def _lagged_sums(late: FloatArray, early: FloatArray) -> FloatArray:
    """Return the sums of the products of two signals over all rows, (lags, channels)."""
    length = scipy.fft.next_fast_len(2 * len(late))
    late_transform, early_transform = (scipy.fft.rfft(x, length, axis=0) for x in (late, early))
    return np.asarray(scipy.fft.irfft(late_transform * early_transform.conj(), length, axis=0))


def _without_extremes(y: FloatArray) -> FloatArray:
    """Return outputs with outliers, which would drown every answer, cut off."""
    low, middle, high = np.nanquantile(y, (0.16, 0.5, 0.84), axis=0)
    reach = np.where(high > low, _REACH * (high - low), np.inf)
    return np.clip(y, middle - reach, middle + reach)


_NO_ANSWER = Kind(
    "no_answer",
    "No response to the input",
    "an output has no response to the input (no correlation, no coherence, p > 0.01 each): do not "
    "use it; the input of the same row predicts half of an output or more, and the past adds "
    "nothing; an input responds to an output that responds to none",
    "check the sensor, or leave it out; fit with `feedthrough`; exchange input and output",
)
_DELAY = Kind(
    "delay",
    "Delay",
    "inputs reach no output before 4 samples or more, p < 1e-6",
    "shift the input, or find the delay",
)
CHECKS = (Check(each_record(answer_defects), (_NO_ANSWER, _DELAY)),)
