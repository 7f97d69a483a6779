"""Benchmark of control of the tip: the same arm, controlled by its hub and by its tip.

The packaged arm `thesis-tip`, or `mujoco-tip`, is recorded with 200 g for 40 s under a soft loop,
and each servo is what `flexarm design` makes of that record; one that does without strain and
acceleration gets the columns of the other signals alone. Beside them stand a collocated PD with
compensation of the dry friction, the same behind a ZV shaper for the vibration that a held hub
leaves, with the figures of MuJoCo's own model, and on `thesis-tip` the law `planned`. All step the
tip by 0.5 rad, with 0, 200 and 400 g.
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
from flexarm_control import build_law
from flexarm_control.design.criteria import unit_step_figures
from flexarm_control.servo.controller import Servo
from flexarm_control.shaping.shapers import Vibration, shaper_parts
from flexarm_core.channels import CHANNEL_NAMES, POSITION_V_PER_RAD
from flexarm_core.errors import FlexarmError
from flexarm_core.rig_description import load_rig
from flexarm_daq.drivers.mujoco.rig import MujocoRig
from flexarm_daq.drivers.registry import driven
from flexarm_daq.drivers.tip_rig import TipRig

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import RigDescription
    from flexarm_daq.rigs.rig_protocol import Rig

_DT_S = 1.0 / 300.0
_PAYLOADS_KG, _RECORDED_KG = (0.0, 0.2, 0.4), 0.2
# Torque of a unit of the input, N m: the rigs are one arm.
_RIGS = {"thesis-tip": 0.55, "mujoco-tip": 1.0}
_RECORD_S, _BEFORE_S, _STEP_S, _LAST_S = 40.0, 0.5, 8.0, 1.0
_STEP_RAD, _BAND = 0.5, 0.02
# Gains of the PD, N m/rad and N m s/rad: a larger one on the speed rings at 300 Hz. Then the
# friction of the joint, and the error below which its compensation fades.
_KP, _KD, _LEVEL_NM, _FADES_RAD = 3.0, 0.8, 0.352, 0.01
# Of the arm whose hub is held, with 200 g.
_HELD = Vibration(1.4, 0.01)
_SERVOS = {
    "servo of the hub": ("hub", ("hub", "strain", "speed")),
    "servo of the tip: camera alone": ("tip", ("tip",)),
    "servo of the tip: camera": ("tip", ("hub", "speed", "tip")),
    "with strain": ("tip", ("hub", "strain", "speed", "tip")),
    "with acceleration": ("tip", ("hub", "strain", "speed", "tip", "acceleration")),
}
"""Tracked output and outputs of each servo."""


@dataclass(frozen=True)
class Arm:
    """A rig by the names that its signals have here.

    Attributes
    ----------
    rig : RigDescription
        The rig.
    torque_nm : float
        Torque of a unit of its input.
    """

    rig: RigDescription
    torque_nm: float

    @property
    def places(self) -> dict[str, int]:
        """Places of the outputs by name."""
        (joint,), (tracked,) = self.rig.joints, self.rig.tracked
        found = {"hub": joint.angle, "speed": str(joint.rate), "tip": tracked}
        by_quantity = {each.quantity: each.name for each in reversed(self.rig.outputs)}
        found |= {"strain": by_quantity["moment"], "acceleration": by_quantity["acceleration"]}
        return {name: self.rig.output_names.index(output) for name, output in found.items()}

    def opened(self, payload_kg: float, seed: int) -> Rig:
        """Return the arm with a payload, at rest."""
        settings = {**self.rig.settings, "payload_kg": payload_kg, "seed": seed}
        made = driven(replace(self.rig, settings=settings), Path())
        made.open()
        return made


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

    def __init__(self, arm: Arm, parts: FloatArray | None = None) -> None:
        self.outputs = arm.rig.output_names
        self._arm, self._parts = arm, np.ones(1) if parts is None else parts
        self._hub, self._speed = arm.places["hub"], arm.places["speed"]
        self.reset()

    def reset(self) -> None:
        """Begin anew."""
        self._newest = np.zeros(len(self._parts))

    def step(self, y: Sequence[float], r: Sequence[float]) -> list[float]:
        """Return the input for a sample; the set-point is in rad."""
        outputs, limit = self._arm.rig.outputs, self._arm.rig.inputs[0].high
        angle_rad, speed = (outputs[i].to_si(y[i]) for i in (self._hub, self._speed))
        self._newest = np.append(r[0], self._newest[:-1])
        error = float(self._parts @ self._newest) - angle_rad
        pushed = _LEVEL_NM * np.clip(error / _FADES_RAD, -1.0, 1.0)
        torque_nm = _KP * error - _KD * speed + pushed
        return [float(np.clip(torque_nm / self._arm.torque_nm, -limit, limit))]


class ThesisLaw:
    """A control law of the thesis's arm, which sees its four sensors."""

    outputs = CHANNEL_NAMES

    def __init__(self, name: str) -> None:
        self._law = build_law(name)

    def reset(self) -> None:
        """Begin anew."""
        self._law.reset()

    def step(self, y: Sequence[float], r: Sequence[float]) -> list[float]:
        """Return the command for a sample; the set-point is in rad."""
        return [sum(self._law.step(y, POSITION_V_PER_RAD * r[0]))]


@click.command()
@click.option("--rig", "name", type=click.Choice(list(_RIGS)), default="thesis-tip", help="Arm.")
@json_option
def main(*, name: str, json_file: Path | None) -> None:
    """Design, step and compare, and write the figures to a file on request."""
    arm = Arm(load_rig(name), _RIGS[name])
    with tempfile.TemporaryDirectory() as folder:
        try:
            recorded = record(arm, Path(folder))
            made: dict[str, Servo | Pd | ThesisLaw] = {
                "PD of the hub": Pd(arm),
                "PD of the hub behind ZV": Pd(arm, shaper_parts("zv", _HELD, _DT_S)),
            }
            if set(CHANNEL_NAMES) <= set(arm.rig.output_names):
                made["planned"] = ThesisLaw("planned")
            for each, (tracked, outputs) in _SERVOS.items():
                words = ["--input", arm.rig.input_names[0]]
                for output in outputs:
                    words += ["--output", arm.rig.output_names[arm.places[output]]]
                words += ["--track", arm.rig.output_names[arm.places[tracked]]]
                out = Path(folder, each.replace(" ", "_").replace(":", ""))
                made[each], figures = designed(recorded, words, out)
                terminal.CONSOLE.print(
                    f"{each}: bandwidth {figures['bandwidth_hz']:.2f} Hz, {figures['limited_by']}",
                    *figures["notes"],
                    sep="\n  ",
                )
            steps = [
                stepped(arm, each, controller, payload_kg)
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


def record(arm: Arm, folder: Path) -> Path:
    """Record the arm under the PD with moves and a random binary torque, as CSV."""
    rng, rig, law = np.random.default_rng(0), arm.opened(_RECORDED_KG, 1), Pd(arm)
    limit, rows, goal, push = 5.5 / arm.torque_nm, [], 0.0, 0.0
    for k in range(round(_RECORD_S / _DT_S)):
        y = list(rig.read().outputs)
        if k % round(1.0 / _DT_S) == 0:
            goal = rng.uniform(-0.5, 0.5)
        if k % round(0.02 / _DT_S) == 0:
            push = 1.5 / arm.torque_nm * rng.choice([-1.0, 1.0])
        u = [float(np.clip(law.step(y, [goal])[0] + push, -limit, limit))]
        rig.write(u)
        rows.append([k * _DT_S, *u, *y])
    rig.close()
    file = folder / "record.csv"
    head = ",".join(["time_s", *arm.rig.input_names, *arm.rig.output_names])
    np.savetxt(file, rows, delimiter=",", header=head, comments="", fmt="%.9g")
    return file


def stepped(arm: Arm, name: str, controller: Servo | Pd | ThesisLaw, payload_kg: float) -> Step:
    """Step the arm with a controller, and judge the tip's own motion, without its camera."""
    rig = arm.opened(payload_kg, 2)
    columns = [arm.rig.output_names.index(output) for output in controller.outputs]
    goal = _STEP_RAD
    if isinstance(controller, Servo):
        (tracked,) = controller.tracked
        goal *= arm.rig.outputs[arm.rig.output_names.index(tracked)].per_si or 1.0
    controller.reset()
    tip_rad, efforts = [], []
    begin, count = round(_BEFORE_S / _DT_S), round((_BEFORE_S + _STEP_S) / _DT_S)
    for k in range(count):
        y = list(rig.read().outputs)
        u = controller.step([y[i] for i in columns], [goal if k >= begin else 0.0])
        rig.write(u)
        tip_rad.append(_tip_rad(rig, arm))
        efforts.append(u[0])
    rig.close()
    progress = np.array(tip_rad[begin:]) / _STEP_RAD
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
        float(arm.torque_nm * np.sqrt(np.mean(np.square(efforts[begin:])))),
    )


def _tip_rad(rig: Rig, arm: Arm) -> float:
    """Return where the tip is, without its camera."""
    if isinstance(rig, TipRig):
        return rig.tip_rad()
    assert isinstance(rig, MujocoRig)  # noqa: S101 - one of `_RIGS`
    return float(rig.arm.outputs()[arm.places["tip"]])


if __name__ == "__main__":
    main()
