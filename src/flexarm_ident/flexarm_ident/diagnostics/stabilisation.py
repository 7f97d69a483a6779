"""Stabilisation diagram over model orders, and the modes that recur in it.

A model of too high an order has the modes of the plant and further ones that describe noise. The
former recur at the same place at every order, the latter wander. Soft criteria compare each mode
with those of the order before. Hard criteria exclude modes that no lightly damped structure has.
The modes that pass both are gathered in clusters.
Magalhaes, Cunha, Caetano, "Online automatic identification of the modal parameters of a long span
arch bridge", Mechanical Systems and Signal Processing 23 (2009).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_ident.models.modes import frequency_and_damping
from flexarm_ident.subspace.order import candidate_orders

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.subspace.subspace_protocol import StateMatrices, Subspace


class Criteria(NamedTuple):
    """Criteria for stable and recurring modes.

    Attributes
    ----------
    frequency : float
        Soft: largest relative change of the frequency from one order to the next.
    damping : float
        Soft: largest change of the damping ratio.
    mac : float
        Soft: smallest modal assurance criterion between the shapes.
    largest_damping, smallest_damping : float
        Hard: largest damping ratio of a structural mode, and what it exceeds.
    spread : float
        Smallest distance between two clusters: relative difference of frequencies plus one minus
        MAC.
    share : float
        Smallest share of the orders in which a recurring mode is found.
    """

    frequency: float = 0.03
    damping: float = 0.03
    mac: float = 0.95
    largest_damping: float = 0.25
    spread: float = 0.1
    share: float = 0.6
    smallest_damping: float = 0.0


@dataclass(frozen=True, eq=False)
class Pole:
    """Complex pair of the model of one order.

    Attributes
    ----------
    order : int
        Order of the model.
    frequency_hz, damping_ratio : float
        Natural frequency and damping ratio (2-28).
    shape : ndarray, (outputs,)
        Mode shape of the scaled outputs, of unit length.
    admissible : bool
        Whether the hard criteria hold.
    stable : bool
        Whether it is admissible and the order before has a similar mode.
    """

    order: int
    frequency_hz: float
    damping_ratio: float
    shape: ComplexArray
    admissible: bool
    stable: bool


@dataclass(frozen=True, eq=False)
class RecurringMode:
    """Cluster of modes that recur over the orders.

    Attributes
    ----------
    frequency_hz, damping_ratio : float
        Medians over the orders.
    frequency_std_hz, damping_std : float
        Standard deviations over the orders.
    count : int
        Number of orders in which the mode was found.
    share : float
        Their share of all orders.
    orders : tuple of int
        The orders.
    frequencies_hz : tuple of float
        Frequency at each of them.
    shape : ndarray, (outputs,)
        Mode shape of the pole next to the median.
    """

    frequency_hz: float
    damping_ratio: float
    frequency_std_hz: float
    damping_std: float
    count: int
    share: float
    orders: tuple[int, ...]
    frequencies_hz: tuple[float, ...]
    shape: ComplexArray


@dataclass(frozen=True, eq=False)
class Stabilisation:
    """Stabilisation diagram.

    Attributes
    ----------
    orders : tuple of int
        Orders of the models, rising.
    poles : tuple of Pole
        Complex pairs of all orders.
    modes : tuple of RecurringMode
        Modes that recur over the orders, by rising frequency.
    dt_s : float
        Sampling period.
    """

    orders: tuple[int, ...]
    poles: tuple[Pole, ...]
    modes: tuple[RecurringMode, ...]
    dt_s: float


def mac(one: ComplexArray, other: ComplexArray) -> float:
    """Return the modal assurance criterion of two mode shapes: 1 when they are parallel.

    Allemang, Brown, "A correlation coefficient for modal vector analysis", IMAC 1 (1982).
    """
    power = np.vdot(one, one).real * np.vdot(other, other).real
    return float(abs(np.vdot(one, other)) ** 2 / power) if power > 0.0 else 0.0


def subspace_matrices(space: Subspace) -> dict[int, StateMatrices]:
    """Return A and C of every candidate order, from one decomposition."""
    return {order: space.matrices(order) for order in candidate_orders(space)}


def stabilisation(
    matrices: Mapping[int, StateMatrices],
    output_scale: FloatArray,
    dt_s: float,
    criteria: Criteria | None = None,
) -> Stabilisation:
    """Return the stabilisation diagram of models of several orders.

    Parameters
    ----------
    matrices : mapping of int to StateMatrices
        A and C of each order, such as those of `subspace_matrices`.
    output_scale : ndarray, (outputs,)
        Factors that make the outputs of a shape comparable, `Subspace.output_scale`.
    dt_s : float
        Sampling period.
    criteria : Criteria, optional
        Tolerances.
    """
    limits = criteria or Criteria()
    orders = tuple(sorted(matrices))
    poles: list[Pole] = []
    before: list[Pole] = []
    for order in orders:
        here = [
            replace(
                pole,
                stable=pole.admissible and any(_alike(pole, other, limits) for other in before),
            )
            for pole in _poles(order, matrices[order], output_scale, dt_s, limits)
        ]
        poles += here
        before = here
    modes = _recurring([pole for pole in poles if pole.stable], orders, limits)
    return Stabilisation(orders, tuple(poles), modes, dt_s)


def _poles(
    order: int, matrices: StateMatrices, output_scale: FloatArray, dt_s: float, limits: Criteria
) -> list[Pole]:
    eigenvalues, vectors = np.linalg.eig(matrices.A)
    shapes = output_scale[:, np.newaxis] * (matrices.C @ vectors)
    poles = []
    for i in np.flatnonzero(eigenvalues.imag > 0.0):
        frequency_hz, damping_ratio = frequency_and_damping(complex(eigenvalues[i]), dt_s)
        shape = shapes[:, i] / (np.linalg.norm(shapes[:, i]) or 1.0)
        admissible = limits.smallest_damping < damping_ratio <= limits.largest_damping
        poles.append(Pole(order, frequency_hz, damping_ratio, shape, admissible, stable=False))
    return poles


def _alike(pole: Pole, other: Pole, limits: Criteria) -> bool:
    return (
        abs(pole.frequency_hz - other.frequency_hz) <= limits.frequency * pole.frequency_hz
        and abs(pole.damping_ratio - other.damping_ratio) <= limits.damping
        and mac(pole.shape, other.shape) >= limits.mac
    )


def _recurring(
    poles: list[Pole], orders: tuple[int, ...], limits: Criteria
) -> tuple[RecurringMode, ...]:
    modes = [_mode(cluster, orders) for cluster in _clusters(poles, limits.spread)]
    enough = (mode for mode in modes if mode.share >= limits.share)
    return tuple(sorted(enough, key=lambda mode: mode.frequency_hz))


def _clusters(poles: list[Pole], spread: float) -> Iterable[list[Pole]]:
    if len(poles) < 2:  # noqa: PLR2004 - one pole is not a cluster
        return []
    frequency = np.array([pole.frequency_hz for pole in poles])
    shapes = np.array([pole.shape for pole in poles])
    apart = np.abs(np.subtract.outer(frequency, frequency))
    distance = apart / np.maximum.outer(frequency, frequency)
    distance += 1.0 - np.abs(shapes.conj() @ shapes.T).clip(max=1.0) ** 2
    np.fill_diagonal(distance, 0.0)
    hierarchy = scipy.cluster.hierarchy
    condensed = scipy.spatial.distance.squareform(distance, checks=False)
    tree = hierarchy.linkage(condensed, method="average")
    labels = hierarchy.fcluster(tree, spread, criterion="distance")
    return [[poles[i] for i in np.flatnonzero(labels == label)] for label in np.unique(labels)]


def _mode(cluster: list[Pole], orders: tuple[int, ...]) -> RecurringMode:
    centre = float(np.median([pole.frequency_hz for pole in cluster]))
    # An order with the mode split in two counts once.
    nearest: dict[int, Pole] = {}
    for pole in sorted(cluster, key=lambda pole: -abs(pole.frequency_hz - centre)):
        nearest[pole.order] = pole
    found = [nearest[order] for order in sorted(nearest)]
    frequency = np.array([pole.frequency_hz for pole in found])
    damping = np.array([pole.damping_ratio for pole in found])
    median_hz = float(np.median(frequency))
    return RecurringMode(
        frequency_hz=median_hz,
        damping_ratio=float(np.median(damping)),
        frequency_std_hz=float(frequency.std()),
        damping_std=float(damping.std()),
        count=len(found),
        share=len(found) / len(orders),
        orders=tuple(pole.order for pole in found),
        frequencies_hz=tuple(frequency.tolist()),
        shape=found[int(np.argmin(np.abs(frequency - median_hz)))].shape,
    )
