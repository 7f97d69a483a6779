from __future__ import annotations

import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from ament_index_python.packages import get_package_share_directory
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, ConnectionExtRosbag2, Qos, QosDurability
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from flexarm_bags.check import check_bag
from flexarm_bags.repair import repair_bag
from flexarm_msgs.msg import ArmState, MotorCommand
from flexarm_node import qos
from support.bag_samples import played_bag
from support.recorded_samples import States, content
from support.system_graph import fill_disk

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    from support.system_graph import Graph, Process

pytestmark = pytest.mark.system

RECORDED = ("commander", "state", "command", "reference", "joint_states", "payload")
BESIDE = ("/diagnostics", "/rosout", "/parameter_events")
TOPICS = {"/flexarm/state", "/flexarm/command", "/flexarm/reference"}


def message_count(bag: Path) -> int:
    """Return what the metadata says."""
    text = yaml.safe_load((bag / "metadata.yaml").read_text())
    return int(text["rosbag2_bagfile_information"]["message_count"])


def qos_of(connection: Connection) -> Qos:
    """Return what a topic's publisher offered."""
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    (profile,) = connection.ext.offered_qos_profiles
    return profile


def is_latched(connection: Connection) -> bool:
    """Return whether a viewer that joins late was offered the last message."""
    return qos_of(connection).durability is QosDurability.TRANSIENT_LOCAL


def installed(name: str) -> str:
    """Return the installed text of a message, ``package/Type``."""
    package, _, short = name.partition("/")
    share = Path(get_package_share_directory(package))
    return (share / "msg" / f"{short}.msg").read_text("utf-8")


def decoded_by_embedded_definitions(file: Path) -> dict[str, list[Any]]:
    """Decode an MCAP file with nothing but what is in it."""
    found: dict[str, list[Any]] = {}
    types: dict[int, Typestore] = {}
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            if schema.id not in types:
                types[schema.id] = get_typestore(Stores.EMPTY)
                types[schema.id].register(get_types_from_msg(schema.data.decode(), schema.name))
            found.setdefault(channel.topic, []).append(
                types[schema.id].deserialize_cdr(message.data, schema.name)
            )
    return found


def test_recorded_bag___is_read_by_rosbags_and_by_its_own_definitions(
    graph: Graph, tmp_path: Path
) -> None:
    bag = tmp_path / "run"
    graph.start("recorder", {"topics": [*RECORDED, *BESIDE]})
    graph.start("controller", {"law": "pdpc", "reference": "step"})
    graph.start("daq", {"real_time_factor": 0.0, "answer_timeout_s": 0.05})
    graph.configure_loop()
    # A run that the controller hears and does not answer: the bag shall have nothing of it.
    graph.operator.sample(5, lambda _: None)
    graph.operator.set_parameters("daq", {"answer_timeout_s": 10.0})
    graph.operator.recorded_run("controller", str(bag), 300, lambda _: None)
    publishers = {
        topic: graph.node.get_publishers_info_by_topic(topic)
        for topic in [*BESIDE, *(f"/flexarm/{name}" for name in RECORDED)]
    }

    with AnyReader([bag]) as reader:
        deserialised: dict[str, list[Any]] = {}
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            deserialised.setdefault(connection.topic, []).append(message)
        assert reader.message_count == message_count(bag)
        recorded = {connection.topic: connection for connection in reader.connections}

    # The installed files of the messages stand in the bag, with the comments that tell units.
    assert set(recorded) == set(publishers)
    for topic, connection in recorded.items():
        outer, *nested = connection.msgdef.data.split(f"\n{'=' * 80}\nMSG: ")
        assert outer == installed(connection.msgtype.replace("/msg/", "/"))
        for text in nested:
            name, _, definition = text.partition("\n")
            assert definition == installed(name)
        # What `ros2 topic info -v` shows, of a publisher that is still there.
        info = publishers[topic][0]
        assert connection.digest == str(info.topic_type_hash)
        reported = qos_of(connection)
        assert reported.reliability.name == info.qos_profile.reliability.name
        assert reported.durability.name == info.qos_profile.durability.name
        for one, other in (
            (reported.deadline, info.qos_profile.deadline),
            (reported.lifespan, info.qos_profile.lifespan),
        ):
            assert one.sec * 10**9 + one.nsec == other.nanoseconds
    assert {topic for topic in recorded if is_latched(recorded[topic])} == {
        "/flexarm/commander",
        "/flexarm/reference",
        "/flexarm/payload",
        "/rosout",
    }
    (file,) = bag.glob("*.mcap")
    states = deserialised["/flexarm/state"]
    assert set(deserialised) >= TOPICS | {"/flexarm/commander", "/diagnostics", "/rosout"}
    assert [state.sequence for state in states] == list(range(1, 301))
    answered = [command.state_sequence for command in deserialised["/flexarm/command"]]
    assert sorted(set(answered)) == answered
    assert set(answered) <= set(range(1, 301))
    assert deserialised["/flexarm/reference"][-1].data == 3.0
    own = decoded_by_embedded_definitions(file)
    assert {topic: len(messages) for topic, messages in own.items()} == {
        topic: len(messages) for topic, messages in deserialised.items()
    }
    for mine, theirs in zip(own["/flexarm/state"], states, strict=True):
        assert (mine.header.frame_id, mine.header.stamp.nanosec) == (
            "flexarm/base_link",
            theirs.header.stamp.nanosec,
        )
        assert (mine.position_v, mine.speed_v, mine.command_v) == (
            theirs.position_v,
            theirs.speed_v,
            theirs.command_v,
        )


@pytest.mark.parametrize(
    "signals",
    [
        pytest.param((signal.SIGINT,), id="ctrl_c"),
        pytest.param((signal.SIGTERM,), id="terminate"),
        pytest.param((signal.SIGINT, signal.SIGINT), id="ctrl_c_twice"),
    ],
)
@pytest.mark.exhaustive
def test_signal___ends_every_node_cleanly(
    graph: Graph, tmp_path: Path, signals: tuple[signal.Signals, ...]
) -> None:
    played_bag(tmp_path / "played", 100)
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    nodes: list[Process] = [
        graph.start("recorder", {"bag": str(tmp_path / "run")}),
        graph.start("ident", {"output_folder": str(tmp_path)}),
        graph.start(
            "player",
            {"bag": str(tmp_path / "played"), "loop": True},
            *(word for topic in TOPICS for word in ("-r", f"{topic}:=/elsewhere{topic}")),
        ),
        graph.start("controller", {"autostart": True, "reference": "square"}),
        graph.start("daq", {"autostart": True, "rate_hz": 300.0}),
    ]
    graph.wait(lambda: "/flexarm/ident" in graph.operator.nodes(), "the ident node")
    graph.wait(lambda: graph.node.count_publishers("/elsewhere/flexarm/state") == 1, "the player")
    graph.wait(lambda: len(states) > 200, "samples")
    (file,) = (tmp_path / "run").glob("*.mcap")
    graph.wait(lambda: file.stat().st_size > 20_000, "a second of recording")

    codes = [graph.stop(node, *signals) for node in nodes]

    assert codes == [0] * len(nodes)
    for node in nodes:
        assert "Traceback" not in node.printed
        assert "terminate called" not in node.printed
    recorded = content(tmp_path / "run")
    assert len(recorded["/flexarm/state"]) > 100
    assert sum(map(len, recorded.values())) == message_count(tmp_path / "run")


def test_full_disk___stops_the_recorder_with_an_error_and_not_the_loop(
    graph: Graph, tmp_path: Path
) -> None:
    commands: list[MotorCommand] = []
    graph.node.create_subscription(MotorCommand, "command", commands.append, qos.EVERY)
    recorder = graph.run_node("recorder", {"bag": str(tmp_path / "run")})
    recorder.wait_for("recording to")
    graph.start("controller", {"autostart": True, "reference": "square"})
    graph.start("daq", {"autostart": True})
    (file,) = (tmp_path / "run").glob("*.mcap")
    graph.wait(lambda: file.stat().st_size > 20_000, "a second of recording")
    fill_disk(recorder.popen.pid, file)

    recorder.wait_for("recording stopped")
    before = len(commands)
    graph.wait(lambda: len(commands) > before + 100, "commands after the error")

    assert "cannot write: File too large" in recorder.printed
    recorder.send(signal.SIGINT)
    assert recorder.exit_code() == 1
    assert "Traceback" not in recorder.printed
    summary = repair_bag(tmp_path / "run", tmp_path / "repaired")
    assert check_bag(summary.bag).messages == summary.messages > 300


@pytest.mark.exhaustive
def test_payload___changed_while_active___leaves_the_arm_where_it_is(
    graph: Graph, tmp_path: Path
) -> None:
    recorder = graph.start("recorder", {"bag": str(tmp_path / "run")})
    recorder.wait_for("recording to")
    # A slow law: one with strain feedback is unstable when a busy machine answers a period late.
    graph.start("controller", {"law": "pd", "pd.compensation_v": 0.7, "reference": "square"})
    graph.start("daq", {"noise": "none"})
    graph.activate_loop()
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    assert graph.transition("daq", "activate")
    graph.wait(lambda: bool(states) and states[-1].position_v > 1.0, "an arm away from its start")
    assert graph.refusal("daq", {"payload_kg": 0.4}) == ""
    graph.wait(lambda: states[-1].sequence > states[0].sequence + 900, "samples with the payload")
    assert "payload_kg" in graph.refusal("daq", {"payload_kg": 2.0})
    assert graph.transition("daq", "deactivate")
    assert graph.stop(recorder) == 0

    run = States(tmp_path / "run")
    position_v = run.volts[:, 0]
    # An arm that was set back to its start would be there at once, from one sample to the next.
    assert np.all(abs(np.diff(position_v)) < 0.05 + 50.0 * np.diff(run.stamp_s))
