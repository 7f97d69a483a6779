"""Verb doctor: parts of this environment, and a message between its nodes."""

from __future__ import annotations

import importlib
import os
import platform
import re
import sys
import time
from importlib.metadata import PackageNotFoundError, distributions, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from flexarm_bringup.console import terminal
from flexarm_bringup.console.quantity import FiniteRange
from flexarm_bringup.console.verb_group import examples
from flexarm_bringup.graph.processes import LaunchError, find_executable
from flexarm_core.labels import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from importlib.metadata import PackageMetadata

_TALK_S = 10.0
_EXECUTABLES = (
    ("flexarm_daq", "daq_node"),
    ("flexarm_daq", "recorder_node"),
    ("flexarm_daq", "player_node"),
    ("flexarm_ident", "ident_node"),
    ("flexarm_control", "controller_node"),
)
_OURS = "flexarm"
_CLASSIFIER = "License :: "
# A longer text is the licence itself and not its name.
_LONGEST_NAME = 60
# The wheel `ros-jazzy-action-msgs` holds the package `action_msgs`.
_WHEEL = re.compile(r"^ros-((jazzy|kilted)-)?")
_LICENCE = re.compile(r"<license[^>]*>\s*([^<]*?)\s*</license>")
UNSTATED = "not stated"


@click.command()
@click.option("--licences", is_flag=True, help="List the licence of every installed package.")
@click.option("--realtime", is_flag=True, help="Measure which rates this machine can keep.")
@click.option("--hardware", is_flag=True, help="Examine the board and the sensors; moves nothing.")
@click.option(
    "--rig", "rig_file", metavar="FILE", help="With --hardware: rig on a serial line, not NI's."
)
@click.option("--pulse", is_flag=True, help="With --hardware --rig: pulse the motor at the end.")
@click.option("--device", default="Dev1", show_default=True, help="Name of the board.")
@click.option(
    "--sensors",
    default="ai0 ai1 ai2 ai3",
    show_default=True,
    help="Inputs of position, base gauge, middle gauge, speed.",
)
@click.option("--magnitude", default="ao0", show_default=True, help="Output, current's magnitude.")
@click.option("--direction", default="ao1", show_default=True, help="Output, current's direction.")
@click.option("--terminals", default="rse", show_default=True, help="rse, nrse, diff or default.")
@click.option(
    "--rate", type=FiniteRange(10.0, 2000.0), default=300.0, show_default=True, help="Hz."
)
@examples(
    "doctor",
    "doctor --licences",
    "doctor --realtime",
    "doctor --hardware",
    "doctor --hardware --device Dev2 --terminals diff",
    "doctor --hardware --rig ruler.yaml --pulse",
)
def doctor(
    *,
    licences: bool,
    realtime: bool,
    hardware: bool,
    rig_file: str | None,
    pulse: bool,
    sensors: str,
    rate: float,
    **names: Any,  # noqa: ANN401
) -> None:
    """Examine this environment, its real time, or the hardware.

    Without options: its parts, and whether nodes can talk.
    """
    if licences:
        rows = licensed()
        click.echo("\n".join([*licence_lines(rows), summary(rows)]))
        return
    if realtime:
        from flexarm_bringup.verbs.health.realtime import examine_realtime  # noqa: PLC0415

        examine_realtime()
        return
    if (rig_file and not hardware) or (pulse and not rig_file):
        raise click.UsageError("--pulse goes with --rig, and --rig with --hardware")
    if rig_file:
        from flexarm_bringup.verbs.health.serial_board import examine_board  # noqa: PLC0415
        from flexarm_core.rig_description import load_rig  # noqa: PLC0415

        sys.exit(examine_board(load_rig(rig_file), Path(rig_file).parent, pulse=pulse))
    if hardware:
        from flexarm_bringup.verbs.health.hardware import examine_hardware  # noqa: PLC0415
        from flexarm_daq.rigs.nidaq.terminals import NidaqSettings  # noqa: PLC0415

        settings = NidaqSettings(sensors=tuple(sensors.split()), rate_hz=rate, **names)
        sys.exit(examine_hardware(settings))
    checks: tuple[tuple[str, Callable[[], str]], ...] = (
        ("Python", platform.python_version),
        ("ROS 2", lambda: os.environ.get("ROS_DISTRO", "unknown distribution")),
        ("domain", _domain),
        ("libraries", _libraries),
        ("messages", lambda: importlib.import_module("flexarm_msgs.msg").__name__),
        ("executables", _executables),
        ("talk over DDS", _talk),
    )
    wrong = [name for name, check in checks if _is_wrong(name, check)]
    sys.exit(1 if wrong else 0)


def _is_wrong(name: str, check: Callable[[], str]) -> bool:
    try:
        terminal.marked("ok", "green", f"    {name}: {check()}")
    except (ImportError, LaunchError, PackageNotFoundError, RuntimeError) as error:
        terminal.marked("wrong", "red", f" {name}: {error}")
        return True
    return False


def _domain() -> str:
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    return f"ROS_DOMAIN_ID {os.environ.get('ROS_DOMAIN_ID', '0')}, discovery range {reach}"


def _libraries() -> str:
    names = ("numpy", "scipy", "control", "numba", "rosbags", "mcap")
    return ", ".join(f"{name} {version(name)}" for name in names)


def _executables() -> str:
    for package, executable in _EXECUTABLES:
        find_executable(package, executable)
    return ", ".join(executable for _, executable in _EXECUTABLES)


def _talk() -> str:
    import rclpy  # noqa: PLC0415 - may be what is missing
    from std_msgs.msg import Float64  # noqa: PLC0415

    from flexarm_node.process import bounded_end  # noqa: PLC0415
    from flexarm_node.transport import set_up_middleware  # noqa: PLC0415

    set_up_middleware()
    rclpy.init()
    heard: list[float] = []
    try:
        node = rclpy.create_node(f"flexarm_doctor_{os.getpid()}")
        topic = f"flexarm_doctor_{os.getpid()}"
        node.create_subscription(Float64, topic, lambda message: heard.append(message.data), 1)
        publisher = node.create_publisher(Float64, topic, 1)
        started_s = time.monotonic()
        while not heard:
            publisher.publish(Float64(data=1.0))
            rclpy.spin_once(node, timeout_sec=0.1)
            if time.monotonic() - started_s > _TALK_S:
                raise LaunchError(f"a message to itself did not arrive within {_TALK_S:.0f} s")
    finally:
        with bounded_end():
            rclpy.try_shutdown()
    return f"a message came back after {time.monotonic() - started_s:.2f} s ({sys.platform})"


class Licensed(NamedTuple):
    """A package, its version and its licence."""

    name: str
    version: str
    licence: str


def licence_name(metadata: PackageMetadata) -> str:
    """Return the licence in a package's metadata: the expression, else classifiers, else text."""
    # An email message: a field that is not there is None.
    expression = metadata.get_all("License-Expression", [])
    if expression:
        return str(expression[0])
    classifiers = [str(line) for line in metadata.get_all("Classifier", [])]
    named = [line.split(" :: ")[-1] for line in classifiers if line.startswith(_CLASSIFIER)]
    named = [name for name in named if name != "OSI Approved"]
    if named:
        return ", ".join(dict.fromkeys(named))
    texts = [str(text).strip() for text in metadata.get_all("License", [])]
    short = [text for text in texts if text and "\n" not in text and len(text) <= _LONGEST_NAME]
    if short and short[0] != "UNKNOWN":
        return short[0]
    return _in_package_xml(str(metadata["Name"])) or UNSTATED


def _in_package_xml(name: str) -> str:
    """Return the licences of a package of ROS, whose wheels state none; empty for another one."""
    package = _WHEEL.sub("", name).replace("-", "_")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", sys.prefix).split(os.pathsep):
        file = Path(prefix, "share", package, "package.xml")
        if file.is_file():
            return ", ".join(_LICENCE.findall(file.read_text("utf-8")))
    return ""


def licensed() -> list[Licensed]:
    """Return the installed packages that are not our own, by name."""
    found = {
        (str(each.metadata["Name"]), each.version): licence_name(each.metadata)
        for each in distributions()
        if each.metadata["Name"] and not str(each.metadata["Name"]).startswith(_OURS)
    }
    rows = (Licensed(*package, licence) for package, licence in found.items())
    return sorted(rows, key=lambda row: (row.name.lower(), row.version))


def licence_lines(rows: Iterable[Licensed]) -> list[str]:
    """Return packages, versions and licences in columns, one package a line."""
    every = list(rows)
    widths = [max(len(row[column]) for row in every) for column in range(2)]
    return [f"{row.name:<{widths[0]}}  {row.version:<{widths[1]}}  {row.licence}" for row in every]


def summary(rows: Iterable[Licensed]) -> str:
    """Return how many packages have no licence in their metadata."""
    unstated = [row.name for row in rows if row.licence == UNSTATED]
    if not unstated:
        return "every package states its licence"
    return f"{counted(len(unstated), 'package')} without a stated licence: {', '.join(unstated)}"
