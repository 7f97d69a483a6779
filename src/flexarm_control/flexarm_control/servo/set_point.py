"""Planned set-points: a slope within the inputs' limits, then averages over two windows.

A set-point that jumps would ask for the whole bandwidth at once. It first moves with a limited
slope, and its mean over one window and then over another has a continuous acceleration. Such a mean
has no overshoot, and one over a whole period of a mode does not excite it (Singer and Seering,
"Preshaping command inputs to reduce system vibration", ASME Journal of Dynamic Systems 112, 1990).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.models.state_space import simulate, state_space

if TYPE_CHECKING:
    import control

    from flexarm_control.servo.regulator import Regulator
    from flexarm_core.arrays import FloatArray

# Windows in periods of the bandwidth.
_WINDOWS = (0.7, 0.35)
# Part of a limit that the plan may use: the rest is the feedback's.
_SHARE = 0.8
_VIBRATES = 0.3
_LONGEST = 20_000


class Plan(NamedTuple):
    """Shape of planned set-points.

    Attributes
    ----------
    slopes : ndarray, (tracked,)
        Largest change in one sample; infinite without limits.
    windows : tuple of int
        Samples of the two windows.
    """

    slopes: FloatArray
    windows: tuple[int, int]


def plan_for(found: Regulator, limits: FloatArray, reserved: FloatArray) -> Plan:
    """Return the fastest plan within the limits of the inputs.

    Parameters
    ----------
    found : Regulator
        The servo.
    limits : ndarray, (inputs,)
        Largest inputs; infinite for none.
    reserved : ndarray, (inputs,)
        Part of the limits for friction.
    """
    windows = _windows(found)
    following = found.following
    # Where friction takes nearly all, a slow plan is better than none.
    left = np.maximum(_SHARE * (limits - reserved), (1.0 - _SHARE) * limits)
    effort = _ramp_efforts(following, found, windows)
    with np.errstate(divide="ignore", invalid="ignore"):
        each = np.nanmin(left[:, None] / effort, axis=0)
        used = np.nanmax((effort * each).sum(axis=1) / left) if np.isfinite(each).any() else 1.0
    return Plan(each / max(used, 1.0) if np.isfinite(used) else each, windows)


def planned(plan: Plan, wanted: FloatArray, start: FloatArray) -> FloatArray:
    """Return planned set-points of wanted ones, both (samples, tracked), from a rest at `start`."""
    moved, now = np.empty_like(wanted), start.copy()
    for k, goal in enumerate(wanted):
        now = now + np.clip(goal - now, -plan.slopes, plan.slopes)
        moved[k] = now
    for window in plan.windows:
        padded = np.vstack([np.tile(start, (window, 1)), moved])
        sums = np.cumsum(padded - start, axis=0)
        moved = start + (sums[window:] - sums[:-window]) / window
    return moved


def planned_speeds(found: Regulator, windows: tuple[int, int], speed: FloatArray) -> FloatArray:
    """Return what a planned change of 1 in a sample adds to speeds of the plant.

    Parameters
    ----------
    found : Regulator
        The servo.
    windows : tuple of int
        Those of the plan.
    speed : ndarray, (speeds, states)
        Map from the state of the plant to the speeds.

    Returns
    -------
    ndarray, (speeds, tracked)
        The factors that fit planned steps best.
    """
    following, tracked = found.following, len(found.tracked)
    speeds = state_space(following.A, following.B, speed, 0.0, float(following.dt))
    factors = np.empty((len(speed), tracked))
    for column, one in enumerate(np.eye(tracked)):
        plan, answer = _unlimited(speeds, windows, np.tile(one, (sum(windows), 1)))
        change = with_differences(plan)[:, tracked + column]
        factors[:, column] = change @ answer / (change @ change)
    return factors


def _windows(found: Regulator) -> tuple[int, int]:
    """Return windows of the bandwidth, the longer one whole periods of the slowest vibration."""
    dt_s = float(found.plant.dt)
    period = 1.0 / (found.bandwidth_hz * dt_s)
    long, short = (share * period for share in _WINDOWS)
    poles = np.log(np.linalg.eigvals(found.following.A).astype(complex))
    vibrate = poles[(poles.imag > 0.0) & (-poles.real < _VIBRATES * np.abs(poles))]
    if len(vibrate):
        mode = 2.0 * np.pi / float(vibrate.imag.min())
        # A mode that is slower than the plan has to be waited for.
        long = max(1.0, round(long / mode)) * mode if mode < 2.0 * period else long
    return max(1, round(long)), max(1, round(short))


def with_differences(plan: FloatArray) -> FloatArray:
    """Return planned set-points two samples late, with both differences, (samples, 3 tracked)."""
    late = np.vstack([plan[:1], plan[:1], plan])
    base, ahead, last = late[:-2], late[1:-1], late[2:]
    return np.hstack([base, ahead - base, last - 2.0 * ahead + base])


def _ramp_efforts(
    following: control.StateSpace, found: Regulator, windows: tuple[int, int]
) -> FloatArray:
    """Return the range of each input for a set-point of unit slope, (inputs, tracked)."""
    tracked = len(found.tracked)
    slowest = np.max(np.abs(np.linalg.eigvals(following.A)))
    settled = sum(windows) + int(min(_LONGEST, 5.0 / max(1.0 - slowest, 1e-9)))
    efforts = np.empty((found.plant.ninputs, tracked))
    held = found.forward[0] - found.planning[:, : found.plant.nstates] @ found.rest
    for column, one in enumerate(np.eye(tracked)):
        ramp = np.outer(np.arange(1.0, settled + 1.0), one)
        plan, answer = _unlimited(following, windows, ramp)
        u = answer - plan @ held.T
        efforts[:, column] = np.maximum(u.max(axis=0), 0.0) - np.minimum(u.min(axis=0), 0.0)
    return efforts


def _unlimited(
    model: control.StateSpace, windows: tuple[int, int], wanted: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a plan of any slope, (samples, tracked), and what a model answers to it."""
    tracked = wanted.shape[1]
    plan = planned(Plan(np.full(tracked, np.inf), windows), wanted, np.zeros(tracked))
    return plan, simulate(model, with_differences(plan))
