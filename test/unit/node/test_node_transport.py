from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from flexarm_core.errors import SettingError
from flexarm_node.transport import (
    middleware_settings,
    require_security,
    shared_memory_warning,
)

FAST_DDS = "/opt/lib/libfastrtps.so.2.14"
PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
LOCALHOST = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
PEERS = {"ROS_STATIC_PEERS": "10.0.0.1"}
TRANSPORTS = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
VERSIONS = [
    (FAST_DDS, PROFILE, "heartbeatPeriod"),
    ("libfastdds.so.3.2", "FASTDDS_DEFAULT_PROFILES_FILE", "heartbeat_period"),
]


def elements(profile: str) -> dict[str, str]:
    """Return the texts of a profile's elements, by their names."""
    root = ET.parse(Path(profile)).getroot()  # noqa: S314 - our own
    return {each.tag.partition("}")[2]: (each.text or "").strip() for each in root.iter()}


@pytest.mark.parametrize(("library", "variable", "heartbeat"), VERSIONS)
@pytest.mark.parametrize("environment", [LOCALHOST, {}, PEERS])
def test_settings___loop_with_either_version___prompt_heartbeat_in_its_own_words(
    environment: dict[str, str], library: str, variable: str, heartbeat: str
) -> None:
    found = elements(middleware_settings(environment, library, loop=True)[variable])

    # The last times of the profile are those of the heartbeat.
    assert (heartbeat in found, found["sec"], found["nanosec"]) == (True, "0", "100000000")


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize(
    "environment", [LOCALHOST, {"ROS_LOCALHOST_ONLY": "1"}, LOCALHOST | TRANSPORTS]
)
@pytest.mark.parametrize(("library", "variable", "_"), VERSIONS)
def test_settings___localhost___profile_in_the_place_of_the_range(
    library: str, variable: str, _: str, environment: dict[str, str], *, loop: bool
) -> None:
    settings = middleware_settings(environment, library, loop=loop)

    found = elements(settings.pop(variable))
    assert settings == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        "ROS_LOCALHOST_ONLY": "",
    }
    assert (found["useBuiltinTransports"], found["type"]) == ("false", "UDPv4")
    assert found["address"] == "127.0.0.1"


@pytest.mark.parametrize(("library", "variable", "_"), VERSIONS)
def test_settings___localhost___participants_announce_themselves_often(
    library: str, variable: str, _: str
) -> None:
    profile = middleware_settings(LOCALHOST, library, loop=False)[variable]
    (announcement,) = (
        each
        for each in ET.parse(profile).getroot().iter()  # noqa: S314 - our own
        if each.tag.endswith("}leaseAnnouncement")
    )
    assert [each.text for each in announcement] == ["0", "500000000"]


@pytest.mark.parametrize("environment", [{}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}])
def test_settings___loop_in_other_ranges___udp_to_every_address(
    environment: dict[str, str],
) -> None:
    settings = middleware_settings(environment, FAST_DDS, loop=True)

    found = elements(settings.pop(PROFILE))
    assert settings == TRANSPORTS
    assert not {"participant", "transport_descriptors", "address"} & set(found)


@pytest.mark.parametrize("own", [TRANSPORTS, PEERS, LOCALHOST | PEERS])
def test_settings___loop_with_transports_or_peers_of_the_user___stand(own: dict[str, str]) -> None:
    settings = middleware_settings(own, FAST_DDS, loop=True)

    assert "participant" not in elements(settings.pop(PROFILE))
    assert settings == {}


@pytest.mark.parametrize("environment", [{}, TRANSPORTS, LOCALHOST | PEERS])
def test_settings___no_loop_and_others_may_listen___nothing(environment: dict[str, str]) -> None:
    assert middleware_settings(environment, FAST_DDS, loop=False) == {}


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize("own", [variable for _, variable, _ in VERSIONS])
def test_settings___profile_of_the_user___is_the_only_one(own: str, *, loop: bool) -> None:
    assert middleware_settings({**LOCALHOST, own: "mine.xml"}, FAST_DDS, loop=loop) == {}


@pytest.mark.parametrize(
    ("environment", "beginning"),
    [
        ({"ROS_STATIC_PEERS": "10.0.0.1"}, "as ROS_STATIC_PEERS has it, this node uses shared"),
        ({PROFILE: "mine.xml"}, f"as {PROFILE} has it, this node uses shared memory: "),
        ({}, "this node uses shared memory: one that joins late may stop the loop"),
    ],
)
def test_shared_memory___in_use___is_reported_with_its_cause(
    environment: dict[str, str], beginning: str
) -> None:
    maps = "7f00-7f10 rw-s 00000000 00:1a 5 /dev/shm/fastrtps_port7410\n"
    assert shared_memory_warning(environment, maps).startswith(beginning)
    assert shared_memory_warning(environment, "/usr/lib/libfastrtps.so\n") == ""


def test_settings___other_middleware___nothing() -> None:
    assert middleware_settings(LOCALHOST, "/opt/lib/libddsc.so.0", loop=True) == {}


@pytest.mark.parametrize(
    ("asked", "text", "refused"),
    [
        ("true", b"Fast DDS doesn't have the security libraries", True),
        ("true", b"dds.sec.auth.plugin", False),
        ("false", b"Fast DDS doesn't have the security libraries", False),
        ("", b"Fast DDS doesn't have the security libraries", False),
    ],
)
def test_security___asked_for_and_not_built_in___is_refused(
    tmp_path: Path, asked: str, text: bytes, *, refused: bool
) -> None:
    library = tmp_path / "librmw_fastrtps_shared_cpp.so"
    library.write_bytes(b"\x7fELF" + text)
    maps = f"7f00-7f10 r-xp 00000000 00:1a 5 {library}\n7f10-7f20 rw-p 00000000 00:00 0\n"
    environment = {"ROS_SECURITY_ENABLE": asked}
    if refused:
        with pytest.raises(SettingError, match="built without SROS2; use a ROS 2 installation"):
            require_security(environment, maps)
    else:
        require_security(environment, maps)
