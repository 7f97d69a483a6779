"""Course of a commissioning, stage by stage, with what each one found."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_bringup.console import terminal
from flexarm_bringup.runs.live_arm import answers_to_pulses
from flexarm_control.commissioning.answers import (
    ArmFaultError,
    accuracy,
    friction_levels,
    of_joints,
    soft_loop,
)
from flexarm_control.commissioning.programme import PARTS, PERIOD_S, RAMP_S, Programme
from flexarm_control.servo.controller import Servo
from flexarm_control.servo.job import ServoRequest, Source, design_servo
from flexarm_control.servo.robustness import ROBUSTNESS
from flexarm_control.servo.twin import Run, step_results, step_run
from flexarm_core.errors import FlexarmError, SettingError
from flexarm_core.outputs import MARK_KEY
from flexarm_core.waves import multisine
from flexarm_ident.diagnostics.best_linear import best_linear_approximation
from flexarm_ident.diagnostics.verdict import Level
from flexarm_ident.job import identify_bags
from flexarm_ident.workflow.request import Request

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from flexarm_bringup.runs.live_arm import Arm
    from flexarm_control.commissioning.answers import Friction, PulseAnswer, SoftLoop
    from flexarm_control.commissioning.programme import Measurement
    from flexarm_control.servo.job import ServoDesign
    from flexarm_control.servo.twin import StepResult
    from flexarm_core.arrays import FloatArray
    from flexarm_core.rig_description import RigDescription
    from flexarm_ident.job import Results
    from flexarm_ident.records.iodata import IoData

CONTROLLER_FILE = "servo/controller.yaml"
MODELS_FOLDER = "models"
# A part that grows by less is the same experiment: it adds data to the last one.
_GROWS = 1.2
# Part of the travel that a step covers at most: to either side of the middle.
_MOST_STEP = 0.5
STATE_FILE = "commission.json"


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps on the arm beside those that were predicted.

    Attributes
    ----------
    arm, twin : Run
        Outputs from where they were, and commands.
    steps : ndarray, (tracked,)
        The steps.
    results, predicted : tuple of StepResult
        Figures of both.
    """

    arm: Run
    twin: Run
    steps: FloatArray
    results: tuple[StepResult, ...]
    predicted: tuple[StepResult, ...]


class Commissioner:
    """Commissioning of one arm.

    Parameters
    ----------
    arm : Arm
        Where it is measured.
    rig : RigDescription
        Its description.
    state : State
        What was found before, and the goal.
    announce : callable, optional
        Shows what comes to somebody beside the user of the terminal.
    """

    def __init__(
        self,
        arm: Arm,
        rig: RigDescription,
        state: State,
        announce: Callable[[str], None] | None = None,
    ) -> None:
        self._arm, self._rig, self._state, self._announce = arm, rig, state, announce
        self._programme = Programme(rig)
        self._folder = state.folder
        self._results: dict[str, Results] = {}

    def answers(self) -> tuple[PulseAnswer, ...]:
        """Pulse each joint, and refuse wrong wiring, dead sensors and stuck joints."""
        found = answers_to_pulses(self._arm, self._rig, self._begin)
        self._state.note("pulses", [each._asdict() for each in found])
        return found

    def friction(self, loop: SoftLoop) -> tuple[Friction, ...]:
        """Move all joints slowly in the soft loop."""
        self._begin("Slow motion in a soft position loop, for the friction that excitation exceeds")
        records = [self._measured(each) for each in self._programme.friction(loop)]
        record = records[0]
        delay_s = self._arm.delay_s or self._state.found.get("loop", {}).get("delay_s", 0.0)
        self._state.note("loop", {"delay_s": delay_s, "samples": len(record)})
        terminal.CONSOLE.print(
            f"  {len(record)} samples at {1.0 / record.dt_s:.5g} Hz, delay of the loop "
            f"{1e3 * delay_s:.2g} ms"
        )
        found = friction_levels(records, self._rig, RAMP_S)
        for each, joint in zip(found, self._rig.joints, strict=True):
            unit = self._rig.input(joint.input).unit
            terminal.CONSOLE.print(
                f"  {each.joint}: {each.text} {unit} of dry friction, {each.viscous:.2g} {unit} "
                f"that grow with the speed, {each.offset:+.2g} {unit} to rest"
            )
        self._state.note("friction", [each._asdict() for each in found])
        return found

    def models(self, loop: SoftLoop, friction: Sequence[Friction]) -> tuple[str, ...]:
        """Excite in growing parts and identify after each, until a model is good enough.

        Returns
        -------
        tuple of str
            Names of the models to design with, the best one first: the one that is good enough, or
            else all that are usable, by their cross-validated errors.
        """
        magnitude_v = self._programme.first_v(friction)
        reason = "from a fifth of the limits on"
        bags: list[str] = []
        for number in range(1, PARTS + 1):
            wanted = self._programme.part(number, magnitude_v, loop, friction)
            self._begin(
                f"Part {number} of {PARTS} at most: multisine of {10.0 * magnitude_v:.0f} % of the "
                f"limits, {wanted.length_s:.0f} s, {reason}"
            )
            record = self._measured(wanted)
            self._show_distortion(record, wanted)
            bags.append(wanted.name)
            if wanted.name not in self._state.found:
                found = {"magnitude_v": magnitude_v, "bags": bags.copy()}
                self._state.note(wanted.name, found | self._judged(wanted.name, bags))
            hindrance = self._state.found[wanted.name]["hindrance"]
            if not hindrance:
                return (wanted.name,)
            reason = f"since {hindrance}"
            growth = self._programme.growth(record, magnitude_v)
            if growth >= _GROWS:
                magnitude_v *= growth
                bags.clear()
        parts = [f"part_{number}" for number in range(1, PARTS + 1)]
        parts.sort(key=lambda name: float(self._state.found[name]["error"]))
        best = self._state.found[parts[0]]
        hindrance = f"{best['hindrance']}, after {PARTS} parts"
        usable = [name for name in parts if self._state.found[name]["level"] <= Level.USABLE]
        if not usable:
            raise ArmFaultError(f"no model to design with: {hindrance}")
        terminal.note(f"caution: {hindrance}")
        return tuple(usable)

    def designed(self, names: Sequence[str]) -> tuple[Results, ServoDesign]:
        """Design on the first model whose servo has the margin, else on that with the largest.

        Raises
        ------
        SettingError
            When no model has a stabilising design.
        """
        found: list[tuple[Results, ServoDesign]] = []
        for name in names:
            results = self._identified(name, self._state.found[name]["bags"])
            try:
                found.append((results, self.design(results)))
            except SettingError as error:
                refused = error
                terminal.note(f"caution: {name} is left out: {error}")
                continue
            margin = found[-1][1].gains.disk_margin
            if margin >= ROBUSTNESS:
                return found[-1]
            terminal.note(f"caution: with {name} the disk margin is {margin:.2f}")
        if not found:
            raise refused
        return max(found, key=lambda each: each[1].gains.disk_margin)

    def design(self, results: Results) -> ServoDesign:
        """Design the servo on the model that was found."""
        outcome = results.outcome
        source = Source(results.name, outcome.model, outcome.friction, outcome.records[0])
        driven = outcome.records[0].inputs
        limits = {each.name: each.reach for each in self._rig.inputs if each.name in driven}
        if self._announce:
            self._announce("Design of the servo, then its step on the arm")
        with terminal.busy("designing servo"):
            delay_s = self._state.found["loop"]["delay_s"]
            request = ServoRequest(self._rig.tracked, limits, delay_s=delay_s)
            return design_servo([source], request)

    def step(self, design: ServoDesign) -> Steps:
        """Step the arm with the new controller, beside the twin of the model."""
        servo = Servo(design.gains)
        controller = str((self._folder / CONTROLLER_FILE).absolute())
        seconds = len(design.run.y) / design.gains.rate_hz
        self._begin(f"Step with the new controller, {seconds:.0f} s, beside that of the twin")
        joints = {each.angle: each for each in self._rig.joints}
        places = [self._rig.output_names.index(name) for name in design.gains.tracked]
        if not self._arm.bag("step").exists():
            self._arm.forget("hold")
        held = self._measured(self._programme.servo("hold", controller))
        start = held.y[-round(0.2 * len(held)) :].mean(axis=0)[places]
        steps = np.array(design.steps)
        targets = {}
        for number, name in enumerate(design.gains.tracked):
            if joint := joints.get(name):
                most = _MOST_STEP * joint.half_travel
                towards = 1.0 if start[number] <= joint.middle else -1.0
                steps[number] = towards * min(abs(steps[number]), most)
            targets[name] = float(start[number] + steps[number])
        if not self._arm.bag("step").exists():
            self._arm.set_references(targets)
        record = self._measured(self._programme.servo("step", controller, seconds))
        twin = step_run(servo, design.twin, steps, seconds, seed=0)
        y = record.y.copy()
        y[:, places] -= start
        arm = Run(y, record.u)
        found = Steps(
            arm, twin, steps, step_results(servo, arm, steps), step_results(servo, twin, steps)
        )
        for size, mine, other in zip(steps, found.results, found.predicted, strict=True):
            terminal.CONSOLE.print(
                f"  step of {mine.output} by {size:.3g}: overshoot {100.0 * mine.overshoot:.1f} % "
                f"({100.0 * other.overshoot:.1f} % predicted), steady error "
                f"{100.0 * mine.steady_error:+.2f} %"
            )
        return found

    def run(self) -> tuple[Results, ServoDesign]:
        """Go through all stages up to the design."""
        answers = self.answers()
        loop = soft_loop(answers, self._rig)
        friction = self.friction(loop)
        return self.designed(self.models(loop, friction))

    def _begin(self, words: str) -> None:
        """Tell the user what comes next and why, on the page too."""
        terminal.step(words)
        if self._announce:
            self._announce(words)

    def _measured(self, wanted: Measurement) -> IoData:
        return of_joints(self._arm.measured(wanted), self._rig)

    def _identified(self, name: str, bags: Sequence[str]) -> Results:
        """Return the model of some bags; once in a session."""
        if name not in self._results:
            with terminal.progress() as show:
                self._results[name] = identify_bags(
                    [self._arm.bag(each) for each in bags],
                    self._folder / MODELS_FOLDER / name,
                    Request(),
                    force=True,
                    read=lambda bag, *_: of_joints(self._arm.record(bag.name), self._rig),
                    progress=show,
                )
        return self._results[name]

    def _judged(self, name: str, bags: Sequence[str]) -> dict[str, Any]:
        """Print what a model is worth; return it, with what keeps it from being good enough."""
        outcome = self._identified(name, bags).outcome
        terminal.CONSOLE.print(f"  {outcome.verdict}")
        band = self._programme.band
        known = accuracy(outcome, self._rig, (band.low_hz, band.high_hz))
        figures = [
            f"{name} known to ±{100.0 * value:.2g} %"
            for name, value in (("modes", known.frequency), ("gains to angles", known.gain))
            if not math.isnan(value)
        ]
        # The errors of a model with friction show none.
        terminal.CONSOLE.print(f"  {', '.join(figures) or 'no ± of modes and gains is known'}")
        level = outcome.verdict.level
        hindrance = known.misses(self._state.settings["goal"])
        if level > Level.GOOD:
            hindrance = f"the model is {level}: {outcome.verdict.next_step}"
        return {"error": outcome.verdict.error, "level": int(level), "hindrance": hindrance}

    def _show_distortion(self, record: IoData, part: Measurement) -> None:
        """Print noise and distortion of an arm with one input."""
        period = PERIOD_S * self._rig.rate_hz
        if len(record.inputs) > 1 or period != round(period):
            return
        lines = multisine(self._programme.band, part.parameters["multisine.seed"]).harmonics
        found = best_linear_approximation(
            record.u[:, 0], record.y, dt_s=record.dt_s, period=round(period), harmonics=lines
        )
        levels = zip(
            record.outputs, found.noise_level, found.odd_level, found.even_level, strict=True
        )
        shown = ", ".join(
            f"{name} {100.0 * noise:.2g}/{100.0 * odd:.2g}/{100.0 * even:.2g} %"
            for name, noise, odd, even in levels
        )
        terminal.CONSOLE.print(f"  noise/odd/even distortion at a line: {shown}")


class StateError(FlexarmError):
    """State of another commissioning in the folder."""


@dataclass
class State:
    """Findings of the stages so far, in a file that is replaced as a whole.

    Attributes
    ----------
    folder : Path
        Folder of the commissioning.
    settings : dict
        What the stages rest on: the description's text and the goal.
    found : dict
        Findings by stage.
    """

    folder: Path
    settings: dict[str, Any]
    found: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, folder: Path, settings: dict[str, Any]) -> State:
        """Return the state in a folder, or a new one.

        Raises
        ------
        StateError
            When the folder has that of another arm or goal.
        """
        file = folder / STATE_FILE
        if not file.exists():
            return cls(folder, settings)
        try:
            known = json.loads(file.read_text("utf-8"))
            before, found = known["settings"], known["found"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise StateError(f"{file}: cannot be read: choose another --out, or remove it") from (
                error
            )
        changed = [name for name, value in settings.items() if before.get(name) != value]
        if changed:
            raise StateError(
                f"{file}: began with another {' and '.join(changed)}: choose another --out, or "
                f"remove {folder}"
            )
        return cls(folder, settings, found)

    def note(self, stage: str, finding: Any) -> None:  # noqa: ANN401 - JSON
        """Keep what a stage found."""
        self.found[stage] = finding
        draft = self.folder / f".{STATE_FILE}"
        content = {**MARK_KEY, "settings": self.settings, "found": self.found}
        draft.write_text(json.dumps(content, indent=1) + "\n", "utf-8")
        draft.replace(self.folder / STATE_FILE)
