"""Requests of a page as calls of the nodes: of silent ones, and of those of another arm."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from lifecycle_msgs.msg import State

from flexarm_core.errors import FlexarmError
from flexarm_live.graph import bridge as bridge_module
from flexarm_live.graph.bridge import Bridge
from flexarm_live.graph.node_parameters import CallError, SilentNodeError
from flexarm_live.serving.laboratory import Answer
from flexarm_live.serving.requests import parse
from support.foreign_rigs import ONE_JOINT, TWO_JOINTS

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_core.rig_description import RigDescription

LONG_S = 30.0


class Quiet:
    """Situation in which some nodes are silent."""

    def __init__(self, *nodes: str) -> None:
        self.nodes = nodes

    def silence(self, node: str, _now_s: float) -> str:
        return "no report for 9 s" if node in self.nodes else ""


@pytest.fixture(autouse=True)
def _short_patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridge_module, "_SILENT_NODE_S", 0.05)


def answered(quiet: Quiet, verb: str, work: Any, **fields: Any) -> Answer:  # noqa: ANN401
    made = SimpleNamespace(situation=quiet, **{f"_on_{verb}": work})
    made._silence = lambda request: Bridge._silence(made, request)  # type: ignore[arg-type]
    request = SimpleNamespace(verb=verb, fields=fields)
    return asyncio.run(Bridge._answered(made, request))  # type: ignore[arg-type]


async def hang(**_: Any) -> Answer:  # noqa: ANN401
    await asyncio.sleep(LONG_S)
    return Answer("late")


@pytest.mark.parametrize(
    ("verb", "fields", "node"),
    [
        ("set", {"node": "ident", "name": "a", "value": 1}, "ident"),
        ("activate", {}, "daq"),
        ("activate", {"node": "controller"}, "controller"),
        ("get", {"node": "recorder"}, "recorder"),
        ("get", {}, "recorder"),
        ("payload", {"kg": 0.1}, "daq"),
        ("record", {"on": True}, "recorder"),
        ("law", {"name": "pi"}, "controller"),
    ],
)
def test_request___to_a_silent_node___is_given_up_early(
    verb: str, fields: dict[str, Any], node: str
) -> None:
    begun_s = time.monotonic()
    with pytest.raises(FlexarmError, match=f"the {node} does not answer: no report for 9 s"):
        answered(Quiet(node), verb, hang, **fields)
    assert time.monotonic() - begun_s < 0.5 * LONG_S


def test_request___to_a_silent_node_that_answers___is_carried_out() -> None:
    async def answer(**_: Any) -> Answer:  # noqa: ANN401
        return Answer("done")

    assert answered(Quiet("daq"), "payload", answer, kg=0.1).message == "done"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (CallError("daq refused: 2 kg"), "daq refused: 2 kg"),
        (SilentNodeError("no answer"), "the daq does not answer: no report for 9 s"),
    ],
)
def test_request___that_is_refused___keeps_its_reason(error: CallError, said: str) -> None:
    async def refuse(**_: Any) -> Answer:  # noqa: ANN401
        raise error

    with pytest.raises(FlexarmError, match=said):
        answered(Quiet("daq"), "payload", refuse, kg=2.0)


@pytest.mark.parametrize("verb", ["deactivate", "stop", "release", "fault"])
def test_request___that_takes_the_drive_to_zero___is_waited_for(verb: str) -> None:
    async def slow(**_: Any) -> Answer:  # noqa: ANN401
        await asyncio.sleep(0.2)
        return Answer("at zero")

    assert answered(Quiet("daq"), verb, slow).message == "at zero"


class Controller:
    """Services of a controller that takes every set-point, and of nodes that are not active."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, float]] = []

    def client(self, *_: object) -> Any:  # noqa: ANN401 - no more than is asked of it
        return SimpleNamespace(service_is_ready=lambda: True)

    async def call(self, _: type, name: str, request: Any, *__: float, **___: float) -> Any:  # noqa: ANN401
        if name == "set_reference":
            self.asked.append((request.joint, request.reference_v))
            return SimpleNamespace(success=True, message="", reference_v=request.reference_v)
        return SimpleNamespace(current_state=State(id=State.PRIMARY_STATE_INACTIVE))


def made_bridge(rig: RigDescription, folder: Path) -> tuple[Bridge, Controller]:
    node = SimpleNamespace(create_subscription=lambda *_: None)
    bridge = Bridge(node, folder, rig, "")
    controller = Controller()
    bridge._calls = controller  # type: ignore[assignment]
    bridge.outlet = SimpleNamespace(send=lambda _: None, send_state=lambda: None)
    return bridge, controller


@pytest.fixture
def _without_clients(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridge_module, "Calls", lambda _: Controller())


@pytest.mark.usefixtures("_without_clients")
def test_set_point___of_a_joint___is_asked_of_the_controller_in_its_unit(tmp_path: Path) -> None:
    bridge, controller = made_bridge(TWO_JOINTS, tmp_path)
    request = parse('{"id": 1, "do": "reference", "value": 1.25, "joint": "elbow"}')
    answer = asyncio.run(bridge.carry_out(request))
    assert controller.asked == [("elbow", 1.25)]
    assert answer.message == "set-point 1.250 rad"


@pytest.mark.usefixtures("_without_clients")
def test_set_point___without_a_joint___is_that_of_the_first(tmp_path: Path) -> None:
    bridge, controller = made_bridge(TWO_JOINTS, tmp_path)
    answer = asyncio.run(bridge.carry_out(parse('{"do": "reference", "value": 200}')))
    assert controller.asked == [("", 200.0)]
    assert answer.message == "set-point 200.000 count"


@pytest.mark.usefixtures("_without_clients")
@pytest.mark.parametrize(
    ("rig", "outputs", "expected"),
    [
        (
            TWO_JOINTS,
            (100.0, -0.5, 0.0, 0.0, 0.0),
            [("shoulder_count", 100.0), ("elbow_rad", -0.5)],
        ),
        (TWO_JOINTS, (2000.0, -3.0, *[0.0] * 3), [("shoulder_count", 1024.0), ("elbow_rad", -1.5)]),
        # A twin begins at rest, wherever it was before.
        (ONE_JOINT, (20.0, 0.0), [("hub_deg", 0.0)]),
    ],
)
def test_release___of_another_arm___leaves_each_set_point_where_it_is(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    rig: RigDescription,
    outputs: tuple[float, ...],
    expected: list[tuple[str, float]],
) -> None:
    bridge, controller = made_bridge(rig, tmp_path)
    bridge.samples.outputs = outputs
    steps: list[str] = []

    async def note(step: str) -> None:
        steps.append(f"{step} after {len(controller.asked)}")

    monkeypatch.setattr(bridge, "_end_waveform", lambda: note("no waveform"))
    monkeypatch.setattr(bridge.loop, "deactivate", lambda _: note("drive at zero"))
    monkeypatch.setattr(bridge.loop, "restart_sampling", lambda: note("samples"))
    asyncio.run(bridge.carry_out(parse('{"do": "release"}')))
    assert controller.asked == expected
    assert steps == [
        "no waveform after 0",
        "drive at zero after 0",
        f"samples after {len(expected)}",
    ]


@pytest.mark.usefixtures("_without_clients")
@pytest.mark.parametrize(
    "request_",
    [
        '{"do": "experiment", "name": "C_dat3"}',
        '{"do": "tune", "law": "pdpc", "models": ["nominal:0"]}',
        '{"do": "payload", "kg": 0.1}',
        '{"do": "fault", "name": "none"}',
    ],
)
def test_part_of_the_thesis___asked_of_another_arm___is_refused(
    tmp_path: Path, request_: str
) -> None:
    bridge, _ = made_bridge(TWO_JOINTS, tmp_path)
    with pytest.raises(
        FlexarmError, match=r"two-joints is another|only the simulated arm|gains of two-joints"
    ):
        asyncio.run(bridge.carry_out(parse(request_)))
