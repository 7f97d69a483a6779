"""Gains from an identified model, with margins and a simulated step, without ROS."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexarm_control import Pdp, simulate_loop, step_figures, tune_pdp
from flexarm_ident import identify, preprocess, read_bag, reduce_model

BAG = Path(__file__).parents[1] / "bags" / "c_dat3_0g"
SETPOINT_V, LENGTH_S, DELAY_S = 3.0, 4.0, 0.001


def main() -> None:
    """Identify and reduce a model, tune the PDP law on it, and step the loop."""
    data = preprocess(read_bag(BAG))
    full = identify(data, order=20)
    model = reduce_model(full, data, ranking="mrm", order=10).model

    tuning = tune_pdp([model], delay_s=DELAY_S)
    gains, (found,) = tuning.gains, tuning.margins
    print(f"kp {gains.kp:.4f}  kd {gains.kd:.4f}  ksg {gains.ksg:.4f}")
    print(f"margins: {found.gain_margin_db:.1f} dB, {found.phase_margin_deg:.0f} deg")

    reference_v = np.full(round(LENGTH_S / model.dt), SETPOINT_V)
    run = simulate_loop(model, Pdp(gains), reference_v)
    step = step_figures(run.time_s, run.y[:, 0], SETPOINT_V)
    print(f"overshoot {step.overshoot:.1%}, settling time (5 %) {step.settling_s:.2f} s")


if __name__ == "__main__":
    main()
