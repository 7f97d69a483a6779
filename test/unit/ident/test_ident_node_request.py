"""Requests of the service and of the action: what is not set means the command's defaults."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import pytest

from flexarm_ident.workflow.request import Request

pytest.importorskip("rclpy")

from flexarm_ident.ident_node import as_request
from flexarm_msgs.action import IdentifyBags
from flexarm_msgs.srv import Identify

if TYPE_CHECKING:
    from flexarm_ident.ident_node import Asked


@pytest.mark.parametrize("kind", [Identify.Request, IdentifyBags.Goal])
def test_as_request___one_field_set___has_the_defaults_of_the_command(kind: type[Asked]) -> None:
    assert as_request(kind(bag_uris=["run"])) == Request()
    assert as_request(kind(order=18)) == Request(order=18)


@pytest.mark.parametrize("kind", [Identify.Request, IdentifyBags.Goal])
@pytest.mark.parametrize("field", ["filter_input", "remove_compensation", "stabilise", "friction"])
def test_as_request___false___is_what_was_asked_for(kind: type[Asked], field: str) -> None:
    found, usual = asdict(as_request(kind(**{field: False}))), asdict(Request())
    assert {name for name, value in found.items() if value != usual[name]} == {field}


def test_as_request___the_thesiss_method_alone___prepares_as_section_2_5_has_it() -> None:
    printed = as_request(Identify.Request(method="orse_thesis"))
    assert (printed.bias, printed.cutoff_hz, printed.filter_input) == ("first", 50.0, False)
    assert printed == Request(
        method="orse_thesis", bias="first", cutoff_hz=50.0, filter_input=False
    )
    own = Request(method="orse_thesis", bias="mean", cutoff_hz=0.0)
    for kept in (own, replace(own, order=9)):
        assert (kept.bias, kept.cutoff_hz, kept.filter_input) == ("mean", 0.0, True)
