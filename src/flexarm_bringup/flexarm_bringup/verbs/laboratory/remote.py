"""Verbs that operate a running arm from another terminal."""

from __future__ import annotations

import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from flexarm_bringup.console.called import as_called
from flexarm_bringup.console.quantity import Quantity, units_of_channel
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.graph.assignments import parsed
from flexarm_bringup.graph.processes import MANAGED, NAMESPACE, LaunchError
from flexarm_bringup.graph.socket_client import stop_every_arm, through
from flexarm_bringup.verbs.laboratory.options import ARM
from flexarm_core.bounds import shown
from flexarm_core.errors import SettingError, nearest
from flexarm_core.rig_description import load_rig
from flexarm_node.parameter_files import LOOP

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_bringup.graph.figures import SetPoint
    from flexarm_bringup.graph.socket_client import ArmClient

_TOPIC = "topic"


@click.command()
@ARM
@click.option("--all", "everything", is_flag=True, help="Every arm that is found.")
@examples("stop", "stop --namespace arm2", "stop --all")
def stop(*, namespace: str, everything: bool) -> None:
    """Stop the drive until the DAQ node is deactivated.

    Without `flexarm up` it takes seconds to find the arm: at a real rig, press the button.
    """
    source = click.get_current_context().get_parameter_source("namespace")
    if everything and source is ParameterSource.COMMANDLINE:
        raise click.UsageError("give --all, or --namespace for one arm")
    if not everything:
        click.echo(through(namespace, lambda arm: arm.stop()))
        of = "" if namespace == NAMESPACE else f" --namespace {namespace.strip('/')}"
        click.echo(as_called(f"Then: flexarm deactivate daq{of} && flexarm activate daq{of}"))
        return
    for arm, message in stop_every_arm():
        click.echo(f"{arm}: {message}")


_PART = ": "
"""Part of a count, by its kind; those that are zero say nothing."""
_FOR_THE_PAGE = "histogram"
"""Figures that are a drawing on the page and say nothing as numbers."""


@click.command()
@ARM
@examples("status", "status --namespace arm2")
def status(namespace: str) -> None:
    """Show state, reasons, rates and counts of running nodes.

    The address of the page comes first, if there is one.
    """
    reports, page = through(namespace, lambda arm: (arm.reports(), arm.page()))
    if page:
        click.echo(page)
    if not reports:
        click.echo("no node has reported yet: each does once a second")
    for name, (message, values) in sorted(reports.items()):
        click.echo(f"{name}: {message}")
        for key, value in values.items():
            is_none = value == "0" and _PART in key
            if value and not is_none and not key.endswith(_FOR_THE_PAGE):
                click.echo(f"    {key:36s} {'-' if value == 'nan' else value}")


class _OfNumbers(click.Command):
    """Command whose argument may be a negative number."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Refuse an unknown option as such, before it is taken for a second argument."""
        known = {name for each in self.get_params(ctx) for name in each.opts}
        for arg in args:
            name = arg.partition("=")[0]
            if name.startswith("--") and name not in known | {"--"}:
                raise click.NoSuchOption(name, ctx=ctx)
        return super().parse_args(ctx, args)


@click.command(cls=_OfNumbers, context_settings={"ignore_unknown_options": True})
@click.argument("words", metavar="SET_POINT", nargs=-1, required=True)
@ARM
@examples("reference 1.5", "reference -3", "reference 23deg", "reference elbow 0.4")
def reference(words: tuple[str, ...], namespace: str) -> None:
    """Give the running controller a set-point.

    It is in the unit of the rig, V for the thesis's arm, or has its own: deg, rad. Where there are
    several joints, one is named. What is in force is printed.
    """
    *joints, text = words
    if len(joints) > 1:
        raise click.UsageError(f"one joint and one set-point, not {' '.join(words)}")
    joint, context = "".join(joints), click.get_current_context()

    def give(arm: ArmClient) -> tuple[SetPoint, str]:
        kind, unit = _set_point_kind(arm, joint)
        try:
            value: float = kind.convert(text, None, context)
        except click.BadParameter as error:
            raise click.BadParameter(
                error.message, context, param_hint=f"set-point{f' of {joint}' if joint else ''}"
            ) from None
        return arm.reference(value, joint), unit

    in_force, unit = through(namespace, give)
    note = f": {as_called(in_force.note)}" if in_force.note else ""
    click.echo(f"set-point {f'{joint} ' if joint else ''}{in_force.value:g}{unit}{note}")


def _set_point_kind(arm: ArmClient, joint: str) -> tuple[click.ParamType[Any], str]:
    """Return what a set-point of the running rig is, and its unit.

    The controller says what is wrong with a name. The description may be on another machine: then a
    number has no unit here.
    """
    values = {each["name"]: each["value"] for each in arm.parameters("controller")["controller"]}
    with suppress(SettingError, LookupError, ValueError):
        rig = load_rig(values["rig"])
        (track, *_) = (each for each in rig.tracks if joint in ("", each.name, each.output))
        units = units_of_channel(rig.output(track.output))
        return Quantity(units, track.low, track.high), f" {track.unit}"
    return click.FLOAT, ""


@click.command()
@click.argument("node", required=False, default="")
@click.argument("names", nargs=-1, metavar="[NAME...]")
@ARM
@examples("get", "get controller", "get controller law pdpc.kp", "get /arm2/daq rate_hz")
def get(node: str, names: tuple[str, ...], namespace: str) -> None:
    """List parameters of running nodes with units and bounds."""
    namespace, node = _addressed(node, namespace)
    tables = through(namespace, lambda arm: arm.parameters(node))
    for each, params in tables.items():
        known = {str(param["name"]): param for param in params}
        for name in names:
            if name not in known:
                raise LaunchError(f"{each} has no parameter {name}{nearest(name, known)}")
        for name in names or known:
            click.echo(f"{each} {name:32s} {_described(known[name])}")


def _described(param: Mapping[str, Any]) -> str:
    """Return value, unit and what the value may be, for one line."""
    parts = [f"{param['value']} {param['unit']}".rstrip() or "''"]
    if param["choices"]:
        parts.append(f"one of {', '.join(param['choices'])}")
    elif param["low"] is not None:
        parts.append(f"{param['low']:g} to {param['high']:g}")
    if param["read_only"]:
        parts.append("at start only")
    return "; ".join(parts)


def _addressed(node: str, namespace: str) -> tuple[str, str]:
    """Return namespace and name of a node; its full name says both, as in the tools of ROS 2."""
    space, _, name = node.rpartition("/")
    if space:
        space = f"/{space.strip('/')}"
    source = click.get_current_context().get_parameter_source("namespace")
    if space and space != namespace and source is ParameterSource.COMMANDLINE:
        raise LaunchError(f"{node} is not in {namespace}: give the full name or --namespace")
    if "." in name:
        name, _, parameter = name.partition(".")
        raise LaunchError(f"{node} is not a node: write {name} {parameter}")
    return space or namespace, name


@click.command("set")
@click.argument("node")
@click.argument("assignments", nargs=-1, metavar="NAME=VALUE...")
@ARM
@examples("set controller law=pdpc_plus", "set daq max_command_v=2 payload_kg=0.2")
def set_(node: str, assignments: tuple[str, ...], namespace: str) -> None:
    """Set parameters of a running node, all or none."""
    if not assignments:
        lacking = f"the node of {node}" if "=" in node else f"what to set of {node}"
        example = as_called("flexarm set daq payload_kg=0.2")
        raise click.UsageError(f"{lacking} is missing: {example}")
    namespace, node = _addressed(node, namespace)
    wanted: dict[str, Any] = dict(parsed(each) for each in assignments)
    changes = through(namespace, lambda arm: arm.set(node, wanted))
    for name, (before, after) in changes.items():
        click.echo(f"{node} {name}: {before} -> {after}")


def _managed(node: str, namespace: str) -> tuple[str, str]:
    """Return namespace and name of a managed node; refuse others."""
    namespace, name = _addressed(node, namespace)
    if name not in MANAGED:
        raise LaunchError(f"{node or shown(node)} has no lifecycle: {', '.join(MANAGED)} have one")
    return namespace, name


@click.command()
@click.argument("node")
@ARM
@examples("activate daq", "activate /arm2/daq")
def activate(node: str, namespace: str) -> None:
    """Activate a running node: daq, controller or experiment."""
    namespace, node = _managed(node, namespace)
    state, motion = through(namespace, lambda arm: (arm.activate(node), _motion(arm, node)))
    outlook = motion and f"; while both are, the controller drives the arm {motion}"
    click.echo(f"{node} is {state}{outlook}")


@click.command()
@click.argument("node")
@ARM
@examples("deactivate daq", "deactivate /arm2/daq")
def deactivate(node: str, namespace: str) -> None:
    """Deactivate a running node; the drive goes to zero."""
    namespace, node = _managed(node, namespace)
    state, motion = through(namespace, lambda arm: (arm.deactivate(node), _motion(arm, node)))
    outlook = (
        motion and f"; once active again, an active controller drives the arm {motion}, at once"
    )
    click.echo(f"{node} is {state}{outlook}")


def _motion(arm: ArmClient, node: str) -> str:
    """Return where the controller drives the arm while it and the DAQ node are active.

    The reports of the nodes have the set-point of up to a second ago.
    """
    if node not in LOOP:
        return ""
    with suppress(LaunchError, KeyError):
        params = arm.parameters("controller")["controller"]
        values = {str(each["name"]): each["value"] for each in params}
        if values.get("trajectory"):
            return "along its trajectory"
        reference = values["reference"]
        return "to its set-point" if reference == _TOPIC else f"along its own {reference}"
    return ""


@click.command()
@ARM
@examples("watch", "watch --namespace arm2", "watch | tee out/watch.txt")
def watch(namespace: str) -> None:
    """Show a running arm on the terminal, and move it by keys.

    Space stops the drive at once, r begins anew after it, q quits. Arrows move the set-point by
    1 degree, with Shift by 5, Page Up and Page Down by 10; Home takes it to 0. In a pipe a line is
    printed each second.
    """
    # They load what draws, which the other verbs do without.
    from flexarm_bringup.watch.follower import Follower  # noqa: PLC0415
    from flexarm_bringup.watch.terminal import print_lines, show_screen  # noqa: PLC0415

    with Follower(namespace) as arm:
        if sys.stdin.isatty() and sys.stdout.isatty():
            show_screen(arm)
        else:
            print_lines(arm)
