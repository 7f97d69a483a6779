"""Transport of the nodes: none but loopback where that is asked for, and none that stops a loop.

In the range LOCALHOST rmw_fastrtps finds this machine alone, but its sockets listen on every
address, and a participant elsewhere that knows the ports can join. A profile that keeps the sockets
on loopback takes the place of the range, in every process of flexarm.

A participant announces itself before it listens, to one port of this machine after the other: the
answers of those that are there come too early, and are dropped. It learns of them with their next
announcement, by default every 3 s: a node would wait that long for its graph, and a stop for its
node. The profile announces every 0.5 s.

Fast DDS over shared memory stops a whole participant for a third of a second when a node joins
late: it opens the newcomer's channel, and sleeps in a health check while it holds the lock that
every `publish` needs. A loop must not wait for that. UDP has no channel to open; the other nodes
keep their shared memory and are reached over UDP too.

A datagram is lost when its reader pauses until the buffer of its socket overflows. The reader
learns of it by the writer's heartbeat only, by default every 3 s, and all newer messages wait for
the repetition. A loop must not wait for that either: the heartbeat comes every 0.1 s.

Publishing in another thread would not help where shared memory is in force: the lock delays the
sample and its answer in every thread. There the node warns at its start.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rclpy.utilities import get_rmw_implementation_identifier

from flexarm_core.errors import SettingError
from flexarm_core.own_files import OwnFileError, private_folder

if TYPE_CHECKING:
    from collections.abc import Mapping

_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_LOCALHOST_ONLY = "ROS_LOCALHOST_ONLY"
_PEERS = "ROS_STATIC_PEERS"
_SECURITY = "ROS_SECURITY_ENABLE"
_SECURED = "librmw_fastrtps_shared_cpp.so"
# From the message of a rmw_fastrtps that was built without security; another one has no such text.
_NO_SECURITY = b"doesn't have the security libraries"
_LOG = "ROS_LOG_DIR"
_ROS_HOME = "ROS_HOME"
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_PROFILES = Path(__file__).with_name("profiles")


class _Version(NamedTuple):
    """Differences between the versions of Fast DDS: also their profiles use different words."""

    name: str
    profile_variable: str


_VERSIONS = {
    "libfastrtps.so": _Version("fastdds2", "FASTRTPS_DEFAULT_PROFILES_FILE"),
    "libfastdds.so": _Version("fastdds3", "FASTDDS_DEFAULT_PROFILES_FILE"),
}
"""By their library: that of ROS 2 Jazzy and that of Kilted."""
_GIVEN: dict[str, str] = {}
"""The environment as it was before the middleware was set up."""
_OWN_PROFILES = tuple(version.profile_variable for version in _VERSIONS.values())
_SEGMENTS = "/dev/shm/fast"  # noqa: S108 - where Fast DDS keeps it
_OWN_TRANSPORTS = (_TRANSPORTS, _PEERS)


def middleware_settings(
    environment: Mapping[str, str], libraries: str, *, loop: bool
) -> dict[str, str]:
    """Return the environment variables that set up the middleware of a process.

    There are none for a middleware other than Fast DDS. The user's settings stay: an own profile
    replaces all, own peers or transports leave only the heartbeat of a loop to set. In the range
    LOCALHOST own transports have no effect, with or without flexarm.

    Parameters
    ----------
    environment : mapping of str to str
        Environment of the process.
    libraries : str
        Names of the libraries that the process has loaded, the middleware's among them.
    loop : bool
        True for the process of a node with a loop.
    """
    version = next((_VERSIONS[name] for name in _VERSIONS if name in libraries), None)
    if version is None or any(environment.get(key) for key in _OWN_PROFILES):
        return {}
    if _is_private(environment) and not environment.get(_PEERS):
        # With this range rmw_fastrtps makes transports of its own, shared memory among them, and
        # heeds neither variable nor profile. The profile says what the range says.
        loopback = str(_PROFILES / f"{version.name}_localhost.xml")
        return {
            _RANGE: "SYSTEM_DEFAULT",
            _LOCALHOST_ONLY: "",
            version.profile_variable: loopback,
        }
    if not loop:
        return {}
    heartbeat = {version.profile_variable: str(_PROFILES / f"{version.name}.xml")}
    own = any(environment.get(key) for key in _OWN_TRANSPORTS)
    return heartbeat if own else {_TRANSPORTS: "UDPv4"} | heartbeat


def _is_private(environment: Mapping[str, str]) -> bool:
    return (
        environment.get(_RANGE, "").upper() == "LOCALHOST"
        or environment.get(_LOCALHOST_ONLY) == "1"
    )


def shared_memory_warning(environment: Mapping[str, str], maps: str) -> str:
    """Return a line of warning when a process with a loop uses shared memory, else an empty one.

    Parameters
    ----------
    environment : mapping of str to str
        Environment of the process.
    maps : str
        Memory map of the process with a node in it, one line each.
    """
    if _SEGMENTS not in maps:
        return ""
    own = [key for key in (*_OWN_TRANSPORTS, *_OWN_PROFILES) if environment.get(key)]
    cause = f"as {', '.join(own)} has it, " if own else ""
    return (
        f"{cause}this node uses shared memory: one that joins late may stop the loop for a third of"
        " a second; leave shared memory out, such as by FASTDDS_BUILTIN_TRANSPORTS=UDPv4"
    )


def require_security(environment: Mapping[str, str], maps: str) -> None:
    """Refuse to go on unprotected, or with an error of the middleware, when SROS2 is asked for.

    Parameters
    ----------
    environment : mapping of str to str
        Environment of the process.
    maps : str
        Memory map of the process with the middleware in it, one line each.

    Raises
    ------
    SettingError
        When the middleware is built without it.
    """
    if environment.get(_SECURITY, "").lower() != "true":
        return
    libraries = {line.split()[-1] for line in maps.splitlines() if _SECURED in line}
    if any(_NO_SECURITY in Path(library).read_bytes() for library in libraries):
        raise SettingError(
            f"{_SECURITY}=true: the ROS 2 of these Python packages is built without SROS2; "
            "use a ROS 2 installation, or unset it and see who may drive in docs/security.md"
        )


def log_settings(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment variables with which ROS finds a folder for its log files.

    There are none where it can write in `~/.ros/log`, or where the user has chosen the folder.
    Otherwise ROS would not start: the folder is a private one among the temporary files.

    Raises
    ------
    SettingError
        When there is no such folder either.
    """
    if environment.get(_LOG) or environment.get(_ROS_HOME):
        return {}
    if _takes_files(Path(environment.get("HOME", os.devnull), ".ros", "log")):
        return {}
    try:
        return {_LOG: str(private_folder() / "log")}
    except (OwnFileError, OSError) as error:
        raise SettingError(f"no folder for log files: {error}; set {_LOG} to one") from None


def _takes_files(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def set_up_middleware(*, loop: bool = False) -> None:
    """Set up the middleware and the log of this process; call it before `rclpy.init`.

    Raises
    ------
    SettingError
        When SROS2 is asked for and missing, or when there is no folder for log files.
    """
    get_rmw_implementation_identifier()  # loads it
    require_security(os.environ, _mapped())
    _GIVEN.update(os.environ)
    os.environ.update(middleware_settings(_GIVEN, _mapped(), loop=loop))
    os.environ.update(log_settings(_GIVEN))


def complaint_about_transport() -> str:
    """Return `shared_memory_warning` of this process, which must have a node."""
    return shared_memory_warning(_GIVEN, _mapped())


def _mapped() -> str:
    return Path("/proc/self/maps").read_text()
