from __future__ import annotations

import socket
import sys
from contextlib import closing, contextmanager
from itertools import islice
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from websockets.exceptions import InvalidStatus

from flexarm_bags.schema import describe
from flexarm_core.errors import SettingError
from flexarm_live.serving.foxglove_server import ADDRESS, FoxgloveServer, require_foxglove
from support.bag_samples import START_NS, arm_state, reference, typestore
from support.doubles import foxglove as double
from support.foxglove_client import FoxgloveClient

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_bags.schema import MessageDefinition

PATIENCE_S = 60.0
STATE, REFERENCE = "/flexarm/state", "/flexarm/reference"
SERVED = {STATE: "flexarm_msgs/msg/ArmState", REFERENCE: "std_msgs/msg/Float64"}


def definitions() -> dict[str, MessageDefinition]:
    return {topic: describe(typestore(), name) for topic, name in SERVED.items()}


@contextmanager
def serving(port: int) -> Iterator[FoxgloveServer]:
    """Yield a server of two topics, of which one has a value in force."""
    server = FoxgloveServer("/arm", port, definitions(), {REFERENCE})
    try:
        yield server
    finally:
        server.stop()


@pytest.fixture
def sdk(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[double.Server]]:
    """Put the double in the place of the package, and return its servers."""
    monkeypatch.setitem(sys.modules, "foxglove", double)
    yield double.SERVERS
    double.SERVERS.clear()


@pytest.fixture
def port() -> int:
    """Return a free port; a test with it needs the package."""
    pytest.importorskip("foxglove", reason="pip install -r requirements/foxglove.in")
    with socket.create_server((ADDRESS, 0)) as free:
        return int(free.getsockname()[1])


def test_package___that_is_missing___is_named_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(SettingError, match=r"pip install -r requirements/foxglove\.in"):
        require_foxglove()


def test_server___is_on_loopback_and_takes_nothing(sdk: list[double.Server]) -> None:
    with serving(8123):
        (server,) = sdk
        assert (server.settings["host"], server.settings["port"]) == ("127.0.0.1", 8123)
        assert "capabilities" not in server.settings
        assert "services" not in server.settings
    assert server.stopped


@pytest.mark.usefixtures("sdk")
def test_server___with_a_port_that_is_taken___says_so() -> None:
    with pytest.raises(SettingError, match=rf"127\.0\.0\.1 port {double.TAKEN}: .*in use"):
        FoxgloveServer("/arm", double.TAKEN, {}, ())


def test_messages___go_to_their_channel_as_they_are(sdk: list[double.Server]) -> None:
    sample, set_point = arm_state(1, START_NS), reference(START_NS + 1, 1.5)
    with serving(8123) as server:
        for each in (sample, set_point):
            server.send(each.topic, each.raw, each.time_ns)
        channels = sdk[0].settings["context"].channels
    for topic, definition in definitions().items():
        channel = channels[topic]
        assert (channel.message_encoding, channel.schema.encoding) == ("cdr", "ros2msg")
        assert (channel.schema.name, channel.schema.data.decode()) == (
            SERVED[topic],
            definition.text,
        )
    assert channels[STATE].logged == [(sample.raw, START_NS)]
    assert channels[REFERENCE].logged == [(set_point.raw, START_NS + 1)]


def test_subscription___gets_what_is_in_force_and_no_old_sample(sdk: list[double.Server]) -> None:
    old, new = reference(START_NS, 1.0), reference(START_NS + 5, 2.0)
    with serving(8123) as server:
        channels = sdk[0].settings["context"].channels
        listener = sdk[0].settings["server_listener"]

        listener.on_subscribe(None, SimpleNamespace(topic=REFERENCE))
        assert channels[REFERENCE].logged == []

        for each in (old, new, arm_state(1, START_NS)):
            server.send(each.topic, each.raw, each.time_ns)
        for channel in channels.values():
            channel.logged.clear()
        for topic in SERVED:
            listener.on_subscribe(None, SimpleNamespace(topic=topic))
    assert channels[REFERENCE].logged == [(new.raw, new.time_ns)]
    assert channels[STATE].logged == []


def test_viewer___decodes_every_sample_by_what_the_server_says(port: int) -> None:
    sent = [
        arm_state(n, START_NS + n, (0.25 * n, 0.0, 0.0, -1.0), frame_id="flexarm/base_link")
        for n in range(1, 2001)
    ]
    with serving(port) as server:
        server.send(REFERENCE, reference(START_NS, 1.5).raw, START_NS)
        with closing(FoxgloveClient(port, PATIENCE_S)) as viewer:
            assert (viewer.name, viewer.capabilities) == ("/arm", [])
            # What is in force comes at once, and shows that the subscriptions are there.
            viewer.subscribe([STATE, REFERENCE])
            messages = viewer.messages()
            set_point = next(messages)
            for each in sent:
                server.send(each.topic, each.raw, each.time_ns)
            received = list(islice(messages, len(sent)))
            reported = viewer.channels[STATE]

    assert (set_point.topic, set_point.time_ns) == (REFERENCE, START_NS)
    assert [(each.time_ns, each.raw) for each in received] == [(s.time_ns, s.raw) for s in sent]
    assert (reported["encoding"], reported["schemaEncoding"]) == ("cdr", "ros2msg")
    assert reported["schemaName"] == SERVED[STATE]
    types = get_typestore(Stores.EMPTY)
    types.register(get_types_from_msg(reported["schema"], reported["schemaName"]))
    last: object = types.deserialize_cdr(received[-1].raw, reported["schemaName"])
    assert getattr(last, "position_v") == 0.25 * 2000  # noqa: B009 - of a type made here
    assert getattr(last, "sequence") == 2000  # noqa: B009


def test_viewer___of_another_address_or_an_older_protocol___is_refused(port: int) -> None:
    with serving(port):
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", port), PATIENCE_S)
        with pytest.raises(InvalidStatus, match="400"):
            FoxgloveClient(port, PATIENCE_S, "foxglove.websocket.v1")


def test_server___with_a_port_that_is_really_taken___says_so(port: int) -> None:
    with (
        socket.create_server((ADDRESS, port)),
        pytest.raises(SettingError, match=rf"cannot listen on 127\.0\.0\.1 port {port}: "),
    ):
        FoxgloveServer("/arm", port, definitions(), ())
