"""Requests to nodes that are silent."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace
from typing import Any

import pytest

from flexarm_core.errors import FlexarmError
from flexarm_live.graph import bridge as bridge_module
from flexarm_live.graph.bridge import Bridge
from flexarm_live.graph.calls import CallError, SilentNodeError
from flexarm_live.serving.laboratory import Answer

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
