"""Offsets between commands and outputs whose instants are those of receiving.

The mean delay of each topic stays in its even instants. Where outputs are the more delayed ones,
commands seem to come before the samples that they answer, and the row before holds a part of the
next command: the input knows the future, which looks like a closed loop. How late a topic is in the
mean is not known, but the scatter of its delays bounds it, and outputs with little noise tell
whether a command acts before its row.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.clock import NS
from flexarm_ident.reading.common_grid import common_rows
from flexarm_ident.reading.grid import ON_TIME
from flexarm_ident.subspace.feedback import BACKGROUND_SAMPLES
from flexarm_ident.subspace.gram import stretches
from flexarm_ident.subspace.inverse import truncated_inverse

if TYPE_CHECKING:
    from collections.abc import Sequence

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
# What makes a record e^10 times less likely is refuted.
_CLEAR = 10.0
# Power of errors, in units of an output's, that are rounding.
_ROUNDING = 1e-10


@dataclass(frozen=True)
class Offset:
    """Time by which commands were moved to the rows behind them."""

    label: str
    early_s: float


def on_their_rows(
    inputs: Sequence[Evened], outputs: Sequence[Evened], *, interpolated: bool = False
) -> tuple[CommonRows, list[Offset]]:
    """Put signals on rows as `common_rows` does, and commands that come too early on their own.

    Commands are moved to the rows behind them when these are as near as the scatter of the delays
    allows, and the outputs refute that they act before. A controller's command names the sample
    that it answers, so what would be moved in error in a loop stays as it was received.

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
        if _is_refuted(ahead, moved, together):
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


def _is_refuted(ahead: float, moved: CommonRows, together: Sequence[int]) -> bool:
    """Return whether the outputs refute commands that act so many periods before their rows.

    Such commands would have a part in the row before. It is least in an output that integrates
    twice, which goes by the square of the time.
    """
    u, part = moved.u[:-1], ahead**2
    early = u.copy()
    early[:, together] += part * (moved.u[1:, together] - u[:, together])
    likelihoods = [_log_likelihood(each, moved.y[:-1]) for each in (u, early)]
    return likelihoods[0] - likelihoods[1] > _CLEAR


def _log_likelihood(u: FloatArray, y: FloatArray) -> float:
    """Return that of predicting each row from those before it; 0 for a record that is too short."""
    longest = max(stretches(y), key=lambda each: each.stop - each.start, default=slice(0, 0))
    part = slice(longest.start, min(longest.stop, longest.start + BACKGROUND_SAMPLES))
    channels = u.shape[1] + y.shape[1]
    if part.stop - part.start < _MEMORY * (1 + _ROWS_PER_COEFFICIENT * channels):
        return 0.0
    u, y = _unit(u[part]), _unit(y[part])
    lags = range(1, _MEMORY + 1)
    past = np.hstack([each[_MEMORY - lag : len(u) - lag] for each in (y, u) for lag in lags])
    present = y[_MEMORY:]
    errors = present - past @ truncated_inverse(past.T @ past).solve(past.T @ present)
    covariance = errors.T @ errors / len(errors) + _ROUNDING * np.eye(y.shape[1])
    return -0.5 * len(errors) * float(np.linalg.slogdet(covariance)[1])


def _unit(signals: FloatArray) -> FloatArray:
    moved = signals - signals.mean(axis=0)
    deviation = moved.std(axis=0)
    return np.asarray(moved / np.where(deviation > 0.0, deviation, 1.0))
