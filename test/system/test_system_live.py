from __future__ import annotations

import json
import os
import signal
import socket
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from websockets.sync.client import connect

from flexarm_core.rig_description import load_rig
from flexarm_live.graph.about import columns_of
from flexarm_live.terminal_socket import connect as connect_terminal
from support.live_server import ask, frame_after
from support.system_graph import PATIENCE_S, ROOT

if TYPE_CHECKING:
    from support.system_graph import Graph

pytestmark = pytest.mark.system
COLUMN = {name: number for number, name in enumerate(columns_of(load_rig("thesis")), start=1)}


def test_up___its_page___shows_samples_and_drives_the_arm(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = tmp_path / "bag"
    process = graph.run([str(ROOT / "flexarm"), "up", "--rate", "100", "--bag", str(bag)])
    process.wait_for("#token=")
    address = next(line for line in process.printed.splitlines() if line.startswith("http"))
    url = address.replace("http", "ws", 1).replace("/#", "/live?")
    with connect(url, compression=None, ping_interval=None) as page:
        hello = json.loads(page.recv(PATIENCE_S))
        assert hello["hand"] is True
        assert hello["simulated"] is True
        kp = next(each for each in hello["nodes"]["controller"] if each["name"] == "pdpc.kp")
        assert (kp["kind"], kp["low"], kp["high"], kp["live"]) == ("double", 0.0, 5.0, True)

        first = frame_after(page, lambda _: True)
        second = frame_after(page, lambda _: True)
        numbers = np.concatenate([first, second])[:, COLUMN["sequence_low"]]
        # Nobody repeats a sample for a viewer: a machine that is busy enough loses some.
        assert (np.diff(numbers) >= 1.0).all()

        assert ask(page, do="payload", kg=0.2)["ok"] is True
        assert ask(page, do="reference", value=1.0)["ok"] is True
        arrived = frame_after(page, lambda frame: frame[-1, COLUMN["position_v"]] > 0.7)
        assert arrived[-1, COLUMN["reference_v"]] == 1.0

        assert ask(page, do="waveform", kind="sine", amplitude_v=2.0, period_s=1.0)["ok"] is True
        frame_after(page, lambda frame: frame[-1, COLUMN["reference_v"]] < -0.5)
        refused = ask(page, do="reference", value=1.0)
        assert "the controller follows its own, sine" in refused["message"]

        assert ask(page, do="stop")["ok"] is True
        frame_after(page, lambda frame: not frame[-1, COLUMN["command_v"]])
        released = ask(page, do="release")
        assert released["ok"] is True, released
        frame_after(page, lambda frame: frame[-1, COLUMN["command_v"]])

        unknown = ask(page, do="law", name="pdpq")
        assert "must be one of" in unknown["message"]

    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
    with connect_terminal("/flexarm") as terminal, closing(terminal.makefile("rw")) as lines:

        def status() -> dict[str, Any]:
            lines.write('{"id": 3, "do": "status"}\n')
            lines.flush()
            data: dict[str, Any] = json.loads(lines.readline())["data"]
            return data

        assert status()["payload_kg"] == 0.2
        # A node reports once a second, and a machine that is late leaves the loop without commands.
        graph.wait(lambda: status()["badge"] in {"READY", "DRIVING"}, "the badge of the new run")
    process.send(signal.SIGINT)
    assert process.exit_code() == 0, process.printed
    with AnyReader([bag]) as reader:
        events: list[Any] = [
            reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
            if connection.topic == "/parameter_events"
        ]
    changed = [
        (event.node, each.name, each.value.double_value)
        for event in events
        for each in event.changed_parameters
    ]
    assert ("/flexarm/daq", "payload_kg", 0.2) in changed


def test_page___while_an_experiment_runs___leaves_the_arm_to_it(
    graph: Graph, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
    monkeypatch.chdir(tmp_path)
    process = graph.run([str(ROOT / "flexarm"), "up", "--view-only", "--port", "0"])
    process.wait_for("http")
    with connect_terminal("/flexarm") as terminal, closing(terminal.makefile("rw")) as lines:

        def reported(**request: Any) -> dict[str, Any]:  # noqa: ANN401 - of JSON
            lines.write(json.dumps({"id": 3, **request}) + "\n")
            lines.flush()
            reply: dict[str, Any] = json.loads(lines.readline())
            return reply

        refused = reported(do="set", node="daq", name="payload_kg", value=200)
        assert "payload_kg = 200 is not within 0 to 1 kg" in refused["message"]
        beyond = reported(do="reference", value=6.8)["data"]["note"]
        assert "beyond the bound of 6.5 V" in beyond
        assert reported(do="reference", value=0.0)["data"]["note"] == ""
        job = reported(do="experiment", name="O_dat1")["data"]["job"]
        assert reported(do="status")["data"]["has_experiment"] is True
        for request in (
            {"do": "fault", "name": "none"},
            {"do": "activate", "node": "controller"},
            {"do": "reference", "value": 1.0},
            {"do": "record", "on": False},
        ):
            refused = reported(**request)
            assert refused["ok"] is False
            assert f"job {job}, experiment, is at work: cancel it or wait" in refused["message"]
        assert reported(do="cancel", job=job)["ok"] is True
        graph.wait(
            lambda: not reported(do="status")["data"]["has_experiment"], "the end of the job"
        )
        assert reported(do="reference", value=1.0)["ok"] is True
    process.send(signal.SIGINT)
    assert process.exit_code() == 0, process.printed


@pytest.mark.exhaustive
def test_up___with_a_port_that_is_taken___says_so(graph: Graph) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        process = graph.run([str(ROOT / "flexarm"), "up", "--port", port])
        assert process.exit_code() == 1
    assert f"cannot listen on 127.0.0.1 port {port}" in process.printed


def test_live_node___threads___that_answer_a_stop_have_the_usual_priority(
    graph: Graph, tmp_path: Path
) -> None:
    live = graph.start("live", {"folder": str(tmp_path)})
    threads = Path(f"/proc/{live.popen.pid}/task")

    def nices() -> list[int]:
        """Return the niceness of each thread: field 19 of its figures, counted from 1."""
        rests = [(each / "stat").read_text().rpartition(")")[2] for each in threads.iterdir()]
        return [int(rest.split()[16]) for rest in rests]

    usual = os.getpriority(os.PRIO_PROCESS, 0)
    graph.wait(lambda: max(nices()) > usual, "the thread of the samples")
    assert sorted(set(nices())) == [usual, usual + 10]
    assert nices().count(usual + 10) == 1
