"""Rigid motion and dry friction of joints, in the place of slow poles that stand for friction.

A linear model of joints with dry friction has the vibrations of the arm, and slow poles that
imitate how friction holds the joints. A controller takes these for springs. Below the vibrations
the joints obey M q'' + V q' + c sign(q') + h = u, which is linear in M, V, c and h where they move.
The other outputs follow their angles, speeds or accelerations. Whether the joints move as the
record says decides between the two models.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_control.servo.robustness import FEWEST_PERIODS, vibrations
from flexarm_ident.fitting.validation import validate_dmv
from flexarm_ident.friction.dry_friction import DryFriction, simulate_with_friction
from flexarm_ident.models.state_space import simulate_states, state_space

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import BoolArray, FloatArray
    from flexarm_ident.records.iodata import IoData

# The filter leaves what is slower than half of the slowest vibration.
_BELOW = 0.5
_FILTER_ORDER = 4
# Part of a joint's usual speed below which it may stand.
_STANDS = 0.1
_FEWEST = 100


class RigidMotion(NamedTuple):
    """Model with rigid motion and friction, and how well it predicts moves.

    Attributes
    ----------
    model : control.StateSpace
        Angles and speeds of the joints, then the vibrations of the identified model.
    friction : DryFriction
        Friction of the joints.
    error, former_error : float
        Errors of the joints' moves over a period of the slowest vibration in free simulation, of
        this model and of the identified one; 1 is that of a joint which stands.
    """

    model: control.StateSpace
    friction: DryFriction
    error: float
    former_error: float


class _Joints(NamedTuple):
    """Inertia, viscous friction, Coulomb levels and offsets of joints."""

    inertia: FloatArray
    viscous: FloatArray
    levels: FloatArray
    offsets: FloatArray


class _Separated(NamedTuple):
    """Joints, their smooth moves, and what the vibrations show, (samples, outputs)."""

    joints: _Joints
    moves: list[FloatArray]
    bent: FloatArray


def rigid_motion(
    model: control.StateSpace, record: IoData, joints: Sequence[int]
) -> RigidMotion | None:
    """Return an identified model with rigid motion and dry friction of its joints, if it is better.

    Parameters
    ----------
    model : control.StateSpace
        Identified model of joints with as many inputs, without friction.
    record : IoData
        Record from which it was identified.
    joints : sequence of int
        Outputs that are angles of the joints, as many as inputs.

    Returns
    -------
    RigidMotion or None
        None when there are fewer joints than inputs, the record shows no vibration, it does not
        move enough, or the identified model predicts the joints' moves better.
    """
    shown_hz = FEWEST_PERIODS / (len(record.u) * record.dt_s)
    modes = sorted(vibrations(model, shown_hz), key=lambda value: abs(np.log(value)))
    if len(joints) != model.ninputs or not modes:
        return None
    places = list(joints)
    swing = _vibrating_part(model, modes)
    period = 2.0 * np.pi / abs(np.log(modes[0]))
    smooth = scipy.signal.butter(_FILTER_ORDER, 2.0 * _BELOW / period, output="sos")
    # What the vibrations add to the angles depends on the friction, and the other way round.
    first = _separated(record, places, smooth, swing, np.zeros_like(record.y))
    second = first and _separated(record, places, smooth, swing, first.bent)
    if second is None:
        return None
    y, motion = record.y, second.joints
    others = scipy.signal.sosfiltfilt(smooth, y - second.bent, axis=0)
    followed = _followed(others, second.moves, places)
    whole = _joined(model, swing, motion, followed, places)
    speed = np.zeros((len(places), whole.nstates))
    speed[:, len(places) : 2 * len(places)] = np.eye(len(places))
    unknown = np.zeros(len(places))
    friction = DryFriction(motion.levels, motion.offsets, unknown, unknown, speed)
    start = np.zeros(whole.nstates)
    start[: len(places)] = y[0, places]
    simulated, _ = simulate_with_friction(whole, friction, record.u, start)
    former = validate_dmv(model, record).y
    step = max(1, round(period))
    errors = [_move_error(each[:, places], y[:, places], step) for each in (simulated, former)]
    # Written so that NaN is not an improvement.
    return RigidMotion(whole, friction, *errors) if errors[0] < errors[1] else None


def _separated(
    record: IoData,
    places: Sequence[int],
    smooth: FloatArray,
    swing: control.StateSpace,
    bent: FloatArray,
) -> _Separated | None:
    """Fit the joints to a record less what its vibrations show, and find these anew."""
    moves = _derivatives(record.y[:, places] - bent[:, places], smooth, record.dt_s)
    period = 2.0 * np.pi / float(np.min(np.abs(np.log(np.linalg.eigvals(swing.A)))))
    joints = _fitted(record.u, moves, smooth, round(0.5 * period / _BELOW))
    if joints is None:
        return None
    net = record.u - _friction(record.u, moves[1], joints) - joints.offsets
    return _Separated(joints, moves, simulate_states(swing.A, swing.B, net) @ swing.C.T)


def _vibrating_part(model: control.StateSpace, modes: Sequence[complex]) -> control.StateSpace:
    """Return the part of a model that vibrates, a real block for each pair."""
    values, left, right = scipy.linalg.eig(model.A, left=True)
    A = np.zeros((2 * len(modes), 2 * len(modes)))
    B, C = np.zeros((len(A), model.ninputs)), np.zeros((model.noutputs, len(A)))
    for at, value in zip(range(0, len(A), 2), modes, strict=True):
        i = int(np.argmin(np.abs(values - value)))
        row = left[:, i].conj() / (left[:, i].conj() @ right[:, i])
        pushed, shown = row @ model.B, 2.0 * model.C @ right[:, i]
        A[at : at + 2, at : at + 2] = [[value.real, -value.imag], [value.imag, value.real]]
        B[at : at + 2] = [pushed.real, pushed.imag]
        C[:, at : at + 2] = np.column_stack([shown.real, -shown.imag])
    return state_space(A, B, C, 0.0, float(model.dt))


def _derivatives(angles: FloatArray, smooth: FloatArray, dt_s: float) -> list[FloatArray]:
    """Return smooth angles, speeds and accelerations."""
    found = [scipy.signal.sosfiltfilt(smooth, angles, axis=0)]
    for _ in range(2):
        found.append(np.gradient(found[-1], dt_s, axis=0))
    return found


def _moving(speeds: FloatArray) -> BoolArray:
    """Return where each joint moves for certain, (samples, joints)."""
    usual = np.sqrt(np.mean(speeds**2, axis=0))
    return np.asarray(np.abs(speeds) > _STANDS * usual, dtype=np.bool_)


def _fitted(
    u: FloatArray, moves: Sequence[FloatArray], smooth: FloatArray, reach: int
) -> _Joints | None:
    """Fit the joints by least squares where none of them stands within the filter's reach."""
    _, speeds, accelerations = moves
    count = u.shape[1]
    moving = _moving(speeds)
    stands = np.asarray(~moving.all(axis=1), dtype=np.bool_)
    used = np.convolve(stands, np.ones(2 * reach + 1), mode="same") < 0.5  # noqa: PLR2004 - none
    if np.count_nonzero(used) < _FEWEST:
        used = ~stands
    if np.count_nonzero(used) < _FEWEST:
        return None
    forces = scipy.signal.sosfiltfilt(smooth, u, axis=0)
    signs = scipy.signal.sosfiltfilt(smooth, np.sign(speeds) * moving, axis=0)
    inertia, rest = np.empty((count, count)), np.empty((count, 3))
    for i in range(count):
        table = np.column_stack([accelerations, speeds[:, i], signs[:, i], np.ones(len(u))])
        # Neither kind of friction drives a joint.
        low = np.full(table.shape[1], -np.inf)
        low[count : count + 2] = 0.0
        solved = scipy.optimize.lsq_linear(table[used], forces[used, i], (low, np.inf)).x
        inertia[i], rest[i] = solved[:count], solved[count:]
    if not (np.linalg.eigvalsh(0.5 * (inertia + inertia.T)) > 0.0).all():
        return None
    return _Joints(0.5 * (inertia + inertia.T), *rest.T)


def _friction(u: FloatArray, speeds: FloatArray, found: _Joints) -> FloatArray:
    """Return the friction of a record: that of the motion, or what holds a joint that stands."""
    held = np.clip(u - found.offsets, -found.levels, found.levels)
    return np.where(_moving(speeds), np.sign(speeds) * found.levels, held)


def _followed(
    outputs: FloatArray, moves: Sequence[FloatArray], places: Sequence[int]
) -> list[tuple[int, FloatArray]]:
    """Return which derivative of the joints each output follows, and by what, (joints,)."""
    found: list[tuple[int, FloatArray]] = []
    for output, values in enumerate(outputs.T):
        if output in places:
            found.append((0, np.eye(len(places))[places.index(output)]))
            continue
        centred = values - values.mean()
        fits = []
        for each in moves:
            table = each - each.mean(axis=0)
            gains = np.linalg.lstsq(table, centred, rcond=None)[0]
            fits.append((float(np.sum((centred - table @ gains) ** 2)), gains))
        best = int(np.argmin([missed for missed, _ in fits]))
        found.append((best, fits[best][1]))
    return found


def _joined(
    model: control.StateSpace,
    swing: control.StateSpace,
    found: _Joints,
    followed: Sequence[tuple[int, FloatArray]],
    places: Sequence[int],
) -> control.StateSpace:
    """Return rigid motion and vibrations as one model."""
    count, dt_s = len(places), float(model.dt)
    push = np.linalg.inv(found.inertia)
    slowed = -push @ np.diag(found.viscous)
    nothing, one = np.zeros((count, count)), np.eye(count)
    moved = np.block(
        [
            [nothing, one, nothing],
            [nothing, slowed, push],
            [np.zeros((count, 3 * count))],
        ]
    )
    held = scipy.linalg.expm(moved * dt_s)
    A = scipy.linalg.block_diag(held[: 2 * count, : 2 * count], swing.A)
    B = np.vstack([held[: 2 * count, 2 * count :], swing.B])
    # An acceleration is that of the forces in force.
    rows = [np.hstack([one, nothing]), np.hstack([nothing, one]), np.hstack([nothing, slowed])]
    direct = [nothing, nothing, push]
    C = np.vstack([gains @ rows[order] for order, gains in followed])
    D = np.vstack([gains @ direct[order] for order, gains in followed])
    return state_space(
        A,
        B,
        np.hstack([C, swing.C]),
        D,
        dt_s,
        inputs=model.input_labels,
        outputs=model.output_labels,
    )


def _move_error(simulated: FloatArray, measured: FloatArray, step: int) -> float:
    """Return the relative error of the moves over some samples, the largest of all joints."""
    wanted, found = (each[step:] - each[:-step] for each in (measured, simulated))
    with np.errstate(over="ignore", invalid="ignore"):
        missed = np.linalg.norm(found - wanted, axis=0)
    return float(np.max(missed / np.linalg.norm(wanted, axis=0)))
