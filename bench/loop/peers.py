"""Peers of the loop in C: the same exchange on rcl, and as datagrams on loopback without ROS.

rcl is what rclcpp and rclpy wrap. The programs are built where they are measured (`peer/`).
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sysconfig
from pathlib import Path
from typing import Final

from flexarm_bringup.graph.processes import LaunchError
from flexarm_node.transport import middleware_settings

RCL: Final = "rcl"
UDP: Final = "udp"
_SOURCES = Path(__file__).with_name("peer")
_LIBRARIES = (
    "rcl",
    "rcutils",
    "rmw",
    "rosidl_runtime_c",
    "flexarm_msgs__rosidl_typesupport_c",
    "flexarm_msgs__rosidl_generator_c",
)
# Discovery of the two ends, and the settling before the measurement.
_START_S = 60.0


def built(folder: Path) -> tuple[dict[str, Path], list[str]]:
    """Build the peers into a folder.

    Returns
    -------
    dict of str to Path
        The programs by their names, as far as they can be built here.
    list of str
        A line for each that is missing.
    """
    compiler = shutil.which("gcc")
    if compiler is None:
        return {}, ["no peer in C: gcc is not installed"]
    folder.mkdir(parents=True, exist_ok=True)
    programs, missing = {}, []
    for name, options in ((RCL, _rcl_options()), (UDP, [])):
        program = folder.absolute() / name
        command = [compiler, "-O2", str(_SOURCES / f"{name}.c"), "-o", str(program), *options]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - our own program
        if done.returncode == 0:
            programs[name] = program
        else:
            reason = next((line for line in done.stderr.splitlines() if "error" in line), "")
            missing.append(f"no peer {name}: {reason or done.stderr.strip()}")
    return programs, missing


def measured(program: Path, rate_hz: float, length_s: float) -> dict[str, float]:
    """Run a peer for that long.

    Returns
    -------
    dict of str to float
        `p50 p99 p999 max` of the reply in ms; `samples`, `unanswered`, `missed`; `cpu` of its DAQ.

    Raises
    ------
    LaunchError
        When it does not do its part.
    """
    maps = Path("/proc/self/maps").read_text("utf-8")
    settings = middleware_settings(os.environ, maps, loop=True)
    environment = os.environ | settings | {"PEER_PORT": str(_free_port())}
    with subprocess.Popen([program, "controller"], env=environment) as controller:  # noqa: S603 - our own program
        try:
            done = subprocess.run(  # noqa: S603 - our own program
                [program, "daq", f"{rate_hz}", f"{length_s}"],
                env=environment,
                capture_output=True,
                text=True,
                check=False,
                timeout=length_s + _START_S,
            )
        except subprocess.TimeoutExpired:
            raise LaunchError(f"the peer {program.name} did not end") from None
        finally:
            controller.kill()
    if done.returncode:
        raise LaunchError(f"the peer {program.name}: {done.stderr.strip()}")
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def _rcl_options() -> list[str]:
    """Return the options of the compiler for headers and libraries of every prefix of ROS."""
    prefixes = [Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(":") if each]
    includes = [prefix / "include" for prefix in prefixes]
    packages = [each for folder in includes if folder.is_dir() for each in folder.iterdir()]
    return [
        *(f"-I{folder}" for folder in (*includes, *packages)),
        *(f"-L{prefix / 'lib'}" for prefix in prefixes),
        *(f"-l{name}" for name in _LIBRARIES),
        # What these libraries use themselves is found at run time.
        "-Wl,--unresolved-symbols=ignore-in-shared-libs",
        *_python_options(),
    ]


def _python_options() -> list[str]:
    """Return the options for Python's library: one of the wheels uses it and does not name it."""
    folder, version = (sysconfig.get_config_var(name) for name in ("LIBDIR", "LDVERSION"))
    if not Path(folder, f"libpython{version}.so").exists():
        return []
    return ["-Wl,--no-as-needed", f"-L{folder}", f"-Wl,-rpath,{folder}", f"-lpython{version}"]


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port
