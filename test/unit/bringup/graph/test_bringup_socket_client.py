from __future__ import annotations

import json
import math
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.graph.socket_client import NoAnswerError, socket_client
from flexarm_bringup.verbs.laboratory import remote
from flexarm_live.terminal_socket import listen

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import click

ARM = "/arm_of_a_test"
OF = f"daq --namespace {ARM[1:]}"
RELEASE = f"flexarm deactivate {OF} && flexarm activate {OF}"
PARAMS: list[dict[str, Any]] = [
    {
        "name": "pd.kp",
        "value": 1.0,
        "unit": "V/V",
        "low": 0.0,
        "high": 9.5,
        "choices": [],
        "read_only": False,
    },
    {
        "name": "law",
        "value": "pd",
        "unit": "",
        "low": None,
        "high": None,
        "choices": ["pd", "pdpc"],
        "read_only": True,
    },
]


class Up:
    """An `up` that notes what is asked of it."""

    def __init__(self, listening: socket.socket) -> None:
        self.asked: list[dict[str, Any]] = []
        self.refusal = ""
        self.reports: dict[str, Any] = {
            "daq": {"message": "active", "values": {"drive": "driving"}}
        }
        self.later: Callable[[int], dict[str, Any]] = lambda _: self.reports
        """Reports by the number of requests so far."""
        self.silent = False
        self.note = ""
        self._listening = listening
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listening.accept()
            except OSError:
                return
            with connection, connection.makefile("rb") as lines:
                for line in lines:
                    self.asked.append(json.loads(line))
                    if self.silent:
                        break
                    connection.sendall(json.dumps(self._reply(self.asked[-1])).encode() + b"\n")

    def _reply(self, request: dict[str, Any]) -> dict[str, Any]:
        data = {
            "get": {"params": PARAMS} if "node" in request else {"nodes": {"controller": PARAMS}},
            "address": {"url": "http://127.0.0.1:8117/#token=none"},
            "reference": {"value": request.get("value"), "note": self.note},
            "status": {"reports": self.later(len(self.asked))},
        }.get(request["do"], {})
        return {"id": 0, "ok": not self.refusal, "message": self.refusal or "held", "data": data}


@pytest.fixture
def up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Up]:
    monkeypatch.setattr("flexarm_core.own_files.gettempdir", lambda: str(tmp_path))
    with listen(ARM) as listening:
        yield Up(listening)


def reported(verb: click.Command, *arguments: str) -> str:
    """Return what a verb prints; raise what it raises."""
    done = CliRunner().invoke(verb, [*arguments, "--namespace", ARM], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.mark.parametrize(
    ("verb", "arguments", "asked", "printed"),
    [
        (
            remote.stop,
            [],
            {"do": "stop"},
            f"held\nThen: {RELEASE}\n",
        ),
        (remote.activate, ["daq"], {"do": "activate", "node": "daq"}, "daq is active\n"),
        (remote.deactivate, ["daq"], {"do": "deactivate", "node": "daq"}, "daq is inactive\n"),
        (remote.activate, [f"{ARM}/daq"], {"do": "activate", "node": "daq"}, "daq is active\n"),
        (
            remote.status,
            [],
            {"do": "address"},
            f"http://127.0.0.1:8117/#token=none\ndaq: active\n    {'drive':36s} driving\n",
        ),
        (
            remote.get,
            [],
            {"do": "get"},
            (
                f"controller {'pd.kp':32s} 1.0 V/V; 0 to 9.5\n"
                f"controller {'law':32s} pd; one of pd, pdpc; at start only\n"
            ),
        ),
        (
            remote.get,
            ["controller", "pd.kp"],
            {"do": "get", "node": "controller"},
            f"controller {'pd.kp':32s} 1.0 V/V; 0 to 9.5\n",
        ),
        (
            remote.set_,
            ["controller", "pd.kp=2"],
            {"do": "set", "node": "controller", "name": "pd.kp", "value": 2.0},
            "controller pd.kp: 1.0 -> 2.0\n",
        ),
    ],
)
def test_verb___with_an_up___asks_it(
    up: Up, verb: click.Command, arguments: list[str], asked: dict[str, Any], printed: str
) -> None:
    assert reported(verb, *arguments) == printed
    assert {"id": 0, **asked} in up.asked


@pytest.mark.parametrize(
    ("rig", "words", "asked", "printed"),
    [
        ("simulated", ["-1.5"], -1.5, "-1.5 V"),
        # 35 deg are 3 V (section 2.4.2).
        ("simulated", ["35deg"], 3.0, "3 V"),
        ("quanser-2dsfl", ["20"], 20.0, "20 deg"),
        ("mujoco-two-link", ["elbow", "90deg"], math.pi / 2, "elbow 1.5708 rad"),
        ("no_such.yaml", ["elbow", "0.5"], 0.5, "elbow 0.5"),
    ],
)
def test_reference___is_in_the_unit_of_the_running_rig_or_has_its_own(
    up: Up,
    monkeypatch: pytest.MonkeyPatch,
    *,
    rig: str,
    words: list[str],
    asked: float,
    printed: str,
) -> None:
    monkeypatch.setattr(f"{__name__}.PARAMS", [{"name": "rig", "value": rig}])
    assert reported(remote.reference, *words) == f"set-point {printed}\n"
    assert up.asked[-1]["value"] == pytest.approx(asked, rel=1e-6)
    assert up.asked[-1].get("joint", "") == "".join(words[:-1])


@pytest.mark.usefixtures("up")
def test_reference___that_is_no_number___is_reported_as_the_set_point_of_its_joint(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(f"{__name__}.PARAMS", [{"name": "rig", "value": "mujoco-two-link"}])
    done = CliRunner().invoke(remote.reference, ["elbow", "200", "--namespace", ARM])
    assert done.exit_code == 2
    assert "Invalid value for set-point of elbow: " in done.output


@pytest.mark.parametrize(
    ("values", "motion"),
    [
        ({"reference": "topic", "trajectory": ""}, "to its set-point"),
        ({"reference": "square", "trajectory": ""}, "along its own square"),
        ({"reference": "topic", "trajectory": "a.csv"}, "along its trajectory"),
    ],
)
@pytest.mark.usefixtures("up")
def test_activate_and_deactivate___say_where_the_arm_goes(
    monkeypatch: pytest.MonkeyPatch, values: dict[str, str], motion: str
) -> None:
    monkeypatch.setattr(
        f"{__name__}.PARAMS", [{"name": name, "value": value} for name, value in values.items()]
    )
    now = f"; while both are, the controller drives the arm {motion}\n"
    later = f"; once active again, an active controller drives the arm {motion}, at once\n"
    for node in ("daq", "controller"):
        assert reported(remote.activate, node) == f"{node} is active{now}"
        assert reported(remote.deactivate, node) == f"{node} is inactive{later}"


def test_reference___unknown_option___is_no_second_argument() -> None:
    done = CliRunner().invoke(remote.reference, ["-1", "--nonsense"])
    assert done.exit_code == 2
    assert "No such option" in done.output


@pytest.mark.parametrize("arm", [ARM, ARM.strip("/")])
def test_full_name_of_a_node___names_the_arm_too(up: Up, arm: str) -> None:
    done = CliRunner().invoke(remote.get, [f"{arm}/controller", "law"], catch_exceptions=False)
    assert done.output.startswith("controller law")
    done = CliRunner().invoke(
        remote.set_, [f"{arm}/controller", "law=pdpc"], catch_exceptions=False
    )
    assert done.output == "controller law: pd -> pdpc\n"
    assert {each["node"] for each in up.asked} == {"controller"}


def test_get___node_and_parameter_in_one_word___shows_how_to_write_it() -> None:
    with pytest.raises(LaunchError, match=r"daq.payload_kg is not a node: write daq payload_kg"):
        reported(remote.get, "daq.payload_kg")


@pytest.mark.parametrize(
    ("verb", "arguments"),
    [
        (remote.get, []),
        (remote.set_, ["law=pd"]),
        (remote.activate, []),
        (remote.deactivate, []),
    ],
)
def test_full_name_of_another_arm___with_a_namespace___is_refused(
    up: Up, verb: click.Command, arguments: list[str]
) -> None:
    with pytest.raises(LaunchError, match=f"/arm2/daq is not in {ARM}: give the full name or --n"):
        reported(verb, "/arm2/daq", *arguments)
    assert not up.asked


def test_node_without_a_lifecycle___is_refused_with_those_that_have_one(up: Up) -> None:
    with pytest.raises(LaunchError, match="dak has no lifecycle: daq, controller, experiment"):
        reported(remote.activate, "dak")
    assert not up.asked


def test_stop_of_every_arm___first_asks_each_up_of_this_domain(
    up: Up, monkeypatch: pytest.MonkeyPatch
) -> None:
    graph: list[tuple[str, ...]] = []

    def others(stopped_already: set[str]) -> Iterator[tuple[str, str]]:
        graph.append(tuple(sorted(stopped_already)))
        yield "/of/graph", "held too"

    monkeypatch.setattr("flexarm_bringup.graph.graph_client.stop_arms_of_graph", others)
    with listen("/lab/arm_2") as listening, listen("/hanging") as hanging, listen("/gone"):
        second, third = Up(listening), Up(hanging)
        third.silent = True
        done = CliRunner().invoke(remote.stop, ["--all"], catch_exceptions=False)
    assert sorted(done.output.splitlines()) == [
        f"{ARM}: held",
        "/lab/arm_2: held",
        "/of/graph: held too",
    ]
    assert done.output.splitlines()[-1] == "/of/graph: held too"
    assert graph == [(ARM, "/lab/arm_2")]
    assert [each["do"] for each in (*up.asked, *second.asked, *third.asked)] == ["stop"] * 3


def test_status___figure_that_is_not_known_yet___is_a_dash(up: Up) -> None:
    up.reports = {"daq": {"message": "active", "values": {"reply p50 ms": "nan"}}}
    assert reported(remote.status).endswith(f"    {'reply p50 ms':36s} -\n")


def test_status___directly_after_the_start___waits_for_the_first_reports(up: Up) -> None:
    reports, up.reports = up.reports, {}
    up.later = lambda asked: reports if asked >= 3 else {}
    assert "\ndaq: active\n" in reported(remote.status)
    assert [each["do"] for each in up.asked] == ["status"] * 3 + ["address"]


def test_status___before_the_first_reports___names_the_page(
    up: Up, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexarm_bringup.graph.socket_client._FIRST_REPORTS_S", 0.2)
    up.reports = {}
    assert reported(remote.status) == (
        "http://127.0.0.1:8117/#token=none\nno node has reported yet: each does once a second\n"
    )


def test_reference___controller_that_is_not_active___says_it(up: Up) -> None:
    up.note = "the controller is not active, activate controller"
    assert reported(remote.reference, "1") == f"set-point 1: {up.note}\n"


def test_verb___that_is_refused___says_why(up: Up) -> None:
    up.refusal = "reference 1 V refused: the controller follows its own, step"
    with pytest.raises(LaunchError, match=r"reference 1 V refused: the controller follows its own"):
        reported(remote.reference, "1")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["controller", "pd.kq=2"], r"controller has no parameter pd.kq \(nearest: pd.kp\)"),
        (["contoller", "pd.kp=2"], r"no node contoller \(nearest: controller\)"),
    ],
)
def test_set___misspelt_name___is_reported_with_the_nearest(
    up: Up, arguments: list[str], complaint: str
) -> None:
    with pytest.raises(LaunchError, match=complaint):
        reported(remote.set_, *arguments)
    assert not [each for each in up.asked if each["do"] == "set"]


def test_reference___up_that_does_not_answer___is_reported_beside_the_answer_of_the_graph(
    up: Up, monkeypatch: pytest.MonkeyPatch
) -> None:
    def graph(_namespace: str, _do: object) -> None:
        raise LaunchError("no controller was found")

    monkeypatch.setattr("flexarm_bringup.graph.socket_client._through_graph", graph)
    up.silent = True
    with pytest.raises(LaunchError) as refusal:
        reported(remote.reference, "1")
    said = str(refusal.value)
    assert said.startswith("no answer to get")
    assert "`flexarm up` runs here" in said
    assert "may still be done" in said
    assert "no controller was found" in said
    with pytest.raises(LaunchError, match="press the button at the rig"):
        reported(remote.stop)


@pytest.mark.parametrize(("refusal", "silent"), [("daq does not answer", False), ("", True)])
def test_stop___that_up_does_not_carry_out___is_left_to_the_graph(
    up: Up, refusal: str, *, silent: bool
) -> None:
    up.refusal, up.silent = refusal, silent
    with socket_client(ARM) as arm, pytest.raises(NoAnswerError):
        arm.stop()


@pytest.mark.parametrize("value", ["inf", "-inf"])
def test_set___number_that_json_cannot_hold___is_left_to_the_graph(up: Up, value: str) -> None:
    with socket_client(ARM) as arm, pytest.raises(NoAnswerError, match="no such number"):
        arm.set("controller", {"pd.kp": value})
    assert not [each for each in up.asked if each["do"] == "set"]


def test_arm___without_an_up___is_left_to_the_graph(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexarm_core.own_files.gettempdir", lambda: str(tmp_path))
    words = f"no page of a `flexarm up` of {ARM} answers here"
    with pytest.raises(NoAnswerError, match=words), socket_client(ARM):
        pytest.fail("there is none")


def test_verbs___with_an_up___load_neither_ros_nor_mathematics() -> None:
    program = (
        "import sys, flexarm_bringup.verbs.laboratory.remote;"
        "print({'numpy', 'rclpy', 'rich', 'scipy'} & set(sys.modules))"
    )
    done = subprocess.run(  # noqa: S603 - ours
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    assert done.stdout == "set()\n"
