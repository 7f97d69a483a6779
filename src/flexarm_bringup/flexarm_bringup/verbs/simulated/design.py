"""Verb design: a servo for any record or model, or a law for a payload nobody packaged."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click
import numpy as np

from flexarm_bringup.console import terminal
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.verbs.offline.servo import run_servo, servo_options
from flexarm_bringup.verbs.simulated.chosen_run import simulated_run
from flexarm_bringup.verbs.simulated.simulated_run import (
    REPLY_DELAY_S,
    REPORT_FILE,
    SET_POINT_V,
    SUMMARY_FILE,
    RunSettings,
    run_options,
    versions,
)
from flexarm_control.design.loop_plot import loop_plot
from flexarm_control.design.margins import Requirements
from flexarm_control.design.regulator_tuning import law_loop
from flexarm_control.design.tuning_job import TuneRequest, tune
from flexarm_control.laws.registry import LAWS
from flexarm_control.models.rigid_and_bending import bending_modes
from flexarm_core.outputs import require_place, write_facts
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_ident.models.model_parameters import models_in, write_parameter_file
from flexarm_ident.report.content.blocks import Plots, Words
from flexarm_ident.report.page import append_section
from flexarm_ident.workflow.request import Request

if TYPE_CHECKING:
    from flexarm_bringup.verbs.simulated.simulated_run import ControlledStep, IdentifiedModel
    from flexarm_control.design.margins import Loop, Margins
    from flexarm_control.design.tuning_job import TuneResult

CONTROLLER_FILE = "controller.yaml"
# The law of the controller for each tuning: without compensation, PDP sticks before the set-point.
_SERVOS = ("servo", "hinf")
_RUNS_AS = {"ilqr": "ilqr", "lqg": "lqg", "pdp": "pdpc"}
# A step is clearly earlier when it takes less than two thirds of the time of another one.
_EARLIER = 1.5
_DOUBT = (
    "the packaged controller is unstable on this model, but it held the arm: the model is wrong "
    "somewhere; its margins are doubtful, so choose a controller by the steps"
)
_EARLIER_STEP = (
    "the packaged controller settled much earlier, and its margins suffice: take that one. The "
    "criterion of the design leaves out friction (docs/tuning.md)"
)


@dataclass(frozen=True)
class DesignSettings(RunSettings):
    """Choices of the user: those of a run, and the law."""

    law: str


class Designed(NamedTuple):
    """Model and design of a run, its step and loop, and those of the packaged law."""

    model: IdentifiedModel
    modes_hz: tuple[float, ...]
    result: TuneResult
    step: ControlledStep
    packaged: ControlledStep
    loop: Loop | None
    packaged_loop: Loop | None

    @property
    def packaged_margins(self) -> Margins | None:
        """Margins of the packaged law on the model of the design."""
        return None if self.packaged_loop is None else self.packaged_loop.margins()

    @property
    def remarks(self) -> list[str]:
        """What the packaged law's step says of the design."""
        return remarks(
            self.packaged_margins, packaged_s=self.packaged.over_s, designed_s=self.step.over_s
        )


@click.command()
@click.argument(
    "sources", nargs=-1, metavar="[RECORD_OR_MODEL]...", type=click.Path(path_type=Path)
)
@click.option(
    "--law",
    type=click.Choice((*_RUNS_AS, *_SERVOS)),
    help="For records and models servo (default) or hinf, H-infinity; for a payload ilqr "
    "(default), lqg, or pdp: its gains, run as pdpc.",
)
@click.option(
    "-o", "--out", type=click.Path(path_type=Path), default=Path("out/design"), show_default=True
)
@run_options
@servo_options
@examples(
    "design run.csv --input torque --output angle --track angle",
    "design out/identify/model.yaml --track angle --limit torque=3 --bandwidth 2Hz",
    "design --payload 0.15",
    "design --payload 0.35 --law lqg --fast",
    "design --payload 0.15 --law pdp --fast --out out/pdp",
)
def design(sources: tuple[Path, ...], law: str | None, **settings: Any) -> None:  # noqa: ANN401
    """Design a controller for any plant or a payload.

    A record is identified first. The servo steps on twins of the model, and is written for Python
    and for C. With several models, such as of several payloads, it holds all of them.

    For a payload, the packaged law makes a step beside the designed one: ilqr for 300 g, lqg by
    payload, pdpc with its gains. The margins are those on the identified model.
    """
    own = {field.name for field in fields(DesignSettings)}
    asked = {name: settings.pop(name) for name in tuple(settings) if name not in own}
    if sources or asked["track"]:
        if law not in {None, *_SERVOS}:
            laws = " or ".join(_SERVOS)
            raise click.UsageError(f"--law {law} is for --payload: a record has the law {laws}")
        if not sources:
            raise click.UsageError("--track needs a record or a model: name its file")
        run_servo(sources, law or _SERVOS[0], settings["out"], asked, force=settings["force"])
        return
    if law in _SERVOS:
        raise click.UsageError(f"--law {law} needs a record or a model, and --track OUTPUT")
    _run_design(DesignSettings(law=law or "ilqr", **settings))


def _run_design(settings: DesignSettings) -> None:
    require_place([settings.out / CONTROLLER_FILE], force=settings.force)
    law = _RUNS_AS[settings.law]
    with simulated_run(settings) as run:
        run.excite()
        run.begin("Identifying a model")
        identified = run.identify(Request(friction=False))
        run.begin(f"Designing {settings.law} with margins of its own")
        ((name, model),) = models_in(identified.facts.parameters).items()
        modes_hz, _ = bending_modes(model)
        result = tune({name: model}, TuneRequest(settings.law, delay_s=REPLY_DELAY_S))
        for line in result.notes:
            terminal.CONSOLE.print(f"  {line}")
        write_parameter_file(
            settings.out / CONTROLLER_FILE, dict(result.parameters), node="/**/controller"
        )
        run.begin(f"Controlling the arm: {law} as designed, step to {SET_POINT_V:g} V")
        step = run.step("designed", {"law": law, **result.parameters})
        run.begin(f"Controlling the arm: {law} as packaged")
        packaged = run.step("packaged", {"law": law, **_packaged(law)})
    start = f"{law}."
    values = {
        name.removeprefix(start): value
        for name, value in result.parameters.items()
        if name.startswith(start)
    }
    loop = law_loop(law, model, values, delay_s=REPLY_DELAY_S)
    beside = law_loop(law, model, delay_s=REPLY_DELAY_S)
    _write(settings, Designed(identified, modes_hz, result, step, packaged, loop, beside))


def _packaged(law: str) -> dict[str, Any]:
    """Return the parameters of a law as the controller has them by default."""
    row = LAWS[law]
    values: dict[str, Any] = {f"{law}.{spec.name}": spec.default for spec in row.parameters}
    return values | ({f"{law}.model": ""} if row.design else {})


def _write(settings: DesignSettings, designed: Designed) -> None:
    """Write `summary.json` and `report.html`, and print both steps."""
    out, model = settings.out, designed.model
    law = _RUNS_AS[settings.law]
    report = (model.folder / REPORT_FILE).read_text("utf-8")
    report = append_section(report, "Designed step", designed.step.blocks(f"{law} as designed"))
    packaged = designed.packaged.blocks(f"{law} as packaged")
    report = append_section(report, "Packaged step", packaged)
    report = append_section(report, "Sensitivity", _sensitivity(designed))
    (out / REPORT_FILE).write_text(report, "utf-8")
    write_facts(out / SUMMARY_FILE, _summary(settings, designed))
    (margins,) = designed.result.margins
    terminal.CONSOLE.print(f"  designed: {designed.step.text}{_margins_text(margins)}")
    terminal.CONSOLE.print(
        f"  packaged: {designed.packaged.text}{_margins_text(designed.packaged_margins)}"
    )
    for line in designed.remarks:
        terminal.CONSOLE.print(f"  {line}")
    terminal.step(f"Parameters: {out / CONTROLLER_FILE}. {settings.results_text()}")


def _sensitivity(designed: Designed) -> tuple[Words, Plots]:
    """Return the loops of both controllers on the identified model, for the report."""
    loops = {"designed": designed.loop, "packaged": designed.packaged_loop}
    shown = {name: loop for name, loop in loops.items() if loop is not None}
    words = [
        f"{name}: {margins.gain_margin_db:.1f} dB gain margin, {margins.phase_margin_deg:.0f}° "
        f"phase margin, largest sensitivity {np.max(np.abs(loop.sensitivity)):.2f}"
        for name, loop in shown.items()
        for margins in [loop.margins()]
    ]
    return Words(f"On the identified model, {'; '.join(words)}."), Plots(
        (("", loop_plot(shown)),), wide=True
    )


def _margins_text(margins: Margins | None) -> str:
    """Return margins on the identified model, to be added to the figures of a step."""
    if margins is None:
        return ""
    return f"; margins {margins.gain_margin_db:.1f} dB, {margins.phase_margin_deg:.0f} deg"


def remarks(margins: Margins | None, *, packaged_s: float, designed_s: float) -> list[str]:
    """Return what the step of the packaged law says of a design.

    Parameters
    ----------
    margins : Margins or None
        Margins of the packaged law on the model of the design.
    packaged_s, designed_s : float
        Times from which the arm is at the set-point without vibration, s; infinite for never.
    """
    if margins is None or not math.isfinite(packaged_s):
        return []
    if not margins.stable:
        return [_DOUBT]
    suffices = bool(np.all(Requirements().excess([margins]) >= 0.0))
    return [_EARLIER_STEP] if suffices and designed_s > _EARLIER * packaged_s else []


def _figures(margins: Margins | None) -> dict[str, float] | None:
    if margins is None:
        return None
    return {
        "gain_db": margins.gain_margin_db,
        "phase_deg": margins.phase_margin_deg,
        "disk": margins.disk_margin,
    }


def _summary(settings: DesignSettings, designed: Designed) -> dict[str, Any]:
    model, result = designed.model, designed.result
    (margins,) = result.margins
    return {
        "payload_kg": settings.payload_kg,
        "seed": settings.seed,
        "law": settings.law,
        "runs_as": _RUNS_AS[settings.law],
        "order": model.order,
        "modes_hz": list(designed.modes_hz),
        "true_modes_hz": natural_frequencies_hz(
            RigParameters(payload_kg=settings.payload_kg)
        ).tolist(),
        "dmv_mean": model.facts.dmv[-1],
        "margins": _figures(margins),
        "criterion": result.criteria[0],
        "notes": [*result.notes, *designed.remarks],
        "warnings": list(model.facts.warnings),
        "step": designed.step.summary(),
        "packaged": {
            "step": designed.packaged.summary(),
            "margins": _figures(designed.packaged_margins),
        },
        "versions": versions(),
    }
