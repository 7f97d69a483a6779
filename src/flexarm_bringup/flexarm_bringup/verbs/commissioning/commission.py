"""Verb commission: from an unknown arm to its controller."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table

from flexarm_bringup.console import terminal
from flexarm_bringup.console.called import as_called
from flexarm_bringup.console.quantity import FiniteRange
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.verbs.commissioning.commissioner import State
from flexarm_bringup.verbs.laboratory.options import (
    ARM,
    LIVE,
    TWIN,
    paced,
    rig_parameter,
    twin_rig,
)
from flexarm_core.outputs import OutputError
from flexarm_core.own_files import claimed
from flexarm_core.rig_description import load_rig

if TYPE_CHECKING:
    from flexarm_bringup.runs.pace import Pace
    from flexarm_core.rig_description import RigDescription


@click.command()
@click.option("--rig", metavar="NAME|FILE", help="Arm: the name or the file of a rig description.")
@TWIN
@click.option(
    "-o",
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("out/commission"),
    show_default=True,
    help="Folder of the records, models and the controller; one that was interrupted is resumed.",
)
@click.option(
    "--goal",
    type=FiniteRange(1e-4, 1.0),
    default=0.05,
    show_default=True,
    help="Relative standard deviation of modes and gains at which the excitation ends.",
)
@click.option("--dry-run", is_flag=True, help="Print stages, limits and times, and drive nothing.")
@LIVE
@paced
@ARM
@examples(
    "commission --rig my_arm.yaml --dry-run",
    "commission --rig my_arm.yaml",
    "commission --rig thesis --fast",
    "commission --rig my_arm.yaml --live",
    "commission --twin out/identify/model.yaml --fast",
)
def commission(
    *,
    rig: str | None,
    twin: Path | None,
    out: Path,
    goal: float,
    dry_run: bool,
    live: bool,
    pace: Pace,
    namespace: str,
) -> None:
    """Take an unknown arm to its controller, stage by stage.

    The stages are a check at rest, pulses, slow motion for the friction, an excitation that grows,
    the identification after each of its parts, the design of a servo, and its step on the arm.

    Each stage is judged before the next one drives the arm, and a fault ends all with the drives at
    rest. Ctrl-C ends it too; the same command goes on where it ended, and measures nothing twice.
    """
    if (rig is None) == (twin is None):
        raise click.UsageError("name the arm: --rig NAME|FILE, or --twin MODEL")
    if twin is not None:
        rig = twin_rig(twin)
    assert rig is not None  # noqa: S101 - one of both is given
    description = load_rig(rig)
    # They load the laws, which help does without.
    from flexarm_control.joint_laws import require_known_outputs  # noqa: PLC0415
    from flexarm_control.laws.registry import LAWS  # noqa: PLC0415

    require_known_outputs(LAWS["pd"], description)
    if dry_run:
        _show_programme(description)
        return
    out.mkdir(parents=True, exist_ok=True)
    taken = OutputError(f"{out}: another commissioning is at work there: choose another --out")
    with claimed(os.open(out, os.O_RDONLY), taken):
        state = State.of(out, {"rig": description.text, "goal": goal})
        _commission(description, rig, state, pace, namespace, live=live)


def _show_programme(rig: RigDescription) -> None:
    """Print stages, limits and times."""
    from flexarm_control.commissioning.programme import Programme  # noqa: PLC0415 - not for help

    table = Table("stage", "drives", "command at most", "time", box=None, header_style="")
    stages = Programme(rig).stages()
    for each in stages:
        table.add_row(each.name, each.drives, each.most or "-", f"{each.length_s:.0f} s")
    terminal.show_table(table)
    terminal.CONSOLE.print(f"{sum(each.length_s for each in stages):.0f} s of arm time at most")


def _commission(
    rig: RigDescription, rig_name: str, state: State, pace: Pace, namespace: str, *, live: bool
) -> None:
    # They load ROS, python-control and what identifies, which a dry run does without.
    from flexarm_bringup.runs.live_arm import live_arm  # noqa: PLC0415
    from flexarm_bringup.verbs.commissioning.commissioner import Commissioner  # noqa: PLC0415
    from flexarm_bringup.verbs.commissioning.results import write_results  # noqa: PLC0415
    from flexarm_bringup.verbs.health.rig import check_at_rest  # noqa: PLC0415
    from flexarm_bringup.verbs.laboratory.live_page import (  # noqa: PLC0415
        PageAddress,
        PageSettings,
        announce_task,
    )
    from flexarm_bringup.verbs.offline.servo import write_servo  # noqa: PLC0415

    out = state.folder
    if "check" not in state.found:
        terminal.step("Check of the channels, with the drives at rest")
        check_at_rest(rig, Path(rig_name).parent)
        state.note("check", {"outputs": list(rig.output_names)})
    bags = out / "bags"
    bags.mkdir(exist_ok=True)
    page = PageSettings(port=0, view_only=True).parameters() if live else None
    named = rig_parameter(rig_name)
    with live_arm(rig, named, bags.absolute(), pace=pace, namespace=namespace, page=page) as arm:
        if live and arm.processes is not None:
            arm.operator.wait(PageAddress(namespace, arm.processes).look, "the page")
        announce = partial(announce_task, namespace) if live else None
        commissioner = Commissioner(arm, rig, state, announce)
        results, design = commissioner.run()
        write_servo(design, [results.name], out / "servo")
        steps = commissioner.step(design)
    write_results(rig, state, results, design, steps)
    terminal.step(f"Controller: {out / 'controller.yaml'}. Report: {out / 'report.html'}")
    arm_words = f"flexarm up --rig {terminal.quoted(Path(rig_name))}"
    controller = terminal.quoted(out / "controller.yaml")
    terminal.next_step(as_called(f"{arm_words} --controller {controller}"))
