"""The player on live nodes."""

from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING

import pytest
from std_msgs.msg import Float64
from std_srvs.srv import SetBool

from flexarm_core.clock import slowness
from flexarm_msgs.msg import ArmState
from flexarm_node import qos
from support.bag_samples import PLAYED_STEP_NS, START_NS, arm_state, played_bag
from support.recorded_samples import States, content

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph

pytestmark = pytest.mark.system

TOPICS = {"/flexarm/state", "/flexarm/command", "/flexarm/reference"}


@pytest.mark.exhaustive
def test_player___plays_to_a_recorder_that_pauses_and_ends_by_itself(
    graph: Graph, tmp_path: Path
) -> None:
    messages = played_bag(tmp_path / "played", 2100)
    states: list[ArmState] = []
    graph.node.create_subscription(ArmState, "state", states.append, qos.EVERY)
    recorder = graph.start("recorder", {"bag": str(tmp_path / "copy"), "max_bagfile_size": 65536})
    recorder.wait_for("recording to")

    player = graph.run_node("player", {"bag": str(tmp_path / "played")})
    graph.wait(lambda: len(states) > 50, "the play")
    # A busy machine does the like; the player must keep what the recorder has not fetched.
    recorder.send(signal.SIGSTOP)
    graph.wait(lambda: len(states) > 250, "more of the play")
    recorder.send(signal.SIGCONT)

    assert player.exit_code() == 0
    assert f"played {len(messages)} messages" in player.printed
    assert graph.stop(recorder) == 0
    assert content(tmp_path / "copy") == content(tmp_path / "played")
    # The messages are more than one file holds, however long the play has taken.
    assert len(list((tmp_path / "copy").glob("copy_*.mcap"))) >= 2


def test_player___nobody_listens_to___plays_after_the_discovery(
    graph: Graph, tmp_path: Path
) -> None:
    messages = played_bag(tmp_path / "played", 100)
    begun_s = time.monotonic()
    player = graph.run_node("player", {"bag": str(tmp_path / "played")})
    assert player.exit_code() == 0
    assert f"played {len(messages)} messages" in player.printed
    # 4 s of discovery, and a start; a reader was waited for through 7 s more.
    assert time.monotonic() - begun_s < 10.0 * slowness()


def test_player___leaves_out_and_speeds_up_as_it_is_asked(graph: Graph, tmp_path: Path) -> None:
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
        arm_state(
            k + 1, START_NS + k * PLAYED_STEP_NS, (0.01 * k, 1.0, 2.0, 3.0), command_v=0.02 * k
        ).raw
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
