"""Transport of a node with a loop: UDP, with lost messages soon repeated.

Fast DDS over shared memory stops a whole participant for a third of a second when somebody joins
late: it opens the newcomer's channel, and sleeps in a health check while it holds the lock that
every `publish` needs. A loop must not wait for that. Over UDP there is no channel to open; the
other nodes keep their shared memory and are reached over UDP too.

A datagram is lost when its reader is held up for so long that the buffer of its socket runs over.
A reader only learns of it by the writer's heartbeat, by default every 3 s, and until the repetition
all newer messages wait. A loop must not wait for that either: the heartbeat comes every 0.1 s.

Publishing in another thread would not help where shared memory is in force: the sample and its
answer have to get through in time, and the lock keeps them back whoever sends them. There the node
says at its start what may come.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rclpy.utilities import get_rmw_implementation_identifier

if TYPE_CHECKING:
    from collections.abc import Mapping

_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_PROFILES = Path(__file__).with_name("profiles")


class _Version(NamedTuple):
    """What differs between the versions of Fast DDS: so do the words in their profiles."""

    name: str
    profile_variable: str


_VERSIONS = {
    "libfastrtps.so": _Version("fastdds2", "FASTRTPS_DEFAULT_PROFILES_FILE"),
    "libfastdds.so": _Version("fastdds3", "FASTDDS_DEFAULT_PROFILES_FILE"),
}
"""By their library: that of ROS 2 Jazzy and that of Kilted."""
_GIVEN: dict[str, str] = {}
"""The environment as it was before it was set up for a loop."""
_OWN_PROFILES = tuple(version.profile_variable for version in _VERSIONS.values())
_SEGMENTS = "/dev/shm/fast"  # noqa: S108 - where Fast DDS keeps it
_OWN_TRANSPORTS = (_TRANSPORTS, "ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY")


def settings_for_a_loop(environment: Mapping[str, str], libraries: str) -> dict[str, str]:
    """Return the environment variables that set up the middleware of a process with a loop.

    Nothing for another middleware than Fast DDS. What the user has set stands: an own profile says
    all, own transports or peers leave only the heartbeat to be said.

    Parameters
    ----------
    environment
        Of the process.
    libraries
        Text with the names of the libraries that the process has loaded, the middleware's among
        them.
    """
    version = next((_VERSIONS[name] for name in _VERSIONS if name in libraries), None)
    if version is None or any(environment.get(key) for key in _OWN_PROFILES):
        return {}
    heartbeat = {version.profile_variable: str(_PROFILES / f"{version.name}.xml")}
    if any(environment.get(key) for key in _OWN_TRANSPORTS):
        return heartbeat
    if environment.get(_RANGE, "").upper() != "LOCALHOST":
        return {_TRANSPORTS: "UDPv4"} | heartbeat
    # With this range rmw_fastrtps makes transports of its own, shared memory among them, and
    # heeds neither variable nor profile. The profile says what the range says.
    loopback = str(_PROFILES / f"{version.name}_localhost.xml")
    return {_RANGE: "SYSTEM_DEFAULT", version.profile_variable: loopback}


def shared_memory_warning(environment: Mapping[str, str], maps: str) -> str:
    """Return what a person should know when Fast DDS uses shared memory in a process with a loop.

    Parameters
    ----------
    environment
        Of the process.
    maps
        What the process has mapped into its memory, one line each, with a node in it.

    Returns
    -------
    str
        One line; empty where no shared memory is used.
    """
    if _SEGMENTS not in maps:
        return ""
    own = [key for key in (*_OWN_TRANSPORTS, *_OWN_PROFILES) if environment.get(key)]
    cause = f"as {', '.join(own)} has it, " if own else ""
    return (
        f"{cause}this node uses shared memory: one that joins late may stop the loop for a third of"
        " a second; leave shared memory out, such as by FASTDDS_BUILTIN_TRANSPORTS=UDPv4"
    )


def set_up_for_a_loop() -> None:
    """Set up the middleware of this process for a loop. Before `rclpy.init`."""
    get_rmw_implementation_identifier()  # loads it
    _GIVEN.update(os.environ)
    os.environ.update(settings_for_a_loop(_GIVEN, _mapped()))


def complaint_about_transport() -> str:
    """Return `shared_memory_warning` of this process. When it has a node."""
    return shared_memory_warning(_GIVEN, _mapped())


def _mapped() -> str:
    return Path("/proc/self/maps").read_text()
