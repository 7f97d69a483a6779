"""Laws for one rate under the verb up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.laboratory import up

if TYPE_CHECKING:
    from collections.abc import Mapping


class Started(Exception):  # noqa: N818 - no error
    """The graph would be started now."""


@pytest.fixture
def controller(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the parameters that a started controller is given."""
    given: dict[str, Any] = {}

    def start(parameters: Mapping[str, Mapping[str, Any]], *_: object, **__: object) -> None:
        given.update(parameters["controller"])
        raise Started

    monkeypatch.setattr(up, "running_graph", start)
    return given


def test_law_that_is_designed_for_a_rate___has_that_of_the_samples(
    controller: dict[str, Any],
) -> None:
    with pytest.raises(Started):
        CliRunner().invoke(up.up, ["--law", "planned", "--rate", "1000"], catch_exceptions=False)
    assert controller["planned.rate_hz"] == pytest.approx(1000.0)


def test_laws_that_may_be_set_later___are_made_for_the_rate_as_well(
    controller: dict[str, Any],
) -> None:
    with pytest.raises(Started):
        CliRunner().invoke(up.up, ["--law", "pdpc", "--rate", "1000"], catch_exceptions=False)
    rates = {name: value for name, value in controller.items() if name.endswith("rate_hz")}
    assert {"pi.rate_hz", "pdpc_plus.rate_hz", "planned.rate_hz", "shaper_rate_hz"} <= {*rates}
    assert list(rates.values()) == pytest.approx([1000.0] * len(rates))


@pytest.mark.parametrize("arguments", [["--law", "pdpc"], ["--law", "pdpc", "--rate", "20"]])
def test_rates___as_usual_or_out_of_the_laws_bounds___stay(
    controller: dict[str, Any], arguments: list[str]
) -> None:
    with pytest.raises(Started):
        CliRunner().invoke(up.up, arguments, catch_exceptions=False)
    assert not [name for name in controller if name.endswith("rate_hz")]


@pytest.mark.parametrize("arguments", [["--law", "pdpc"], ["--law", "ilqr", "--rate", "310"]])
def test_law_that_suits_the_rate___starts(controller: dict[str, Any], arguments: list[str]) -> None:
    with pytest.raises(Started):
        CliRunner().invoke(up.up, arguments, catch_exceptions=False)
    assert (controller["law"], controller["reference"]) == (arguments[1], "topic")


def test_law_that_is_made_for_another_rate___is_refused_before_the_start(
    controller: dict[str, Any],
) -> None:
    with pytest.raises(LaunchError, match="law ilqr is made for 300 Hz and --rate is 1000 Hz: "):
        CliRunner().invoke(up.up, ["--law", "ilqr", "--rate", "1000"], catch_exceptions=False)
    assert controller == {}
