"""Benchmark of the reference shapers: what each one gives and costs before a law.

Steps of 1, 3 and 5 V with 0, 200 and 400 g on the simulated rig, without the sensors' noise in the
figures. The law has its default gains, and the shaper the printed vibration of the payload.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import click
import numpy as np

from bench.tools import count_option, json_option, make_table, run_trials, write_json, write_table
from flexarm_bringup.console import terminal
from flexarm_control import LAWS, build_law, step_figures
from flexarm_control.shaping.shaped_law import ShapedLaw, nominal_vibrations
from flexarm_control.shaping.shapers import NONE, SHAPERS
from flexarm_daq import RigParameters
from reproduction.framework.rig import RATE_HZ, STEP_S, step_to

PAYLOADS_KG, SETPOINTS_V = (0.0, 0.2, 0.4), (1.0, 3.0, 5.0)
SETTLED_S = 3.0
_PAGE = Path(__file__).parents[2] / "docs" / "moves.md"
_LAWS = ("pdpc_plus",)
_HEADS = ("law", "shaper", "settling s, mean, worst", "overshoot", "gauge peak", "gauge 3-10 s")


@dataclass(frozen=True)
class ShapedStep:
    """One step; the figures are without sensor noise."""

    law: str
    shaper: str
    payload_kg: float
    setpoint_v: float
    seed: int
    settling_s: float
    overshoot: float
    peak_gauge_v: float
    residual_gauge_rms_v: float


@click.command()
@count_option("--seeds", 3)
@click.option("--law", "laws", multiple=True, type=click.Choice(tuple(LAWS)), default=_LAWS)
@json_option
@click.option("--docs", is_flag=True, help="Write the table of docs/moves.md.")
def main(*, seeds: int, laws: tuple[str, ...], json_file: Path | None, docs: bool) -> None:
    """Step with every shaper, and print what it costs beside no shaper."""
    cases = list(product(laws, (NONE, *SHAPERS), PAYLOADS_KG, SETPOINTS_V, range(seeds)))
    steps = run_trials(shaped_step, cases, chunk=4)
    rows = [figures(law, shaper, steps) for law, shaper in product(laws, (NONE, *SHAPERS))]
    table = make_table(*_HEADS, words=2)
    for row in rows:
        table.add_row(*row)
    terminal.show_table(table)
    write_json(json_file, steps)
    if docs:
        write_table(_PAGE, "shapers", _HEADS, rows)


def shaped_step(case: tuple[str, str, float, float, int]) -> ShapedStep:
    """Step the arm once."""
    name, shaper, payload_kg, setpoint_v, seed = case
    law = build_law(name)
    if shaper != NONE:
        vibrations = nominal_vibrations()
        law = ShapedLaw(law, shaper, vibrations, rate_hz=RATE_HZ, payload_kg=payload_kg)
    run = step_to(law, setpoint_v, arm=RigParameters(payload_kg=payload_kg), seed=seed)
    reached = step_figures(run.time_s, run.true_y[:, 0], setpoint_v)
    gauge_v = run.true_y[:, 1]
    return ShapedStep(
        *case,
        settling_s=min(reached.settling_s, STEP_S),
        overshoot=reached.overshoot,
        peak_gauge_v=float(np.max(np.abs(gauge_v))),
        residual_gauge_rms_v=float(np.sqrt(np.mean(gauge_v[run.time_s >= SETTLED_S] ** 2))),
    )


def figures(law: str, shaper: str, steps: list[ShapedStep]) -> tuple[str, ...]:
    """Return a row: the figures of a shaper, and beside them those over the ones of no shaper."""
    some, plain = (
        [each for each in steps if (each.law, each.shaper) == (law, name)]
        for name in (shaper, NONE)
    )

    def beside(name: str) -> tuple[float, float]:
        mean, without = (
            float(np.mean([getattr(s, name) for s in group])) for group in (some, plain)
        )
        return float(mean), float(mean / without)

    settling_s, slower = beside("settling_s")
    worst_s = max(each.settling_s for each in some)
    peak_v, peak_ratio = beside("peak_gauge_v")
    rms_v, rms_ratio = beside("residual_gauge_rms_v")
    return (
        f"`{law}`",
        f"`{shaper}`",
        f"{settling_s:.2f} ({slower:.2f}), {worst_s:.2f}",
        f"{max(each.overshoot for each in some):.1%}",
        f"{peak_v:.2f} V ({peak_ratio:.2f})",
        f"{rms_v:.4f} V ({rms_ratio:.2f})",
    )


if __name__ == "__main__":
    main()
