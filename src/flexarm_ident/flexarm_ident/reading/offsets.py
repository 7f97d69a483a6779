"""Offsets between commands and outputs whose instants are those of receiving.

The mean delay of each topic stays in its even instants. Where outputs are the more delayed ones,
commands seem to come before the samples that they answer, and the row before holds a part of the
next command: the input knows the future, which looks like a closed loop. How late a topic is in the
mean is not known, but the scatter of its delays bounds it, and the record tells whether a command
acts before its row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_ident.reading.common_grid import common_rows
from flexarm_ident.reading.grid import ON_TIME
from flexarm_ident.reading.tracks import NS
from flexarm_ident.subspace.feedback import BACKGROUND_SAMPLES
from flexarm_ident.subspace.gram import stretches
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.reading.common_grid import CommonRows
    from flexarm_ident.reading.tracks import Evened, Track

# The least delay, which no scatter shows, may be as long as the mean above it.
_REACH = 2.0
# Part of a sender's messages that keep their distance from the rows.
_MOST = 0.9
# Rows of the past that tell a row.
_MEMORY = 20
# Rows for each coefficient of a prediction.
_ROWS_PER_COEFFICIENT = 4
# An alignment is better when it makes the record e^10 times as likely.
_CLEAR = 10.0
# The command of the next row tells something by chance, or by a rest of the offset: this part of
# what moving it does.
_SIGNIFICANCE = 0.01
_SLIGHT = 0.1
# Power of errors, in units of an output's, that are rounding.
_ROUNDING = 1e-10


@dataclass(frozen=True)
class Offset:
    """Time by which commands were moved to the rows behind them."""

    label: str
    early_s: float


class _Prediction(NamedTuple):
    """Logarithm of a record's likelihood, and what the command of the next row adds to it."""

    likelihood: float
    by_next: float


def on_their_rows(
    inputs: Sequence[Evened], outputs: Sequence[Evened], *, interpolated: bool = False
) -> tuple[CommonRows, list[Offset]]:
    """Put signals on rows as `common_rows` does, and commands that come too early on their own.

    Commands are moved to the rows behind them when these are as near as the scatter of the delays
    allows, the record is clearly likelier then, and the command of the next row tells little more
    of the outputs. A controller's command does: a loop stays as it was received.

    Parameters
    ----------
    inputs, outputs : sequence of Evened
        Signals at the even instants behind their arrivals.
    interpolated : bool
        Inputs were measured, as in `common_rows`; none is moved.

    Returns
    -------
    CommonRows, list of Offset
        Rows, and what was moved.

    Raises
    ------
    DataError
        As in `common_rows`.
    """
    commands, sampled = ([each.sent for each in signals] for signals in (inputs, outputs))
    found, offsets = common_rows(commands, sampled, interpolated=interpolated), []
    late_s = max(each.early_s for each in outputs)
    for together in [] if interpolated else _of_one_sender(commands):
        first = together[0]
        ahead = _ahead(found.acting[first])
        early_s = ahead * found.grid.period_s
        if ahead <= ON_TIME or early_s > _REACH * (late_s + inputs[first].early_s):
            continue
        tried = [
            _later(each, early_s) if number in together else each
            for number, each in enumerate(commands)
        ]
        moved = common_rows(tried, sampled)
        if _is_likelier(found, moved, together):
            found, commands = moved, tried
            offsets.append(Offset(commands[first].label, early_s))
    return found, offsets


def _of_one_sender(commands: Sequence[Track]) -> list[list[int]]:
    """Return the numbers of the inputs whose values come in the same messages."""
    senders: dict[bytes, list[int]] = {}
    for number, each in enumerate(commands):
        senders.setdefault(each.times_ns.tobytes(), []).append(number)
    return list(senders.values())


def _ahead(instants: FloatArray) -> float:
    """Return how far commands are before their nearest rows, in periods.

    It is 0 where they are behind them, or keep no distance from the rows, as events do.
    """
    phases = np.exp(2j * np.pi * instants)
    usual = np.angle(phases.mean()) / (2.0 * np.pi)
    off = np.angle(phases * np.exp(-2j * np.pi * usual)) / (2.0 * np.pi)
    keeps = np.mean(np.abs(off) <= ON_TIME) >= _MOST
    return max(0.0, -float(usual)) if keeps else 0.0


def _later(command: Track, by_s: float) -> Track:
    return replace(command, times_ns=command.times_ns + round(by_s * NS))


def _is_likelier(found: CommonRows, moved: CommonRows, together: Sequence[int]) -> bool:
    """Return whether moved commands explain the outputs, and better than those as received."""
    rows = np.intersect1d(found.rows, moved.rows)
    before, after = (_predicted(each, rows, together) for each in (found, moved))
    if before is None or after is None:
        return False
    gain = after.likelihood - before.likelihood
    degrees = len(together) * found.y.shape[1]
    by_chance = 0.5 * float(scipy.special.chdtri(degrees, _SIGNIFICANCE))
    return gain > _CLEAR and after.by_next <= max(by_chance, _SLIGHT * gain)


def _predicted(
    found: CommonRows, rows: NDArray[np.int64], together: Sequence[int]
) -> _Prediction | None:
    """Predict each row from those before it; None for a record that is too short."""
    chosen = np.isin(found.rows, rows)
    u, y = found.u[chosen], found.y[chosen]
    longest = max(stretches(y), key=lambda each: each.stop - each.start, default=slice(0, 0))
    part = slice(longest.start, min(longest.stop, longest.start + BACKGROUND_SAMPLES))
    u, y = _unit(u[part]), _unit(y[part])
    channels = u.shape[1] + y.shape[1]
    if len(u) < _MEMORY * (1 + _ROWS_PER_COEFFICIENT * channels):
        return None
    lags = range(1, _MEMORY + 1)
    past = np.hstack([each[_MEMORY - lag : len(u) - lag] for each in (y, u) for lag in lags])
    following = np.hstack([y[_MEMORY:], u[_MEMORY:, together]])
    left = following - past @ truncated_inverse(past.T @ past).solve(past.T @ following)
    e, news = left[:, : y.shape[1]], left[:, y.shape[1] :]
    further = e - news @ truncated_inverse(news.T @ news).solve(news.T @ e)
    alone, helped = (_log_likelihood(each) for each in (e, further))
    return _Prediction(alone, helped - alone)


def _unit(signals: FloatArray) -> FloatArray:
    moved = signals - signals.mean(axis=0)
    deviation = moved.std(axis=0)
    return np.asarray(moved / np.where(deviation > 0.0, deviation, 1.0))


def _log_likelihood(errors: FloatArray) -> float:
    covariance = errors.T @ errors / len(errors) + _ROUNDING * np.eye(errors.shape[1])
    return -0.5 * len(errors) * float(np.linalg.slogdet(covariance)[1])
