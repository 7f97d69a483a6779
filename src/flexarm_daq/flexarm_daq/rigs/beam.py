"""Euler-Bernoulli beam, pinned at a hub with inertia and carrying a mass at its tip.

The beam has 24 cubic Hermite elements. The transverse deflection is zero on the axis, and the slope
there is the angle of the hub. Any text on structural dynamics has the element matrices;
`docs/rig.md` has the equations.

A library for linear algebra takes the fastest kernel of a processor, and rounds as that kernel
does. The modes of a beam, which is very stiff in the last of them, then differ in the ninth digit,
and friction in a loop makes other motions of that. Here the library finds the modes, and a few
steps of inverse iteration [1]_ in plain arithmetic take its rounding away.

References
----------
.. [1] Parlett, B. N. (1998). The Symmetric Eigenvalue Problem. SIAM. Chapter 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import scipy

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.rig_parameters import RigParameters

    Rows: TypeAlias = list[list[float]]

ELEMENTS = 24
FLEXIBLE_MODES = 6

TIP_DEFLECTION = -2
"""Place of the deflection of the last node in a shape."""

_ELEMENT_DOFS = 4
_UNIT_MASS = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
_UNIT_STIFFNESS = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
# The kernels agree in as many digits of an eigenvalue, and of a shape in units of its largest part.
_COMMON_DIGITS = 4
# Each step makes the difference of two starts some hundred times smaller.
_STEPS = 8


@dataclass(frozen=True)
class BeamModes:
    """Mass-normalised modes of a beam that turns freely with its hub, the rigid mode first.

    Attributes
    ----------
    omega_rad_per_s : ndarray, (modes,)
        Angular natural frequencies; the first is zero.
    hub_angle : ndarray, (modes,)
        Hub angle of each mode: its participation in a torque at the hub.
    base_curvature, middle_curvature : ndarray, (modes,)
        Second derivative of the deflection at the two gauges.
    momentum : ndarray, (dofs, modes)
        Mass matrix times mode shapes, which projects a deflection on the modes.
    shapes : ndarray, (dofs, modes)
        Slopes and deflections of the nodes in each mode.
    """

    omega_rad_per_s: NDArray[np.float64]
    hub_angle: NDArray[np.float64]
    base_curvature: NDArray[np.float64]
    middle_curvature: NDArray[np.float64]
    momentum: NDArray[np.float64]
    shapes: NDArray[np.float64]


def natural_frequencies_hz(parameters: RigParameters, count: int = 3) -> NDArray[np.float64]:
    """Return the natural frequencies of the whole arm: hubs, beam, tip mass and payload.

    Parameters
    ----------
    parameters : RigParameters
        Rig.
    count : int
        Number of flexible modes.

    Returns
    -------
    ndarray, (count,)
        Frequencies of the flexible modes, Hz, ascending.

    Raises
    ------
    SettingError
        If `count` is not between 1 and the number of elements, the limit of the mesh.
    """
    if not 1 <= count <= ELEMENTS:
        raise SettingError(f"count must be between 1 and {ELEMENTS}, got {count}")
    hub_kg_m2 = parameters.motor_inertia_kg_m2 + parameters.load_inertia_kg_m2
    modes = hub_beam_modes(parameters, hub_kg_m2, count)
    return modes.omega_rad_per_s[1:] / (2.0 * np.pi)


def arm_modes(parameters: RigParameters) -> BeamModes:
    """Return one rigid and `FLEXIBLE_MODES` flexible modes of the load side of the gear."""
    return hub_beam_modes(parameters, parameters.load_inertia_kg_m2, FLEXIBLE_MODES)


def hub_beam_modes(parameters: RigParameters, hub_kg_m2: float, flexible: int) -> BeamModes:
    """Return one rigid and some flexible modes of the beam with a given inertia at its hub."""
    mass, stiffness = _assemble(parameters)
    mass[0, 0] += hub_kg_m2
    mass[TIP_DEFLECTION, TIP_DEFLECTION] += parameters.tip_mass_kg + parameters.payload_kg
    mass[-1, -1] += parameters.tip_inertia_kg_m2
    squares, bending = eigenmodes(stiffness, mass, flexible, _ELEMENT_DOFS - 1)
    shapes = np.column_stack([_rigid_shape(parameters, mass), bending * np.sign(bending[0])])
    return BeamModes(
        omega_rad_per_s=np.sqrt(np.append(0.0, squares)),
        hub_angle=shapes[0],
        base_curvature=_curvatures(parameters, parameters.base_gauge_at_m, shapes),
        middle_curvature=_curvatures(parameters, parameters.middle_gauge_at_m, shapes),
        momentum=np.einsum("ij,jk", mass, shapes),
        shapes=shapes,
    )


def carried_over(before: BeamModes, after: BeamModes) -> NDArray[np.float64]:
    """Return the matrix from old to new modal coordinates, for an arm whose payload changes.

    The new modes are fitted to the deflection with the new mass as weight. They are few and cannot
    take every shape of the old ones. The hub's angle, which acts on the gear, is kept exactly.

    Parameters
    ----------
    before, after : BeamModes
        Modes of the same beam under different loads.

    Returns
    -------
    ndarray, (modes after, modes before)
        Matrix for positions and for velocities.
    """
    fitted: NDArray[np.float64] = np.einsum("ji,jk", after.momentum, before.shapes)
    missing = before.hub_angle - np.einsum("i,ij", after.hub_angle, fitted)
    return fitted + np.outer(after.hub_angle, missing) / np.sum(after.hub_angle**2)


def _assemble(parameters: RigParameters) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mass and stiffness over (slope_0, deflection_1, slope_1, ...), with a fixed root."""
    size_m = parameters.length_m / ELEMENTS
    scale = np.array([1.0, size_m, 1.0, size_m])
    scales = np.outer(scale, scale)
    mass_kg = parameters.mass_per_length_kg_per_m * size_m
    element_mass = mass_kg / 420.0 * _UNIT_MASS * scales
    element_stiffness = parameters.bending_stiffness_nm2 / size_m**3 * _UNIT_STIFFNESS * scales
    dofs = 2 * (ELEMENTS + 1)
    mass = np.zeros((dofs, dofs))
    stiffness = np.zeros((dofs, dofs))
    for element in range(ELEMENTS):
        span = slice(2 * element, 2 * element + _ELEMENT_DOFS)
        mass[span, span] += element_mass
        stiffness[span, span] += element_stiffness
    return mass[1:, 1:], stiffness[1:, 1:]


def _rigid_shape(parameters: RigParameters, mass: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the turning arm, normalised to unit modal mass."""
    shape = np.ones(len(mass))
    shape[1::2] = parameters.length_m / ELEMENTS * np.arange(1, ELEMENTS + 1)
    rigid: NDArray[np.float64] = shape / np.sqrt(np.einsum("i,ij,j", shape, mass, shape))
    return rigid


def _curvatures(
    parameters: RigParameters, at_m: float, shapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the curvature of the modes at a distance from the axis; the rigid one has none."""
    curvatures: NDArray[np.float64] = np.einsum("i,ij", _curvature_row(parameters, at_m), shapes)
    curvatures[0] = 0.0
    return curvatures


def _curvature_row(parameters: RigParameters, at_m: float) -> NDArray[np.float64]:
    """Return the row that takes the curvature of the deflection at a distance from the axis."""
    size_m = parameters.length_m / ELEMENTS
    position = at_m / size_m
    row = np.zeros(2 * (ELEMENTS + 1))
    # Elements share the slope at a node, not the curvature: a gauge on a node measures the mean.
    sharing = {min(max(int(np.floor(position + side)), 0), ELEMENTS - 1) for side in (-1e-9, 1e-9)}
    for element in sharing:
        xi = position - element
        second = [12.0 * xi - 6.0, (6.0 * xi - 4.0) * size_m]
        second += [6.0 - 12.0 * xi, (6.0 * xi - 2.0) * size_m]
        row[2 * element : 2 * element + _ELEMENT_DOFS] += np.array(second) / size_m**2
    return row[1:] / len(sharing)


def eigenmodes(
    stiffness: NDArray[np.float64], mass: NDArray[np.float64], count: int, bandwidth: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the slowest flexible modes of a structure with one rigid mode.

    Parameters
    ----------
    stiffness, mass : ndarray, (dofs, dofs)
        Symmetric matrices; the eigenvalues are distinct.
    count : int
        Number of flexible modes.
    bandwidth : int
        Diagonals on either side of the main one that are not zero.

    Returns
    -------
    squares : ndarray, (count,)
        Squares of the angular frequencies, ascending.
    shapes : ndarray, (dofs, count)
        Shapes, normalised to unit modal mass; their sign is open.
    """
    found, starts = scipy.linalg.eigh(stiffness, mass, subset_by_index=(1, count))
    squares, shapes = np.empty(count), np.empty((len(mass), count))
    mass_rows = _banded(mass, bandwidth)
    for mode, (square, start) in enumerate(zip(found.tolist(), starts.T, strict=True)):
        shift = float(f"{square:.{_COMMON_DIGITS}g}")
        factor = _factored(_banded(stiffness - shift * mass, bandwidth))
        largest = np.argmax(np.abs(start))
        shape = np.round(start / start[largest], _COMMON_DIGITS).tolist()
        gain = 0.0
        for _ in range(_STEPS):
            driven = _times(mass_rows, shape)
            moved = _solved(factor, driven)
            gain = _product(moved, driven) / _product(shape, driven)
            length = _product(moved, _times(mass_rows, moved)) ** 0.5
            shape = [each / length for each in moved]
        squares[mode], shapes[:, mode] = shift + 1.0 / gain, shape
    return squares, shapes


def _banded(matrix: NDArray[np.float64], bandwidth: int) -> Rows:
    """Return each row of a symmetric matrix from its diagonal on."""
    return [matrix[k, k : k + bandwidth + 1].tolist() for k in range(len(matrix))]


def _factored(rows: Rows) -> Rows:
    """Return the rows of L' D L: the diagonal of D, then what L' has beside its unit diagonal."""
    rows = [row[:] for row in rows]
    for k, (pivot, *beside) in enumerate(rows):
        factors = [each / pivot for each in beside]
        for i, factor in enumerate(factors):
            for j in range(i, len(beside)):
                rows[k + 1 + i][j - i] -= factor * beside[j]
        rows[k] = [pivot, *factors]
    return rows


def _solved(factor: Rows, right: list[float]) -> list[float]:
    solution = right[:]
    for k, (_, *factors) in enumerate(factor):
        for i, each in enumerate(factors, start=1):
            solution[k + i] -= each * solution[k]
    for k in reversed(range(len(factor))):
        pivot, *factors = factor[k]
        value = solution[k] / pivot
        for i, each in enumerate(factors, start=1):
            value -= each * solution[k + i]
        solution[k] = value
    return solution


def _times(rows: Rows, vector: list[float]) -> list[float]:
    """Return the product of a symmetric matrix, given by `_banded`, and a vector."""
    result = [0.0] * len(vector)
    for k, (diagonal, *beside) in enumerate(rows):
        result[k] += diagonal * vector[k]
        for i, each in enumerate(beside, start=1):
            result[k] += each * vector[k + i]
            result[k + i] += each * vector[k]
    return result


def _product(one: list[float], other: list[float]) -> float:
    # In the order of the entries: a library's sum goes by the width of the processor's registers.
    total = 0.0
    for a, b in zip(one, other, strict=True):
        total += a * b
    return total
