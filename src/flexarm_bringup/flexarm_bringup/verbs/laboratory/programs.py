"""Verbs run, record and play: one node in place of this process."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import click

from flexarm_bringup.console.quantity import TIME_S, FiniteRange, Quantity
from flexarm_bringup.console.verb_group import RUN_ON, examples
from flexarm_bringup.graph.processes import LaunchError, NodeProgram, find_executable
from flexarm_bringup.graph.socket_client import socket_client
from flexarm_bringup.verbs.laboratory.options import ARM
from flexarm_core.labels import counted

_BEFORE_PLAY_S = 5
"""Start of the node, and its discovery."""


@click.command(context_settings=RUN_ON)
@click.argument("package")
@click.argument("executable")
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
@examples(
    "run flexarm_daq daq_node --ros-args -p autostart:=true -p rate_hz:=500.0",
    "run flexarm_daq recorder_node --ros-args -p bag:=out/run1",
)
def run(package: str, executable: str, arguments: tuple[str, ...]) -> None:
    """Run one node, as `ros2 run` does."""
    _become([str(find_executable(package, executable)), *arguments])


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option(
    "--topics",
    multiple=True,
    metavar="TOPIC",
    help="Record this topic, such as state or /diagnostics; may be given more than once.",
)
@click.option("--max-bag-size", type=int, help="Begin the next file at that many bytes.")
@click.option(
    "--max-bag-duration",
    type=Quantity(TIME_S, 0.0),
    metavar="TIME",
    help="Begin the next file after that time, s, or with its unit: 10min.",
)
@click.option(
    "--snapshot-mode",
    is_flag=True,
    help="Keep the last minute in memory; the service recorder/snapshot writes it.",
)
@ARM
@examples(
    "record out/run1",
    "record out/long --max-bag-duration 600",
    "record out/all --topics state --topics command --topics /diagnostics",
    "record out/run1 --namespace arm2",
)
def record(
    bag: Path,
    topics: tuple[str, ...],
    max_bag_size: int | None,
    max_bag_duration: float | None,
    namespace: str,
    *,
    snapshot_mode: bool,
) -> None:
    """Record the running graph until Ctrl-C.

    The bag holds state, command, reference and who commands, or the topics that are named. The
    options are those of `ros2 bag record`. Beside `up`, whose recorder it leaves alone, the node
    has a name of its own.
    """
    wanted = {
        "topics": list(topics),
        "max_bagfile_size": max_bag_size,
        "max_bagfile_duration": max_bag_duration,
        "snapshot_mode": snapshot_mode,
    }
    parameters = {"bag": bag.absolute(), **{name: each for name, each in wanted.items() if each}}
    # Two nodes of one name would both answer its services.
    name = f"recorder_{os.getpid()}" if _is_up(namespace) else ""
    program = NodeProgram(
        "flexarm_daq", "recorder_node", parameters, namespace=namespace, name=name
    )
    _become(program.command())


def _is_up(namespace: str) -> bool:
    try:
        with socket_client(namespace):
            return True
    except LaunchError:
        return False


@click.command()
@click.argument("bag", type=click.Path(path_type=Path))
@click.option(
    "--rate",
    type=FiniteRange(0.01, 1000.0),
    default=1.0,
    show_default=True,
    help="2 plays twice as fast.",
)
@click.option("--loop", is_flag=True, help="Start again at the end.")
@click.option(
    "--stand-in", is_flag=True, help="Publish the samples only, stamped now, as a DAQ node would."
)
@click.option("--clock", is_flag=True, help="Publish the time of each message on /clock.")
@examples("play bags/c_dat3_0g", "play bags/c_dat3_0g --rate 2", "play bags/run1 --stand-in")
def play(bag: Path, **settings: Any) -> None:  # noqa: ANN401
    """Publish the messages of a bag with their timing.

    The topics are those that the bag names. The service ~/play stops it.
    """
    click.echo(_announcement(bag, **settings), err=True)
    parameters = {"bag": bag.absolute(), **settings}
    _become(NodeProgram("flexarm_daq", "player_node", parameters).command())


def _announcement(bag: Path, *, rate: float, loop: bool, stand_in: bool, **_: bool) -> str:
    """Return what will be played; the node itself starts and listens for seconds."""
    from flexarm_bags.metadata import require_bag, stated_content  # noqa: PLC0415 - others need none

    require_bag(bag)
    content = f"{bag}"
    if bag.is_dir():
        stated = stated_content(bag)
        content += (
            f", {counted(stated.messages, 'message')} in {stated.duration_s:.3g} s"
            f" of {', '.join(stated.topics)}"
        )
    parts = [content, f"at rate {rate:g}"]
    parts += ["again and again"] * loop + ["its samples only"] * stand_in
    return (
        f"play {', '.join(parts)}\n"
        f"It begins in some {_BEFORE_PLAY_S} s: first it finds out who else publishes these topics."
    )


def _become(command: list[str]) -> None:
    os.execv(command[0], command)  # noqa: S606 - our own node
