"""What carries the messages of a node with a loop: UDP, never shared memory.

Fast DDS over shared memory stops a whole participant for a third of a second when somebody joins
late: it opens the newcomer's channel, and sleeps in a health check while it holds the lock that
every `publish` needs. A loop must not wait for that. Over UDP there is no channel to open; the
other nodes keep their shared memory and are reached over UDP too.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from rclpy.utilities import get_rmw_implementation_identifier

if TYPE_CHECKING:
    from collections.abc import Mapping

LOOPBACK_PROFILE = Path(__file__).with_name("loopback.xml")

_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
_PROFILES = {
    "libfastrtps.so": "FASTRTPS_DEFAULT_PROFILES_FILE",
    "libfastdds.so": "FASTDDS_DEFAULT_PROFILES_FILE",
}
"""Library of Fast DDS 2 (ROS 2 Jazzy) and 3 (Kilted), and where each looks for profiles."""
_OWN_SETTINGS = (_TRANSPORTS, *_PROFILES.values(), "ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY")


def settings_without_shared_memory(
    environment: Mapping[str, str], libraries: str
) -> dict[str, str]:
    """Return the environment variables that keep a process from shared memory.

    Nothing for another middleware than Fast DDS, and nothing where the user has set transports,
    profiles or peers: those stand.

    Parameters
    ----------
    environment
        Of the process.
    libraries
        Text with the names of the libraries that the process has loaded, the middleware's among
        them.
    """
    profiles = next((_PROFILES[name] for name in _PROFILES if name in libraries), None)
    if profiles is None or any(environment.get(key) for key in _OWN_SETTINGS):
        return {}
    if environment.get(_RANGE, "").upper() != "LOCALHOST":
        return {_TRANSPORTS: "UDPv4"}
    # With this range rmw_fastrtps makes transports of its own, shared memory among them, and
    # reads neither variable nor profile. The profile says what the range says.
    return {_RANGE: "SYSTEM_DEFAULT", profiles: str(LOOPBACK_PROFILE)}


def leave_shared_memory() -> None:
    """Keep this process from shared memory. Before `rclpy.init`."""
    get_rmw_implementation_identifier()  # loads it
    libraries = Path("/proc/self/maps").read_text()
    os.environ.update(settings_without_shared_memory(os.environ, libraries))
