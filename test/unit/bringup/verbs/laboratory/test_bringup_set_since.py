"""Parameters of a node that were set while it ran."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

import pytest
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter

from flexarm_bringup.verbs.laboratory.lost_nodes import SetSince

if TYPE_CHECKING:
    from collections.abc import Callable


class Client:
    """Client whose topics are heard by hand."""

    hear: Callable[[ParameterEvent], None]

    def full_name(self, name: str) -> str:
        return f"/arm2/{name}"

    def listen(self, _kind: type, topic: str, _profile: object, heard: Callable[..., None]) -> None:
        assert topic == "/parameter_events"
        self.hear = heard


def event(node: str = "/arm2/controller", *, new: bool = False, **values: Any) -> ParameterEvent:  # noqa: ANN401
    given = [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]
    return ParameterEvent(node=node, **{"new_parameters" if new else "changed_parameters": given})


@pytest.fixture
def client() -> Client:
    return Client()


def test_words___are_those_of_the_start_with_what_was_set_since(client: Client) -> None:
    since = SetSince(client, "controller")  # type: ignore[arg-type]
    client.hear(event(law="pdpc_plus", pdpc__kp=0.3))
    client.hear(event(pdpc__kp=2.0, profile=[0.0, 1.5], name="it is", word="off", flag=True))
    client.hear(event("/arm1/controller", law="pi"))
    client.hear(event(new=True, pdpc__kd=1.0))
    client.hear(event(listeners=7, trajectory="sweep.csv"))

    start = {"law": "pdpc", "reference": "topic"}

    assert shlex.split(since.words(start)) == [
        *("-p", "law:=pdpc_plus", "-p", "reference:=topic", "-p", "pdpc.kp:=2.0"),
        *("-p", "profile:=[0.0, 1.5]", "-p", "name:='it is'", "-p", "word:='off'"),
        *("-p", "flag:=true"),
    ]
    assert since.lost(start) == ["the set-point 0"]
    assert since.lost({**start, "reference": "square"}) == []


def test_models___are_reported_and_stand_in_no_line(client: Client) -> None:
    since = SetSince(client, "controller")  # type: ignore[arg-type]
    client.hear(event(lqg__effort_weight=2.0, lqg__model="own"))
    client.hear(event(new=True, models__own__A=[1.0]))

    assert since.words({}) == "-p lqg.effort_weight:=2.0"
    assert since.lost({}) == ["the set-point 0", "the models of its start"]
