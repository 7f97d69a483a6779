"""Verbs that operate a graph which is running in another terminal."""

from __future__ import annotations

import click

from flexarm_bringup.verbs.verb import examples


@click.command()
@examples("stop")
def stop() -> None:
    """Emergency stop: the drive is at zero until the DAQ node is deactivated.

    It takes seconds to start: at a real rig, press the button.
    """
    from flexarm_bringup.graph.operator import emergency_stop  # noqa: PLC0415

    emergency_stop()


@click.command()
@examples("status")
def status() -> None:
    """Show what every running node reports: state, reasons, rates, percentiles, counts."""
    from flexarm_bringup.graph.operator import show_status  # noqa: PLC0415

    show_status()


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("volts", type=float)
@examples("reference 1.5", "reference -3")
def reference(volts: float) -> None:
    """Send one set-point, V, to the running controller."""
    from flexarm_bringup.graph.operator import set_reference  # noqa: PLC0415

    set_reference(volts)


@click.command("set")
@click.argument("node")
@click.argument("assignments", nargs=-1, required=True, metavar="NAME=VALUE...")
@examples("set controller law=pdpc_plus", "set daq max_command_v=2 payload_kg=0.2")
def set_(node: str, assignments: tuple[str, ...]) -> None:
    """Set parameters of a running node, all or none."""
    from flexarm_bringup.graph.operator import set_parameters  # noqa: PLC0415

    set_parameters(node, assignments)


@click.command()
@click.argument("node")
@examples("activate daq")
def activate(node: str) -> None:
    """Activate a running node: daq, controller or experiment."""
    from flexarm_bringup.graph.operator import change_state  # noqa: PLC0415

    change_state(node, active=True)


@click.command()
@click.argument("node")
@examples("deactivate daq")
def deactivate(node: str) -> None:
    """Deactivate a running node; the drive goes to zero."""
    from flexarm_bringup.graph.operator import change_state  # noqa: PLC0415

    change_state(node, active=False)
