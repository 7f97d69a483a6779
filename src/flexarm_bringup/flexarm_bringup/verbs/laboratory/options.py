"""Options that verbs of the laboratory share."""

from __future__ import annotations

import re
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexarm_bringup.console.called import as_called
from flexarm_bringup.console.quantity import MASS_KG, Quantity
from flexarm_bringup.graph.processes import NAMESPACE
from flexarm_bringup.runs.pace import Pace
from flexarm_core.rig_description import load_rig

if TYPE_CHECKING:
    from collections.abc import Callable

# What rclpy.validate_namespace takes, which would be loaded for every verb.
_NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_LONGEST_NAMESPACE = 245


def _absolute(_: click.Context, __: click.Parameter, value: str) -> str:
    namespace = f"/{value.strip('/')}"
    if len(namespace) > _LONGEST_NAMESPACE or not _NAMESPACE.fullmatch(namespace):
        raise click.BadParameter(f"{value!r} is not a namespace, such as arm2 or lab/arm2")
    return namespace


ARM = click.option(
    "--namespace",
    default=NAMESPACE.strip("/"),
    show_default=True,
    callback=_absolute,
    help="Which arm: the namespace of its nodes.",
)
USUAL_RIG = "simulated"
RIG = click.option(
    "--rig",
    default=USUAL_RIG,
    show_default=True,
    metavar="NAME|FILE",
    help="Arm: the name or the file of a rig description (`flexarm rig new` writes one).",
)
TWIN = click.option(
    "--twin",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Arm: the twin of an identified model, model.yaml.",
)
LIVE = click.option(
    "--live",
    is_flag=True,
    help="Show every step on a page in the browser, whose address stands on a line.",
)
PAYLOAD = click.option(
    "--payload",
    "payload_kg",
    type=Quantity(MASS_KG, 0.0, 1.0),
    metavar="MASS",
    default=0.0,
    help="Mass at the tip, kg, or with its unit: 200g.",
)
PARAMETER_FILES = click.option(
    "--params-file",
    "parameter_files",
    multiple=True,
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Parameters of the nodes, such as gains or a board's wiring; repeat.",
)
FAST = click.option("--fast", is_flag=True, help="As fast as the machine can; the same samples.")
REAL_TIME = click.option(
    "--real-time",
    is_flag=True,
    help="In real time, as with a board: samples that a busy machine misses are lost.",
)


def rig_parameter(rig: str) -> dict[str, str]:
    """Return the parameter of a node that names its rig; none for the usual one.

    Parameter files may name another driver for the thesis's arm.
    """
    if rig == USUAL_RIG:
        return {}
    return {"rig": str(Path(rig).absolute()) if Path(rig).is_file() else rig}


def twin_rig(model: Path) -> str:
    """Write the description of a model's twin, say and return where it is; a changed one stays."""
    # Verbs of a running arm answer at once, and load neither.
    from flexarm_bringup.console import terminal  # noqa: PLC0415
    from flexarm_control.twin import twin_description  # noqa: PLC0415

    file = Path("out", "twin", f"{model.absolute().parent.name}.yaml")
    made = twin_description(model)
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(made, encoding="utf-8")
    described = load_rig(file)
    other = str(described.settings.get("model", ""))
    if (file.parent / other).resolve() != model.resolve():
        raise click.UsageError(
            f"--twin: {file} describes the twin of another model, {other or 'none'}: start it by "
            f"--rig {file}, or remove it"
        )
    terminal.CONSOLE.print(
        as_called(f"the arm is described in {file}: change it, then --rig {file}")
    )
    if described.text != made:
        terminal.note(
            f"{file} does not match the model any more: remove it to have it written anew"
        )
    return str(file)


def paced(function: Callable[..., None]) -> Callable[..., None]:
    """Add --fast and --real-time to a verb, which gets them as one `pace`."""

    @FAST
    @REAL_TIME
    @wraps(function)
    def verb(*, fast: bool, real_time: bool, **settings: Any) -> None:  # noqa: ANN401
        function(pace=chosen_pace(fast=fast, real_time=real_time), **settings)

    return verb


def chosen_pace(*, fast: bool = False, real_time: bool = False) -> Pace:
    """Return the pace that two flags choose; a `click.UsageError` when both are set."""
    if fast and real_time:
        raise click.UsageError("--fast and --real-time exclude each other: give one of them.")
    if fast:
        return Pace.FAST
    return Pace.REAL if real_time else Pace.WALL_CLOCK
