"""What carries the messages of a node with a loop: UDP, and what got lost is soon repeated.

Fast DDS over shared memory stops a whole participant for a third of a second when somebody joins
late: it opens the newcomer's channel, and sleeps in a health check while it holds the lock that
every `publish` needs. A loop must not wait for that. Over UDP there is no channel to open; the
other nodes keep their shared memory and are reached over UDP too.

A datagram is lost when its reader is held up for so long that the buffer of its socket runs over.
A reader only learns of it by the writer's heartbeat, by default every 3 s, and until the repetition
all newer messages wait. A loop must not wait for that either: the heartbeat comes every 0.1 s.
"""

from __future__ import annotations

import os
import re
from contextlib import contextmanager
from pathlib import Path
from string import Template
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING, NamedTuple

from rclpy.utilities import get_rmw_implementation_identifier

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

_PROFILE = Path(__file__).with_name("fastdds.xml")
_OF_THE_RANGE = re.compile(r"<!-- range -->.*<!-- /range -->", re.DOTALL)
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"


class _Dialect(NamedTuple):
    """Where a version of Fast DDS looks for a profile, and how it spells a heartbeat in it."""

    variable: str
    heartbeat: str


_DIALECTS = {
    "libfastrtps.so": _Dialect("FASTRTPS_DEFAULT_PROFILES_FILE", "heartbeatPeriod"),
    "libfastdds.so": _Dialect("FASTDDS_DEFAULT_PROFILES_FILE", "heartbeat_period"),
}
"""By the library: that of Fast DDS 2 (ROS 2 Jazzy) and that of 3 (Kilted)."""
_OWN_SETTINGS = (
    _TRANSPORTS,
    *(dialect.variable for dialect in _DIALECTS.values()),
    "ROS_STATIC_PEERS",
    "ROS_LOCALHOST_ONLY",
)


class Settings(NamedTuple):
    """Settings of the middleware.

    Attributes
    ----------
    variables
        Environment variables.
    profile_variable
        Environment variable that is to name a file with the profile.
    profile
        XML.
    """

    variables: dict[str, str]
    profile_variable: str
    profile: str


def loop_settings(environment: Mapping[str, str], libraries: str) -> Settings | None:
    """Return the settings for a process with a loop.

    None for another middleware than Fast DDS, and where the user has set transports, profiles or
    peers: those stand.

    Parameters
    ----------
    environment
        Of the process.
    libraries
        Text with the names of the libraries that the process has loaded, the middleware's among
        them.
    """
    dialect = next((_DIALECTS[name] for name in _DIALECTS if name in libraries), None)
    if dialect is None or any(environment.get(key) for key in _OWN_SETTINGS):
        return None
    profile = Template(_PROFILE.read_text("utf-8")).substitute(heartbeat=dialect.heartbeat)
    if environment.get(_RANGE, "").upper() == "LOCALHOST":
        # With this range rmw_fastrtps makes transports of its own, shared memory among them, and
        # heeds neither variable nor profile. The profile says what the range says.
        return Settings({_RANGE: "SYSTEM_DEFAULT"}, dialect.variable, profile)
    return Settings({_TRANSPORTS: "UDPv4"}, dialect.variable, _OF_THE_RANGE.sub("", profile))


@contextmanager
def loop_transport() -> Iterator[None]:
    """Set up the middleware of this process for a loop.

    To be entered before `rclpy.init`, and left when the first node is made: until then the
    middleware has read its profile, from a file that is not left behind.
    """
    get_rmw_implementation_identifier()  # loads it
    settings = loop_settings(os.environ, Path("/proc/self/maps").read_text())
    if settings is None:
        yield
        return
    with NamedTemporaryFile("w", prefix="flexarm-", suffix=".xml", encoding="utf-8") as file:
        file.write(settings.profile)
        file.flush()
        os.environ.update(settings.variables)
        os.environ[settings.profile_variable] = file.name
        yield
    del os.environ[settings.profile_variable]
