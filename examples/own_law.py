"""A control law of your own, PI-D with anti-windup, beside a packaged one.

FLEXARM_LAWS=$PWD/examples/own_law.py ./flexarm up --law pid
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control import Effort, LawSpec, build_law, limited, simulate, step_figures
from flexarm_core.specs import Bounded, setting
from flexarm_daq import RigParameters, SimulatedRig

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

PERIOD_S, AT_REST_V = 1.0 / 300.0, 0.1


@dataclass(frozen=True)
class PidGains(Bounded):
    """Gains with default, range, unit and text: each becomes a parameter of the controller."""

    kp: float = setting(0.8, 0.0, 5.0, "V/V", "gain on the error")
    ki: float = setting(0.3, 0.0, 5.0, "1/s", "gain on the integral of the error")
    kd: float = setting(3.3, 0.0, 20.0, "V/V", "gain of the speed feedback")
    friction_v: float = setting(0.6, 0.0, 2.0, "V", "command against friction")


class Pid:
    """PI-D law whose integral stands while the drive is saturated or the arm moves."""

    def __init__(self, gains: PidGains) -> None:
        self.gains = gains
        self.reset()

    def reset(self) -> None:
        """Return to the state before the first sample."""
        self.integral_vs = 0.0

    def memory(self) -> Mapping[str, Sequence[float]]:
        """Return what the law has in memory, which a record keeps for its replay."""
        return {"integral_vs": (self.integral_vs,)}

    def remember(self, memory: Mapping[str, Sequence[float]]) -> None:
        """Go on from a memory."""
        (self.integral_vs,) = memory["integral_vs"]

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        """Answer position, base strain, middle strain and speed, V, within the drive's range."""
        gains, error_v = self.gains, reference_v - volts[0]
        effort_v = gains.kp * error_v + gains.ki * self.integral_vs - gains.kd * volts[3]
        answer = limited(effort_v, gains.friction_v * float(np.tanh(effort_v / 0.1)))
        if answer.effort_v == effort_v and abs(volts[3]) < AT_REST_V:
            self.integral_vs += error_v * PERIOD_S
        return answer


LAWS = (LawSpec("pid", "PI-D with anti-windup, an example", Pid, (PidGains,)),)

if __name__ == "__main__":
    for name, law in (("pid", Pid(PidGains())), ("pdpc", build_law("pdpc"))):
        rig = SimulatedRig(RigParameters(payload_kg=0.2), seed=1)
        run = simulate(rig, law, np.full(3000, 3.0))
        print(f"{name}: {step_figures(run.time_s, run.y[:, 0], 3.0)}")
