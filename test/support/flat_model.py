"""Flat model of the arm by its equations of motion, apart from the plans that are made with it."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import expm

from flexarm_control.planning.flat_arm import SPEED_PER_POSITION_S

if TYPE_CHECKING:
    from flexarm_control.planning.flat_arm import FlatArm


def equations(arm: FlatArm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B and C of the model: r, r', q, q'; position, middle gauge and speed."""
    w, drag, gain = 2.0 * pi * arm.frequency_hz, arm.drag_per_s, arm.gain_per_s2
    decay, share, tau = 2.0 * arm.damping_ratio * w, arm.hub_share, SPEED_PER_POSITION_S
    A = np.array([[0, 1, 0, 0], [0, -drag, 0, 0], [0, 0, 0, 1], [0, 0, -(w**2), -decay]])
    B = np.array([[0.0], [gain], [0.0], [gain]])
    bend = arm.middle_strain_s2 * w**2
    C = np.array([[1, 0, share, 0], [0, 0, bend, 0], [0, tau, 0, tau * share]])
    return A, B, C


def held(arm: FlatArm, rate_hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the model with its input held over a period."""
    A, B, C = equations(arm)
    transition = expm(np.block([[A, B], [np.zeros((1, 5))]]) / rate_hz)
    return transition[:4, :4], transition[:4, 4:], C
