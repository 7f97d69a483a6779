"""Input activity of a record: too few input transitions, and stretches with an idle input."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flexarm_core.arrays import runs
from flexarm_core.labels import counted, instant
from flexarm_ident.diagnostics.check import Check, each_record
from flexarm_ident.records.data_warning import Kind
from flexarm_ident.records.span import without

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import BoolArray
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData

# The same sign of four answers may be chance (one in sixteen), that of five is not at 5 %.
_MOVES = 5
# Windows of a record, and the samples that a window needs at least.
_WINDOWS = 256
_WINDOW_SAMPLES = 32
# The drive acts where this share of its power is.
_POWER = 0.9
_ACTIVE_SHARE = 0.1
# Longest hold of the record, and the probability of one as long if the moves came at random.
_HOLD_SHARE = 0.1
_STOP_SHARE = 0.05
_CHANCE = 1e-4
_ROUNDING = 1e-9


def drive_defects(record: IoData) -> Iterator[DataWarning]:
    """Yield what is wrong with the times at which the inputs of a record move."""
    if not moves_seldom(record):
        yield from _hold(record)
        return
    active = _active_windows(record)
    moves, share = len(runs(active)), float(active.mean())
    total_s = len(record) * record.dt_s
    yield _KIND(
        f"the inputs act in {share * total_s:.3g} of {total_s:.4g} s only, with "
        f"{counted(moves, 'transition')}: a response and a disturbance look alike; record {_MOVES} "
        "input transitions or more, all over the record",
        {"moves": float(moves), "active_s": share * total_s, "total_s": total_s},
    )


def moves_seldom(record: IoData) -> bool:
    """Return whether the inputs move a few times only, in a small part of the record."""
    active = _active_windows(record)
    return bool(len(active) and len(runs(active)) < _MOVES and active.mean() <= _ACTIVE_SHARE)


def is_stopped(record: IoData) -> bool:
    """Return whether the inputs end at zero and stay there, as after an emergency stop."""
    hold = _longest_hold(record)
    return hold is not None and _is_stop(record, hold)


class _Hold(NamedTuple):
    """Stretch without a change of an input, its share of the record, and changes elsewhere."""

    first: int
    last: int
    share: float
    moves: int

    @property
    def is_chance(self) -> bool:
        """Whether moves at random leave a gap as long."""
        return (self.moves + 1) * (1.0 - self.share) ** self.moves > _CHANCE


def _longest_hold(record: IoData) -> _Hold | None:
    """Return the longest stretch in which no input changes; None without inputs that move."""
    inputs = [u for u in record.u.T if np.ptp(u) > 0.0]
    if not inputs:
        return None
    still = np.all([np.abs(np.diff(u)) <= _ROUNDING * np.ptp(u) for u in inputs], axis=0)
    holds = runs(still)
    if not len(holds):
        return None
    first, last = max(holds.tolist(), key=lambda hold: hold[1] - hold[0])
    return _Hold(first, last, (last - first) / len(still), int(np.count_nonzero(~still)))


def _is_stop(record: IoData, hold: _Hold) -> bool:
    at_zero = bool(np.all(np.abs(record.u[-1]) <= _ROUNDING * np.ptp(record.u, axis=0)))
    is_last = hold.last == len(record) - 1
    return at_zero and is_last and hold.share >= _STOP_SHARE and not hold.is_chance


def _hold(record: IoData) -> Iterator[DataWarning]:
    """Yield the longest stretch in which no input changes, if chance does not explain it."""
    hold = _longest_hold(record)
    if hold is None:
        return
    first, last, share, moves = hold
    figures = {
        "first_row": float(first),
        "last_row": float(last),
        "share": share,
        "moves": float(moves),
    }
    if _is_stop(record, hold):
        yield _KIND(
            f"the input is idle at zero from {instant(first, record.dt_s)} to the end, "
            f"{100.0 * share:.3g} % of the record, as after a stop: leave those rows out "
            f"({without(record, [(first, last)])})",
            figures,
        )
        return
    if share < _HOLD_SHARE or hold.is_chance:
        return
    yield _KIND(
        f"the input is idle from {instant(first, record.dt_s)} to {instant(last, record.dt_s)}, "
        f"{100.0 * share:.3g} % of the record, and changes {moves} times elsewhere: leave those "
        f"rows out ({without(record, [(first, last)])}), or excite throughout",
        figures,
    )


def _active_windows(record: IoData) -> BoolArray:
    """Return which of the half overlapping windows hold most of an input's power; none if short."""
    samples = len(record)
    width = max(_WINDOW_SAMPLES, 2 * (samples // _WINDOWS))
    if samples < _WINDOW_SAMPLES * width // 2:
        return np.zeros(0, dtype=np.bool_)
    power = sliding_window_view(record.u, width, axis=0)[:: width // 2].var(axis=-1)
    active = np.zeros(len(power), dtype=np.bool_)
    for each in power.T:
        order = np.argsort(-each)
        total = np.cumsum(each[order])
        if total[-1] > 0.0:
            active[order[: 1 + np.searchsorted(total, _POWER * total[-1])]] = True
    return active


_KIND = Kind(
    "drive",
    "Input activity",
    "too few input transitions: nine tenths of the input's power in a tenth of the record, with "
    "fewer than 5 transitions; input idle: no change in a tenth of the record or more, where "
    "random transitions leave such a gap once in 10,000 records; or the input ends at zero, as "
    "after a stop, for a twentieth or more",
    "five input transitions or more; excite throughout, or leave those rows out (`--from`, `--to`)",
)
CHECKS = (Check(each_record(drive_defects), (_KIND,)),)
