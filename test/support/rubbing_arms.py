"""Arms with dry friction in their joints, simulated in fine steps by bristles.

Friction is the force of a stiff bristle that slides where it would exceed the joint's level (Dahl's
law in its limit). That is another formulation than the project's implicit one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.compilation import compiled
from flexarm_ident import IoData

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

DT_S = 0.005
STRIBECK_RADPS = 0.15
_FINE = 25
_YIELD_RAD = 1e-4
_NOISE_RAD = (1e-3, 1e-4)
# Half periods of the open-loop input, samples, and the width of its steps.
_HALF_PERIODS = (5, 150)
_INPUT_A = 1.5
# More than any record has, so that a longer record begins as a shorter one does.
_STEPS = 100


def rubbing_arm(
    levels: tuple[float, ...],
    *,
    rise: float = 0.0,
    load: float = 0.0,
    seed: int = 0,
    samples: int = 3000,
    skip: int = 0,
) -> IoData:
    """Return a record of an arm with one or two joints under position loops.

    Parameters
    ----------
    levels : tuple of float
        Coulomb level of each joint, one or two.
    rise : float
        Rise of each level at standstill, as a part of it; it fades over `STRIBECK_RADPS`.
    load : float
        Part of each input's size that adds to the level.
    seed : int
        Seed of the references and of the noise.
    samples : int
        Length of the record.
    skip : int
        Samples before the record, which therefore begins in mid-motion.
    """
    joints, rng = len(levels), np.random.default_rng(seed)
    weights: Array = np.array([0.5**i for i in range(joints)])
    total = skip + samples
    references = _references(rng, total, joints)
    u, q = _run(
        *_mechanics(weights),
        np.array(levels),
        *(rise, load),
        3.0 * weights * references,
        *(3.0 * weights, 0.4 * weights),
    )
    y = q + rng.normal(size=q.shape) * np.repeat(_NOISE_RAD, joints)
    return _record(u[skip:], y[skip:], closed_loop=True)


def driven_arm(
    level: float,
    *,
    rise: float = 0.0,
    cable: float = 0.0,
    noise: float = 0.02,
    seed: int = 0,
    samples: int = 6000,
) -> IoData:
    """Return an open-loop record of an arm with one joint, driven by a square wave.

    Parameters
    ----------
    level, rise : float
        As those of `rubbing_arm`.
    cable : float
        Stiffness that holds the joint.
    noise : float
        White noise of each output, as a part of its deviation.
    seed : int
        Seed of the square wave and of the noise.
    samples : int
        Length of the record.
    """
    rng = np.random.default_rng(seed)
    low, high = _HALF_PERIODS
    edges = np.cumsum(rng.integers(low, high, samples // low))
    periods = np.searchsorted(edges, np.arange(samples), side="right")
    feed: Array = np.where(periods % 2 == 0, _INPUT_A, -_INPUT_A)[:, np.newaxis]
    open_loop = np.zeros(1)
    flexibility, stiffness, damping = _mechanics(np.ones(1))
    stiffness[0] = cable
    u, q = _run(
        *(flexibility, stiffness, damping),
        np.array([level]),
        *(rise, 0.0),
        feed,
        *(open_loop, open_loop),
    )
    return _record(u, q + noise * q.std(axis=0) * rng.normal(size=q.shape), closed_loop=False)


def _mechanics(weights: Array) -> tuple[Array, Array, Array]:
    """Return inverse mass matrix, stiffness and damping of joint angles and bends."""
    joints = len(weights)
    # Rotations of hub and link's end of each joint by joint angles and bends, which add up.
    hub, end = np.zeros((2, joints, 2 * joints))
    for i in range(joints):
        hub[i, : i + 1] = end[i, : i + 1] = 1.0
        hub[i, joints : joints + i] = end[i, joints : joints + i + 1] = 1.0
    mass = 0.4 * hub.T @ np.diag(weights) @ hub + 0.05 * end.T @ np.diag(weights) @ end
    flexibility = np.asarray(np.linalg.inv(mass), dtype=np.float64)
    stiffness = np.concatenate([np.zeros(joints), 30.0 * weights])
    return flexibility, stiffness, np.concatenate([0.8 * weights, 0.4 * weights])


def _record(u: Array, y: Array, *, closed_loop: bool) -> IoData:
    joints = u.shape[1]
    names = [f"{name}{i + 1}_rad" for name in ("joint", "bend") for i in range(joints)]
    inputs = tuple(f"drive{i + 1}_a" for i in range(joints))
    return IoData(u, y, dt_s=DT_S, inputs=inputs, outputs=tuple(names), closed_loop=closed_loop)


def _references(rng: np.random.Generator, samples: int, joints: int) -> Array:
    """Return steps of random heights and lengths with a slow sine on top."""
    references = np.empty((samples, joints))
    for joint in range(joints):
        edges = np.cumsum(rng.integers(150, 450, size=_STEPS))
        heights = rng.uniform(-1.5, 1.5, size=_STEPS + 1)
        steps = heights[np.searchsorted(edges, np.arange(samples), side="right")]
        sine = np.sin(np.arange(samples) * DT_S * rng.uniform(0.8, 1.2) + rng.uniform(0.0, 6.0))
        references[:, joint] = steps + 0.5 * sine
    return references


@compiled
def _run(  # noqa: PLR0917 (compiled code has no keyword arguments)
    flexibility: Array,
    stiffness: Array,
    damping: Array,
    levels: Array,
    rise: float,
    load: float,
    feed: Array,
    stiff: Array,
    calm: Array,
) -> tuple[Array, Array]:
    """Return inputs, `feed` less a position loop, and coordinates, in semi-implicit fine steps."""
    samples, joints = feed.shape
    n = len(stiffness)
    q, v, force, bristle = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(joints)
    us, qs = np.empty((samples, joints)), np.empty((samples, n))
    h = DT_S / _FINE
    for k in range(samples):
        qs[k] = q
        for i in range(joints):
            us[k, i] = feed[k, i] - stiff[i] * q[i] - calm[i] * v[i]
        for _ in range(_FINE):
            for i in range(n):
                force[i] = -stiffness[i] * q[i] - damping[i] * v[i]
            for i in range(joints):
                fading = np.exp(-((v[i] / STRIBECK_RADPS) ** 2))
                level = levels[i] * (1.0 + rise * fading) + load * abs(us[k, i])
                bristle[i] += h * v[i] * levels[i] / _YIELD_RAD
                bristle[i] = min(max(bristle[i], -level), level)
                force[i] += us[k, i] - bristle[i]
            for i in range(n):
                for j in range(n):
                    v[i] += h * flexibility[i, j] * force[j]
            for i in range(n):
                q[i] += h * v[i]
    return us, qs
