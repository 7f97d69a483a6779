"""Benchmark of control of the tip: the same arm in MuJoCo, controlled by its hub and by its tip.

The packaged arm `mujoco-tip` is recorded with 200 g for 40 s under a soft loop, and each servo is
what `flexarm design` makes of that record; one that does without strain and acceleration gets the
columns of the other signals alone. Beside them stand a collocated PD with compensation of the dry
friction, and the same behind a ZV shaper for the vibration that a held hub leaves, with the figures
of MuJoCo's own model. All step the tip by 0.5 rad, with 0, 200 and 400 g.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from rich.progress import track

from bench.control.servo import designed
from bench.tools import json_option, make_table, write_json
from flexarm_bringup.console import terminal
from flexarm_control.design.criteria import unit_step_figures
from flexarm_control.shaping.shapers import Vibration, shaper_parts
from flexarm_core.errors import FlexarmError
from flexarm_core.rig_description import load_rig
from flexarm_daq.drivers.registry import driven

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_control.servo.controller import Servo
    from flexarm_core.arrays import FloatArray
    from flexarm_daq.rigs.rig_protocol import Rig

_RIG = load_rig("mujoco-tip")
_DT_S = 1.0 / _RIG.rate_hz
_PAYLOADS_KG, _RECORDED_KG = (0.0, 0.2, 0.4), 0.2
_RECORD_S, _BEFORE_S, _STEP_S, _LAST_S = 40.0, 0.5, 8.0, 1.0
_STEP_RAD, _BAND = 0.5, 0.02
# Gains of the PD, N m/rad and N m s/rad: a larger one on the speed rings at 300 Hz. Then the
# friction of the joint, and the error below which its compensation fades.
_KP, _KD, _LEVEL_NM, _FADES_RAD = 3.0, 0.8, 0.352, 0.01
# Of the arm whose hub is held, with 200 g.
_HELD = Vibration(1.4, 0.01)
_TIP, _HUB, _SPEED = (_RIG.output_names.index(n) for n in ("tip_rad", "hub_rad", "hub_rad_per_s"))
_SERVOS: dict[str, tuple[str, tuple[str, ...]]] = {
    "servo of the hub": ("hub_rad", ("hub_rad", "base_nm", "hub_rad_per_s")),
    "servo of the tip: camera": ("tip_rad", ("hub_rad", "tip_rad", "hub_rad_per_s")),
    "with strain": ("tip_rad", ("hub_rad", "tip_rad", "base_nm", "hub_rad_per_s")),
    "with strain and acceleration": ("tip_rad", _RIG.output_names),
}


@dataclass(frozen=True)
class Step:
    """Figures of the tip's own motion: parts of the step, s, rad and N m."""

    controller: str
    payload_kg: float
    settling_s: float
    overshoot: float
    steady_error: float
    residual_rad: float
    effort_nm: float


class Pd:
    """Collocated PD of the hub with compensation of dry friction, perhaps behind a shaper."""

    outputs = _RIG.output_names

    def __init__(self, parts: FloatArray | None = None) -> None:
        self._parts = np.ones(1) if parts is None else parts
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._newest = np.zeros(len(self._parts))

    def step(self, y: Sequence[float], r: Sequence[float]) -> list[float]:
        """Return the torque for a sample."""
        self._newest = np.append(r[0], self._newest[:-1])
        error = float(self._parts @ self._newest) - y[_HUB]
        pushed = _LEVEL_NM * np.clip(error / _FADES_RAD, -1.0, 1.0)
        limit = _RIG.inputs[0].high
        return [float(np.clip(_KP * error - _KD * y[_SPEED] + pushed, -limit, limit))]


@click.command()
@json_option
def main(*, json_file: Path | None) -> None:
    """Design, step and compare, and write the figures to a file on request."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            recorded = record(folder)
            made: dict[str, Servo | Pd] = {
                "PD of the hub": Pd(),
                "PD of the hub behind ZV": Pd(shaper_parts("zv", _HELD, _DT_S)),
            }
            for each, (tracked, outputs) in _SERVOS.items():
                out = folder / each.replace(" ", "_").replace(":", "")
                words = [word for output in outputs for word in ("--output", output)]
                words += ["--input", "motor_nm", "--track", tracked]
                made[each], figures = designed(recorded, words, out)
                terminal.CONSOLE.print(
                    f"{each}: bandwidth {figures['bandwidth_hz']:.2f} Hz, {figures['limited_by']}",
                    *figures["notes"],
                    sep="\n  ",
                )
            steps = [
                stepped(each, controller, payload_kg)
                for each, controller in track(made.items())
                for payload_kg in _PAYLOADS_KG
            ]
        except FlexarmError as error:
            raise click.ClickException(str(error)) from None
    heads = ("controller", "settling s", "overshoot %", "error %", "residual mrad", "effort N m")
    table = make_table(*heads)
    for each in made:
        own = [step for step in steps if step.controller == each]
        cells = (
            [f"{step.settling_s:.2f}" if np.isfinite(step.settling_s) else "-" for step in own],
            [f"{100.0 * step.overshoot:.1f}" for step in own],
            [f"{100.0 * step.steady_error:+.2f}" for step in own],
            [f"{1e3 * step.residual_rad:.1f}" for step in own],
            [f"{step.effort_nm:.2f}" for step in own],
        )
        table.add_row(each, *map(" ".join, cells))
    terminal.show_table(table)
    terminal.CONSOLE.print("three figures: 0, 200 and 400 g; settling within 2 % of the step")
    write_json(json_file, steps)


def record(folder: Path) -> Path:
    """Record the arm under the PD with moves and a random binary torque, as CSV."""
    rng, rig, law = np.random.default_rng(0), _opened(_RECORDED_KG, 1), Pd()
    rows, goal, push = [], 0.0, 0.0
    for k in range(round(_RECORD_S / _DT_S)):
        y = list(rig.read().outputs)
        if k % round(1.0 / _DT_S) == 0:
            goal = rng.uniform(-0.5, 0.5)
        if k % round(0.02 / _DT_S) == 0:
            push = 1.5 * rng.choice([-1.0, 1.0])
        u = [float(np.clip(law.step(y, [goal])[0] + push, -5.5, 5.5))]
        rig.write(u)
        rows.append([k * _DT_S, *u, *y])
    rig.close()
    file = folder / "record.csv"
    head = ",".join(["time_s", *_RIG.input_names, *_RIG.output_names])
    np.savetxt(file, rows, delimiter=",", header=head, comments="", fmt="%.9g")
    return file


def stepped(name: str, controller: Servo | Pd, payload_kg: float) -> Step:
    """Step the arm with a controller, and judge the tip's own motion, without its camera."""
    rig, columns = _opened(payload_kg, 2), [_RIG.output_names.index(n) for n in controller.outputs]
    controller.reset()
    tip, efforts = [], []
    begin, count = round(_BEFORE_S / _DT_S), round((_BEFORE_S + _STEP_S) / _DT_S)
    for k in range(count):
        y = list(rig.read().outputs)
        u = controller.step([y[i] for i in columns], [_STEP_RAD if k >= begin else 0.0])
        rig.write(u)
        tip.append(rig.arm.outputs()[_TIP])  # type: ignore[attr-defined]
        efforts.append(u[0])
    rig.close()
    progress = np.array(tip[begin:]) / _STEP_RAD
    time_s = _DT_S * np.arange(len(progress))
    overshoot, settling_s, _ = unit_step_figures(time_s, progress, _BAND)
    last = progress[-round(_LAST_S / _DT_S) :]
    return Step(
        name,
        payload_kg,
        settling_s,
        overshoot,
        float(last.mean() - 1.0),
        float(_STEP_RAD * np.ptp(last) / 2.0),
        float(np.sqrt(np.mean(np.square(efforts[begin:])))),
    )


def _opened(payload_kg: float, seed: int) -> Rig:
    settings = {**_RIG.settings, "payload_kg": payload_kg, "seed": seed}
    rig = driven(replace(_RIG, settings=settings), Path())
    rig.open()
    return rig


if __name__ == "__main__":
    main()
