"""Euler-Bernoulli beam, pinned at a hub with inertia and carrying a mass at its tip.

Twenty-four cubic Hermite elements; the transverse deflection is zero on the axis and the slope
there is the hub's angle. See any text on structural dynamics for the element matrices, and
`docs/rig.md` for the equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.rig_parameters import RigParameters

ELEMENTS = 24
FLEXIBLE_MODES = 6

_ELEMENT_DOFS = 4


@dataclass(frozen=True)
class BeamModes:
    """Mass-normalised modes of a beam that turns freely with its hub, the rigid mode first.

    Attributes
    ----------
    omega_rad_per_s : ndarray, shape (modes,)
        Angular natural frequencies; the first is zero.
    hub_angle : ndarray, shape (modes,)
        Hub angle of each mode: its participation in a torque at the hub.
    base_curvature, middle_curvature : ndarray, shape (modes,)
        Second derivative of the deflection at the two gauges.
    momentum : ndarray, shape (dofs, modes)
        Mass matrix times mode shapes: projects a deflection on the modes.
    shapes : ndarray, shape (dofs, modes)
        Slopes and deflections of the nodes in each mode.
    """

    omega_rad_per_s: NDArray[np.float64]
    hub_angle: NDArray[np.float64]
    base_curvature: NDArray[np.float64]
    middle_curvature: NDArray[np.float64]
    momentum: NDArray[np.float64]
    shapes: NDArray[np.float64]


def natural_frequencies_hz(parameters: RigParameters, count: int = 3) -> NDArray[np.float64]:
    """Natural frequencies of the whole arm: both hub inertias, beam, tip mass and payload.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    count : int
        How many flexible modes; the rigid one is left out.

    Returns
    -------
    ndarray, shape (count,)
        Frequencies in Hz, ascending.

    Raises
    ------
    SettingError
        If `count` is not between 1 and the number of elements, beyond which the mesh says nothing.
    """
    if not 1 <= count <= ELEMENTS:
        raise SettingError(f"count must be between 1 and {ELEMENTS}, got {count}")
    hub_kg_m2 = parameters.motor_inertia_kg_m2 + parameters.load_inertia_kg_m2
    modes = hub_beam_modes(parameters, hub_kg_m2, count)
    return modes.omega_rad_per_s[1:] / (2.0 * np.pi)


def arm_modes(parameters: RigParameters) -> BeamModes:
    """Modes of the load side of the gear: its hub, beam, tip mass and payload.

    Parameters
    ----------
    parameters : RigParameters
        The rig.

    Returns
    -------
    BeamModes
        One rigid and `FLEXIBLE_MODES` flexible modes.
    """
    return hub_beam_modes(parameters, parameters.load_inertia_kg_m2, FLEXIBLE_MODES)


def hub_beam_modes(parameters: RigParameters, hub_kg_m2: float, flexible: int) -> BeamModes:
    """Modes of the beam with a given inertia at its hub.

    Parameters
    ----------
    parameters : RigParameters
        The beam, its tip mass and payload.
    hub_kg_m2 : float
        Inertia that turns with the beam's root.
    flexible : int
        Number of flexible modes.

    Returns
    -------
    BeamModes
        One rigid and `flexible` flexible modes, each with a positive hub angle.
    """
    mass, stiffness = _assemble(parameters)
    mass[0, 0] += hub_kg_m2
    mass[-2, -2] += parameters.tip_mass_kg + parameters.payload_kg
    mass[-1, -1] += parameters.tip_inertia_kg_m2
    squares, shapes = eigh(stiffness, mass, subset_by_index=(0, flexible))
    # The rigid mode's eigenvalue is a rounding error of either sign.
    squares[0] = 0.0
    shapes *= np.sign(shapes[0])
    return BeamModes(
        omega_rad_per_s=np.sqrt(squares),
        hub_angle=shapes[0],
        base_curvature=_curvature_row(parameters, parameters.base_gauge_at_m) @ shapes,
        middle_curvature=_curvature_row(parameters, parameters.middle_gauge_at_m) @ shapes,
        momentum=mass @ shapes,
        shapes=shapes,
    )


def carried_over(before: BeamModes, after: BeamModes) -> NDArray[np.float64]:
    """Modal coordinates of a deflection when the arm's modes change, as with its payload.

    The new modes are fitted to the deflection with the new mass as weight. They are few and cannot
    take every shape of the old ones; the hub's angle, which the gear feels, is kept exactly.

    Parameters
    ----------
    before, after : BeamModes
        Modes of the same beam under different loads.

    Returns
    -------
    ndarray, shape (modes after, modes before)
        Takes positions to positions and velocities to velocities.
    """
    fitted: NDArray[np.float64] = after.momentum.T @ before.shapes
    missing = before.hub_angle - after.hub_angle @ fitted
    return fitted + np.outer(after.hub_angle, missing) / (after.hub_angle @ after.hub_angle)


def _assemble(parameters: RigParameters) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mass and stiffness over (slope_0, deflection_1, slope_1, ...): the root does not deflect."""
    size_m = parameters.length_m / ELEMENTS
    scale = np.array([1.0, size_m, 1.0, size_m])
    scales = np.outer(scale, scale)
    element_mass = (
        parameters.mass_per_length_kg_per_m
        * size_m
        / 420.0
        * np.array(
            [
                [156.0, 22.0, 54.0, -13.0],
                [22.0, 4.0, 13.0, -3.0],
                [54.0, 13.0, 156.0, -22.0],
                [-13.0, -3.0, -22.0, 4.0],
            ]
        )
        * scales
    )
    element_stiffness = (
        parameters.bending_stiffness_nm2
        / size_m**3
        * np.array(
            [
                [12.0, 6.0, -12.0, 6.0],
                [6.0, 4.0, -6.0, 2.0],
                [-12.0, -6.0, 12.0, -6.0],
                [6.0, 2.0, -6.0, 4.0],
            ]
        )
        * scales
    )
    dofs = 2 * (ELEMENTS + 1)
    mass = np.zeros((dofs, dofs))
    stiffness = np.zeros((dofs, dofs))
    for element in range(ELEMENTS):
        span = slice(2 * element, 2 * element + _ELEMENT_DOFS)
        mass[span, span] += element_mass
        stiffness[span, span] += element_stiffness
    return mass[1:, 1:], stiffness[1:, 1:]


def _curvature_row(parameters: RigParameters, at_m: float) -> NDArray[np.float64]:
    """Row that takes the second derivative of the deflection at a distance from the axis."""
    size_m = parameters.length_m / ELEMENTS
    position = at_m / size_m
    row = np.zeros(2 * (ELEMENTS + 1))
    # Elements meet with the same slope, not the same curvature: a gauge on a node sees the mean.
    sharing = {min(max(int(np.floor(position + side)), 0), ELEMENTS - 1) for side in (-1e-9, 1e-9)}
    for element in sharing:
        xi = position - element
        second = [12.0 * xi - 6.0, (6.0 * xi - 4.0) * size_m]
        second += [6.0 - 12.0 * xi, (6.0 * xi - 2.0) * size_m]
        row[2 * element : 2 * element + _ELEMENT_DOFS] += np.array(second) / size_m**2
    return row[1:] / len(sharing)
