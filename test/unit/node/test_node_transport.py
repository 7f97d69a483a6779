from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from flexarm_node.transport import Settings, loop_settings

FAST_DDS = "/opt/lib/libfastrtps.so.2.14"
LOCALHOST = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}


def settings(environment: dict[str, str], library: str = FAST_DDS) -> Settings:
    made = loop_settings(environment, library)
    assert made is not None
    return made


def elements(profile: str) -> dict[str, str]:
    """Return the texts of a profile's elements, by their names."""
    return {
        each.tag.partition("}")[2]: (each.text or "").strip()
        for each in ET.fromstring(profile).iter()  # noqa: S314 - our own
    }


@pytest.mark.parametrize(
    ("library", "variable", "heartbeat"),
    [
        ("libfastrtps.so.2.14", "FASTRTPS_DEFAULT_PROFILES_FILE", "heartbeatPeriod"),
        ("libfastdds.so.3.2", "FASTDDS_DEFAULT_PROFILES_FILE", "heartbeat_period"),
    ],
)
@pytest.mark.parametrize("environment", [LOCALHOST, {}])
def test_settings___either_fast_dds___prompt_heartbeat_in_its_own_words(
    environment: dict[str, str], library: str, variable: str, heartbeat: str
) -> None:
    made = settings(environment, library)

    assert made.profile_variable == variable
    found = elements(made.profile)
    assert (heartbeat in found, found["sec"], found["nanosec"]) == (True, "0", "100000000")


def test_settings___localhost___profile_in_the_place_of_the_range() -> None:
    made = settings(LOCALHOST)

    assert made.variables == {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}
    found = elements(made.profile)
    assert (found["useBuiltinTransports"], found["type"]) == ("false", "UDPv4")
    assert found["address"] == "127.0.0.1"


@pytest.mark.parametrize("environment", [{}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}])
def test_settings___other_ranges___udp_to_every_address(environment: dict[str, str]) -> None:
    made = settings(environment)

    assert made.variables == {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
    assert not {"participant", "transport_descriptors", "address"} & set(elements(made.profile))


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
    assert loop_settings({**LOCALHOST, own: "1"}, FAST_DDS) is None


def test_settings___other_middleware___nothing() -> None:
    assert loop_settings(LOCALHOST, "/opt/lib/libddsc.so.0") is None
