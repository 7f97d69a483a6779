"""Benchmark of `design --track` on arms in MuJoCo that nobody tuned it for.

Each arm is recorded for 40 s at 500 Hz under a soft loop, `flexarm design` with its defaults makes
a controller, and the controller steps the arm, also with another tip mass. Beside it steps the
same law, designed on MuJoCo's own linearisation with the true friction.
"""

from __future__ import annotations

import json
import resource
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from rich.progress import track

from bench.control.drawn_arms import LIMIT_NM, RATE_HZ, drawn_arm, record_arm, step_arm
from bench.tools import count_option, first_seed_option, json_option, make_table, write_json
from flexarm_bringup.console import terminal
from flexarm_control import load_controller
from flexarm_control.servo.controller import Servo
from flexarm_control.servo.job import ServoRequest, design_servo
from flexarm_control.servo.twin import Run, step_results
from flexarm_core.errors import FlexarmError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.control.drawn_arms import DrawnArm

_FLEXARM = Path(__file__).parents[2] / "flexarm"
_RECORD_S, _STEP_RAD = 40.0, 0.3
_TIPS = (1.0, 0.5, 1.5)
# Acceptance lines: parts of the step, settling over that of the true model, and of the trials.
_ERROR, _OVERSHOOT, _SLOWER, _TRIALS = 0.01, 0.05, 1.5, 0.9
# Part of the step that an arm which is held does not swing at its end.
_SWINGS = 0.1


@dataclass(frozen=True)
class Step:
    """Worst figures of the tracked outputs of a step; `at_end` is the largest error from 7 s on."""

    overshoot: float
    settling_s: float
    steady_error: float
    at_end: float


@dataclass(frozen=True)
class Trial:
    """One arm: its controller, the steps by tip mass, and that of the true model's controller."""

    kind: str
    seed: int
    bandwidth_hz: float
    disk_margin: float
    design_cpu_s: float
    steps: dict[str, Step]
    true: Step

    @property
    def stable(self) -> bool:
        """Whether every step has come to an end."""
        return all(each.at_end <= _SWINGS for each in self.steps.values())

    @property
    def well(self) -> bool:
        """Whether the step with the mass of the record keeps the acceptance lines."""
        step = self.steps[f"{_TIPS[0]:g}"]
        return bool(
            abs(step.steady_error) <= _ERROR
            and step.overshoot <= _OVERSHOOT
            and step.settling_s <= _SLOWER * self.true.settling_s
        )


@click.command()
@count_option("--arms", 6)
@first_seed_option
@json_option
def main(*, arms: int, first_seed: int, json_file: Path | None) -> None:
    """Design for every arm, print the table, and write the figures to a file on request."""
    seeds = range(first_seed, first_seed + arms)
    with tempfile.TemporaryDirectory() as folder:
        try:
            trials = [trial(drawn_arm(seed), Path(folder)) for seed in track(seeds)]
        except FlexarmError as error:
            raise click.ClickException(str(error)) from None
    heads = ("arm", "Hz", "margin", "CPU s", "overshoot %", "error %", "settling s", "true model s")
    table = make_table(*heads)
    for each in trials:
        table.add_row(
            f"{each.kind} {each.seed}",
            f"{each.bandwidth_hz:.2f}",
            f"{each.disk_margin:.2f}",
            f"{each.design_cpu_s:.0f}",
            " ".join(f"{100.0 * step.overshoot:.1f}" for step in each.steps.values()),
            " ".join(f"{100.0 * step.steady_error:+.2f}" for step in each.steps.values()),
            " ".join(f"{step.settling_s:.2f}" for step in each.steps.values()),
            f"{each.true.settling_s:.2f}",
        )
    terminal.show_table(table)
    stable, well = (sum(getattr(each, name) for each in trials) for name in ("stable", "well"))
    terminal.CONSOLE.print(
        f"three figures: tip masses of {', '.join(f'{100.0 * tip:.0f}' for tip in _TIPS)} %; "
        f"stable {stable} of {arms}; error <= 1 %, overshoot <= 5 % and settling <= 1.5 times that "
        f"of the true model {well} of {arms} (wanted {100.0 * _TRIALS:.0f} %)"
    )
    write_json(json_file, trials)


def trial(arm: DrawnArm, folder: Path) -> Trial:
    """Record an arm, design with the command's defaults, and step the arm."""
    record, out = record_arm(arm, folder, _RECORD_S), folder / f"design_{arm.seed}"
    tracked = [word for name in arm.tracked for word in ("--track", name)]
    before = _cpu_s()
    servo, summary = designed(record, tracked, out)
    cpu_s = _cpu_s() - before
    limits = dict.fromkeys(arm.inputs, LIMIT_NM)
    true = design_servo([arm.source(folder)], ServoRequest(tuple(arm.tracked), limits))
    return Trial(
        arm.kind,
        arm.seed,
        summary["bandwidth_hz"],
        summary["disk_margin"],
        cpu_s,
        {f"{tip:g}": _step(arm, folder, servo, tip) for tip in _TIPS},
        _step(arm, folder, Servo(true.gains), 1.0),
    )


def designed(record: Path, words: Sequence[str], out: Path) -> tuple[Servo, dict[str, Any]]:
    """Return what `flexarm design` makes of a record with some words, and its summary."""
    done = subprocess.run(  # noqa: S603 - words of the benchmarks
        [str(_FLEXARM), "design", str(record), *words, "-o", str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise click.ClickException(f"design failed on {record.name}: {done.stderr}")
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    return load_controller(out / "controller.yaml"), summary


def _step(arm: DrawnArm, folder: Path, servo: Servo, tip: float) -> Step:
    goal = np.full(len(arm.tracked), _STEP_RAD)
    tracked = step_arm(arm, folder, servo, goal, tip)
    y = np.zeros((len(tracked), len(servo.outputs)))
    y[:, servo.law.places] = tracked
    found = step_results(servo, Run(y, np.empty((len(y), 0))), goal)
    return Step(
        max(each.overshoot for each in found),
        max(each.settling_s for each in found),
        max((each.steady_error for each in found), key=abs),
        float(np.abs(tracked[-RATE_HZ:] / _STEP_RAD - 1.0).max()),
    )


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
