from __future__ import annotations

import pytest

from flexarm_node.transport import LOOPBACK_PROFILE, settings_without_shared_memory

FAST_DDS = "/opt/lib/libfastrtps.so.2.14"
LOCALHOST = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


@pytest.mark.parametrize(
    ("library", "variable"),
    [
        ("libfastrtps.so.2.14", "FASTRTPS_DEFAULT_PROFILES_FILE"),
        ("libfastdds.so.3.2", "FASTDDS_DEFAULT_PROFILES_FILE"),
    ],
)
def test_settings___localhost___profile_in_the_place_of_the_range(
    library: str, variable: str
) -> None:
    assert settings_without_shared_memory(LOCALHOST, library) == {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        variable: str(LOOPBACK_PROFILE),
    }


@pytest.mark.parametrize("environment", [{}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}])
def test_settings___other_ranges___udp_alone(environment: dict[str, str]) -> None:
    settings = settings_without_shared_memory(environment, FAST_DDS)
    assert settings == {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}


@pytest.mark.parametrize(
    "own",
    [
        "FASTDDS_BUILTIN_TRANSPORTS",
        "FASTRTPS_DEFAULT_PROFILES_FILE",
        "FASTDDS_DEFAULT_PROFILES_FILE",
        "ROS_STATIC_PEERS",
        "ROS_LOCALHOST_ONLY",
    ],
)
def test_settings___what_the_user_has_set___stands(own: str) -> None:
    assert settings_without_shared_memory({**LOCALHOST, own: "1"}, FAST_DDS) == {}


def test_settings___other_middleware___nothing() -> None:
    assert settings_without_shared_memory(LOCALHOST, "/opt/lib/libddsc.so.0") == {}
