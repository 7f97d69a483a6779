"""Log of an accelerometer on a printer whose axes are swept: modes at 38 and 61 Hz, no input."""

from __future__ import annotations

import sys

import numpy as np
import scipy

RATE_HZ = 1600.0
MODES = {"x": (38.0, 0.06), "y": (61.0, 0.04)}

t = np.arange(round(64.0 * RATE_HZ)) / RATE_HZ
push = (5.0 + 2.0 * t) * np.sin(2.0 * np.pi * (5.0 * t + t**2))
rng = np.random.default_rng(0)
columns = [t]
for frequency_hz, damping_ratio in MODES.values():
    omega = 2.0 * np.pi * frequency_hz / RATE_HZ
    pole = np.exp(omega * complex(-damping_ratio, np.sqrt(1.0 - damping_ratio**2)))
    moved = scipy.signal.lfilter([1.0, -2.0, 1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], push)
    columns.append(3000.0 * (moved / moved.std() + 0.2 * rng.standard_normal(len(t))))
columns.append(9800.0 + 0.2 * columns[1] + 0.2 * columns[2])
header = "time,accel_x,accel_y,accel_z"
np.savetxt(sys.argv[1], np.column_stack(columns), "%.6f", ",", header=header, comments="")
