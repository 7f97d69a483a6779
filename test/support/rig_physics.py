"""Energy and inertia of the simulated rig, by the formulas of mechanics."""

from __future__ import annotations

import math
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from flexarm_daq.nodes.joint_view import BENDS
from flexarm_daq.rigs.beam import arm_modes
from flexarm_daq.rigs.equations import ARM, MOTOR, POSITION, VELOCITY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexarm_daq.rigs.plant import Plant
    from flexarm_daq.rigs.rig_parameters import RigParameters

# An eigenproblem takes milliseconds, and the energy is asked for at each step.
_modes = cache(arm_modes)


def bends_at_m(rig: RigParameters) -> NDArray[np.float64]:
    """Return the distances from the axis of the virtual joints, in the middles of even pieces."""
    return rig.length_m * (np.arange(BENDS) + 0.5) / BENDS


def arm_angle_rad(plant: Plant) -> float:
    """Return the angle of the arm's hub."""
    return float(_modes(plant.parameters).hub_angle @ plant.state[POSITION, ARM:])


def energy_j(plant: Plant) -> float:
    """Return the kinetic and elastic energy of motor, arm, gear and stops; zero at rest."""
    rig = plant.parameters
    speed = plant.state[VELOCITY]
    modal = plant.state[POSITION, ARM:]
    motor_rad, arm_rad = plant.state[POSITION, MOTOR], arm_angle_rad(plant)
    tooth_rad = max(0.0, abs(motor_rad - arm_rad) - math.radians(rig.backlash_deg) / 2.0)
    stop_rad = max(0.0, abs(arm_rad) - math.radians(rig.stop_angle_deg))
    doubled = (
        rig.motor_inertia_kg_m2 * speed[MOTOR] ** 2
        + speed[ARM:] @ speed[ARM:]
        + modal @ (_modes(rig).omega_rad_per_s ** 2 * modal)
        + rig.gear_stiffness_nm_per_rad * tooth_rad**2
        + rig.stop_stiffness_nm_per_rad * stop_rad**2
    )
    return float(doubled) / 2.0


def arm_inertia_kg_m2(rig: RigParameters) -> float:
    """Return the inertia of hub, beam, tip mass and payload about the axis, as one rigid body."""
    beam = rig.mass_per_length_kg_per_m * rig.length_m**3 / 3.0
    tip = (rig.tip_mass_kg + rig.payload_kg) * rig.length_m**2
    return rig.load_inertia_kg_m2 + beam + tip + rig.tip_inertia_kg_m2
