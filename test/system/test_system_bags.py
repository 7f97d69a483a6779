from __future__ import annotations

import signal
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from flexarm_bags.check import check_bag
from flexarm_bags.repair import repair_bag
from flexarm_msgs.msg import ArmState, MotorCommand
from flexarm_node import qos
from support.bag_samples import START_NS, Sent, arm_state, motor_command, reference, write_bag
from support.system_graph import States, fill_disk

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph, Process

pytestmark = pytest.mark.system

STEP_NS = 2_000_000
TOPICS = {"/flexarm/state", "/flexarm/command", "/flexarm/reference"}


def played_bag(path: Path, samples: int) -> list[Sent]:
    """Write a bag at 500 Hz and return its messages."""
    messages = [reference(START_NS, 3.0)]
    for k in range(samples):
        time_ns = START_NS + k * STEP_NS
        messages += [
            arm_state(k + 1, time_ns, (0.01 * k, 1.0, 2.0, 3.0), command_v=0.02 * k),
            motor_command(k + 1, time_ns + 500_000, 0.02 * (k + 1)),
        ]
    write_bag(path, messages)
    return messages


def content(bag: Path) -> dict[str, list[bytes]]:
    """Return the serialised messages of a bag by topic."""
    found: dict[str, list[bytes]] = {}
    with AnyReader([bag]) as reader:
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(bytes(raw))
    return found


def message_count(bag: Path) -> int:
    """Return what the metadata says."""
    text = yaml.safe_load((bag / "metadata.yaml").read_text())
    return int(text["rosbag2_bagfile_information"]["message_count"])


def decoded_by_embedded_definitions(file: Path) -> dict[str, list[Any]]:
    """Decode an MCAP file with nothing but what is in it."""
    found: dict[str, list[Any]] = {}
    with file.open("rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            typestore = get_typestore(Stores.EMPTY)
            typestore.register(get_types_from_msg(schema.data.decode(), schema.name))
            found.setdefault(channel.topic, []).append(
                typestore.deserialize_cdr(message.data, schema.name)
            )
    return found


def test_recorded_bag___is_read_by_rosbags_and_by_its_own_definitions(
    graph: Graph, tmp_path: Path
) -> None:
    bag = tmp_path / "run"
    graph.start("recorder")
    graph.start("controller", {"law": "pdpc", "reference": "step"})
    graph.start("daq", {"real_time_factor": 0.0, "answer_timeout_s": 0.05})
    graph.configure_loop()
    # A run that the controller hears and does not answer: the bag shall have nothing of it.
    graph.operator.sample(5, lambda _: None)
    graph.operator.set_parameters("daq", {"answer_timeout_s": 10.0})
    graph.operator.recorded_run("controller", str(bag), 300, lambda _: None)

    with AnyReader([bag]) as reader:
        deserialised: dict[str, list[Any]] = {}
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            deserialised.setdefault(connection.topic, []).append(message)
        assert reader.message_count == message_count(bag)

    (file,) = bag.glob("*.mcap")
    states = deserialised["/flexarm/state"]
    assert set(deserialised) == TOPICS | {"/flexarm/commander"}
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
            "flexarm",
            theirs.header.stamp.nanosec,
        )
        assert (mine.position_v, mine.speed_v, mine.command_v) == (
            theirs.position_v,
            theirs.speed_v,
            theirs.command_v,
        )


def test_player___plays_to_another_recorder_and_ends_by_itself(
    graph: Graph, tmp_path: Path
) -> None:
    messages = played_bag(tmp_path / "played", 500)
    recorder = graph.start("recorder", {"bag": str(tmp_path / "copy")})
    recorder.wait_for("recording to")

    player = graph.run_node("player", {"bag": str(tmp_path / "played")})

    assert player.exit_code() == 0
    assert f"played {len(messages)} messages" in player.printed
    assert graph.stop(recorder) == 0
    assert content(tmp_path / "copy") == content(tmp_path / "played")


def test_player___leaves_out_and_speeds_up_as_it_is_told(graph: Graph, tmp_path: Path) -> None:
    played_bag(tmp_path / "played", 1000)
    recorder = graph.start("recorder", {"bag": str(tmp_path / "copy"), "topics": ["state"]})
    recorder.wait_for("recording to")

    player = graph.run_node(
        "player",
        {"bag": str(tmp_path / "played"), "start_s": 0.5, "duration_s": 0.6, "rate": 2.0},
    )

    assert player.exit_code() == 0
    assert graph.stop(recorder) == 0
    assert content(tmp_path / "copy")["/flexarm/state"] == [
        arm_state(k + 1, START_NS + k * STEP_NS, (0.01 * k, 1.0, 2.0, 3.0), command_v=0.02 * k).raw
        for k in range(250, 550)
    ]


def test_player___with_a_damaged_bag___ends_with_one_line(graph: Graph, tmp_path: Path) -> None:
    played_bag(tmp_path / "played", 100)
    (file,) = (tmp_path / "played").glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-100])

    player = graph.run_node("player", {"bag": str(tmp_path / "played")})

    assert player.exit_code() == 2
    (line,) = player.printed.splitlines()
    assert "cannot read" in line
    assert "flexarm bag repair" in line


@pytest.mark.parametrize(
    "signals",
    [(signal.SIGINT,), (signal.SIGTERM,), (signal.SIGINT, signal.SIGINT)],
    ids=["ctrl_c", "terminate", "ctrl_c_twice"],
)
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
    graph.wait(lambda: len(commands) > before + 300, "commands after the error")

    assert "cannot write: File too large" in recorder.printed
    recorder.send(signal.SIGINT)
    assert recorder.exit_code() == 1
    assert "Traceback" not in recorder.printed
    summary = repair_bag(tmp_path / "run", tmp_path / "repaired")
    assert check_bag(summary.bag).messages == summary.messages > 300


def test_player___standing_in_for_the_daq_node___is_answered_and_recorded(
    graph: Graph, tmp_path: Path
) -> None:
    played_bag(tmp_path / "played", 400)
    recorder = graph.start("recorder", {"bag": str(tmp_path / "copy")})
    recorder.wait_for("recording to")
    graph.start("controller", {"autostart": True, "reference": "step"})
    graph.wait(lambda: graph.operator.is_active("controller"), "the controller")

    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    player = graph.start(
        "player",
        {"bag": str(tmp_path / "played"), "stand_in": True, "loop": True, "listeners": 3},
    )
    graph.wait(lambda: bool(states) and states[-1].sequence > 1000, "the third time around")
    assert graph.stop(player) == 0
    assert graph.stop(recorder) == 0

    sampled = States(tmp_path / "copy")
    assert sampled.sequence.tolist() == list(range(1, len(sampled.sequence) + 1))
    # The recorded values, again and again.
    assert sampled.volts[400:800, 0] == pytest.approx(sampled.volts[:400, 0])
    assert (sampled.stamp_s[1:] > sampled.stamp_s[:-1]).all()
    counts = {topic: len(raws) for topic, raws in content(tmp_path / "copy").items()}
    assert counts["/flexarm/command"] > 100
    # The controller's own references, none of the bag's.
    assert counts["/flexarm/reference"] >= 1


def test_player___stopped_and_started___goes_on_where_it_was(graph: Graph, tmp_path: Path) -> None:
    played_bag(tmp_path / "played", 2500)
    states: list[int] = []
    graph.node.create_subscription(
        ArmState, "state", lambda state: states.append(state.sequence), qos.EVERY
    )
    player = graph.run_node("player", {"bag": str(tmp_path / "played"), "stopped": True})

    def play(*, data: bool) -> str:
        response = graph.call(SetBool, "player/play", SetBool.Request(data=data))
        assert response.success
        return str(response.message)

    graph.wait(lambda: graph.node.count_publishers("/flexarm/state") == 1, "the player")
    assert play(data=False) == "stopped at 0.000 s"
    assert play(data=True).startswith("playing at")
    graph.wait(lambda: len(states) > 100, "a part of the bag")
    place = play(data=False)
    assert play(data=False) == place
    assert play(data=True).startswith(place.replace("stopped", "playing")[:12])
    assert player.exit_code() == 0
    graph.wait(lambda: len(states) == 2500, "the rest of the bag")
    assert states == list(range(1, 2501))


def test_player___in_a_live_graph___ends_with_one_line_and_plays_nothing(
    graph: Graph, tmp_path: Path
) -> None:
    played_bag(tmp_path / "played", 100)
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    graph.node.create_subscription(MotorCommand, "command", lambda _: None, qos.EVERY)
    graph.start("daq", {"autostart": True, "rate_hz": 100.0})
    graph.wait(lambda: bool(states), "a sample")

    # The second listener of the commands is the DAQ node: discovery may take its time.
    player = graph.run_node("player", {"bag": str(tmp_path / "played"), "listeners": 2})

    assert player.exit_code() == 1
    refusal = "/flexarm/state is published by /flexarm/daq: stop it, then play"
    assert [line for line in player.printed.splitlines() if "ERROR" in line] == [
        line for line in player.printed.splitlines() if line.endswith(refusal)
    ]
    assert refusal in player.printed
    assert "played" not in player.printed.replace(str(tmp_path), "")
    # Those of the bag have the time at which it was written.
    assert {state.header.stamp.sec for state in states}.isdisjoint({START_NS // 10**9})


def test_player___to_be_started_beside_a_publisher___refuses_until_it_is_gone(
    graph: Graph, tmp_path: Path
) -> None:
    messages = played_bag(tmp_path / "played", 100)
    heard: list[float] = []
    graph.node.create_subscription(
        Float64, "reference", lambda reference: heard.append(reference.data), qos.EVERY
    )
    rival = graph.node.create_publisher(Float64, "reference", qos.SENT)
    player = graph.run_node("player", {"bag": str(tmp_path / "played"), "stopped": True})
    graph.wait(lambda: graph.node.count_publishers("reference") == 2, "the player")

    def play() -> SetBool.Response:
        return graph.call(SetBool, "player/play", SetBool.Request(data=True))

    refused = play()
    assert not refused.success
    assert refused.message == (
        "/flexarm/reference is published by /flexarm/tester: stop it, then play"
    )

    graph.node.destroy_publisher(rival)
    graph.wait(lambda: play().success, "the start")
    assert player.exit_code() == 0
    assert f"played {len(messages)} messages" in player.printed
    graph.wait(lambda: heard == [3.0], "the set-point of the bag")


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
