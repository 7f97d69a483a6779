"""A rig of one's own under a control law, without ROS: five methods."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_control import build_law, simulate, step_figures
from flexarm_daq.rigs.rig_protocol import Rig, RigSample

if TYPE_CHECKING:
    from collections.abc import Sequence

RATE_HZ, SETPOINT_V, LENGTH_S = 300.0, 2.0, 4.0
# Acceleration of the position by 1 V, lag of the motor, and volts of the tachometer.
GAIN_PER_S2, LAG_S, TACHO_S = 40.0, 0.2, 0.1


class RigidArm:
    """A stiff arm on a motor with viscous friction: a `Rig` by its methods alone."""

    def open(self) -> None:
        """Start at rest."""
        self.periods, self.position_v, self.rate_v_per_s = 0, 0.0, 0.0

    def read(self) -> RigSample:
        """Return position, two strains and speed; a stiff arm has no strain."""
        volts = np.array([self.position_v, 0.0, 0.0, TACHO_S * self.rate_v_per_s])
        return RigSample(self.periods / RATE_HZ, volts)

    def write(self, commands: Sequence[float]) -> None:
        """Move the arm over one period with the command in force."""
        (command_v,) = commands
        self.periods += 1
        self.position_v += self.rate_v_per_s / RATE_HZ
        self.rate_v_per_s += (GAIN_PER_S2 * command_v - self.rate_v_per_s / LAG_S) / RATE_HZ

    def safe_stop(self) -> None:
        """Leave the drive at zero."""

    def close(self) -> None:
        """Let go of the rig."""


def main() -> None:
    """Step the rig with PD control."""
    rig: Rig = RigidArm()
    run = simulate(rig, build_law("pd"), np.full(round(LENGTH_S * RATE_HZ), SETPOINT_V))
    rig.close()
    step = step_figures(run.time_s, run.y[:, 0], SETPOINT_V)
    print(f"mean error {step.mean_error_v:+.4f} V, settling time (5 %) {step.settling_s:.2f} s")


if __name__ == "__main__":
    main()
