"""The tuning as a service and as a verb; the controller takes what they give."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from rclpy.parameter import Parameter

from flexarm_control.models.nominal_models import identified_model
from flexarm_ident.models.files import save_model
from flexarm_msgs.srv import Tune
from support.system_graph import ROOT, Graph

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = pytest.mark.system

NOMINAL = ["nominal:0", "nominal:0.2", "nominal:0.4"]


@pytest.fixture(scope="module")
def tuner(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return one graph with a tuner for all questions."""
    with Graph(tmp_path_factory.mktemp("tuner")) as graph:
        graph.start("tuner")
        yield graph


def test_service___gives_gains_that_keep_the_margins_and_that_the_controller_takes(
    tuner: Graph,
) -> None:
    tuner.start("controller")

    response: Tune.Response = tuner.call(Tune, "tune", Tune.Request(models=NOMINAL))

    assert response.success, response.message
    assert min(response.gain_margins_db) >= 9.99
    assert min(response.phase_margins_deg) >= 54.9
    assert len(response.gain_margins_db) == len(response.phase_margins_deg) == len(NOMINAL)
    gains = {each.name: Parameter.from_parameter_msg(each).value for each in response.parameters}
    assert {"pdpc.kp", "pdpc.kd", "pdpc.ksg"} <= set(gains)
    assert tuner.refusal("controller", gains) == ""


def test_service___refuses_a_model_that_is_not_there(tuner: Graph) -> None:
    response = tuner.call(Tune, "tune", Tune.Request(models=["nominal:0.3"]))

    assert not response.success
    assert "0.3" in response.message
    assert "\n" not in response.message


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"law": "pi", "gain_margin_db": 10.0}, "pi is tuned without gain_margin_db"),
        ({"delay_s": 5.0}, "delay_s = 5 s; must be 0 to 0.05 s"),
    ],
)
def test_service___refuses_a_value_that_has_no_sense(
    tuner: Graph, fields: dict[str, Any], complaint: str
) -> None:
    response = tuner.call(Tune, "tune", Tune.Request(models=NOMINAL[:1], **fields))

    assert not response.success
    assert response.message.startswith(complaint)


@pytest.mark.exhaustive
def test_verb___writes_a_parameter_file_for_the_controller(graph: Graph, tmp_path: Path) -> None:
    gains = tmp_path / "gains.yaml"

    verb = graph.run([str(ROOT / "flexarm"), "tune", *NOMINAL, "-o", str(gains)])

    assert verb.exit_code() == 0, verb.printed
    controller = graph.start("controller", {"law": "pdpc"}, "--params-file", str(gains))
    assert graph.state_of("controller") == "unconfigured"
    assert graph.transition("controller", "configure")
    assert "unknown" not in controller.printed


@pytest.mark.exhaustive
def test_service___gives_a_regulator_with_its_model_that_a_running_controller_takes(
    graph: Graph, tmp_path: Path
) -> None:
    file = tmp_path / "model.yaml"
    save_model(file, identified_model(), name="C_dat11", provenance={})
    for name in ("tuner", "controller"):
        graph.start(name)

    response = graph.call(Tune, "tune", Tune.Request(law="ilqr", models=[str(file)]))

    assert response.success, response.message
    assert min(response.gain_margins_db) >= 10.0
    given = {each.name: Parameter.from_parameter_msg(each).value for each in response.parameters}
    assert given["ilqr.model"] == "C_dat11"
    assert graph.refusal("controller", given | {"law": "ilqr"}) == ""
