"""Verbs that operate a running arm from another terminal."""

from __future__ import annotations

from typing import Any

import click

from flexarm_bringup.console.quantity import POSITION_V, Quantity
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.graph.assignments import parsed
from flexarm_bringup.graph.hand import through
from flexarm_bringup.graph.processes import MANAGED
from flexarm_bringup.verbs.laboratory.options import ARM


@click.command()
@ARM
@click.option("--all", "everything", is_flag=True, help="Every arm that is found.")
@examples("stop", "stop --namespace arm2", "stop --all")
def stop(*, namespace: str, everything: bool) -> None:
    """Stop the drive until the DAQ node is deactivated.

    Without `flexarm up` it takes seconds to find the arm: at a real rig, press the button.
    """
    if not everything:
        click.echo(through(namespace, lambda hand: hand.stop()))
        return
    from flexarm_bringup.graph.graph_hand import stop_every_arm  # noqa: PLC0415 - it loads rclpy

    for arm, message in stop_every_arm():
        click.echo(f"{arm}: {message}")


@click.command()
@ARM
@examples("status", "status --namespace arm2")
def status(namespace: str) -> None:
    """Show state, reasons, rates and counts of every running node."""
    for name, (message, values) in sorted(through(namespace, lambda hand: hand.reports()).items()):
        click.echo(f"{name}: {message}")
        for key, value in values.items():
            click.echo(f"    {key:36s} {value}")


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("set_point_v", metavar="SET_POINT", type=Quantity(POSITION_V))
@ARM
@examples("reference 1.5", "reference -3", "reference 23deg")
def reference(set_point_v: float, namespace: str) -> None:
    """Give the running controller a set-point.

    It is in V, or has its unit: deg, rad. What is in force is printed.
    """
    in_force_v = through(namespace, lambda hand: hand.reference(set_point_v))
    click.echo(f"set-point {in_force_v:g} V")


@click.command("set")
@click.argument("node")
@click.argument("assignments", nargs=-1, required=True, metavar="NAME=VALUE...")
@ARM
@examples("set controller law=pdpc_plus", "set daq max_command_v=2 payload_kg=0.2")
def set_(node: str, assignments: tuple[str, ...], namespace: str) -> None:
    """Set parameters of a running node, all or none."""
    wanted: dict[str, Any] = dict(parsed(each) for each in assignments)
    changes = through(namespace, lambda hand: hand.set(node, wanted))
    for name, (before, after) in changes.items():
        click.echo(f"{node} {name}: {before} -> {after}")


@click.command()
@click.argument("node", type=click.Choice(MANAGED))
@ARM
@examples("activate daq")
def activate(node: str, namespace: str) -> None:
    """Activate a running node: daq, controller or experiment."""
    click.echo(f"{node} is {through(namespace, lambda hand: hand.activate(node))}")


@click.command()
@click.argument("node", type=click.Choice(MANAGED))
@ARM
@examples("deactivate daq")
def deactivate(node: str, namespace: str) -> None:
    """Deactivate a running node; the drive goes to zero."""
    click.echo(f"{node} is {through(namespace, lambda hand: hand.deactivate(node))}")
