"""Identified models in the controller: at the start, live, and those that do not fit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_control.models.nominal_models import identified_model
from flexarm_ident.models.files import save_model
from flexarm_ident.models.model_parameters import model_parameters
from flexarm_ident.models.state_space import state_space
from support.system_graph import Graph

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import control

pytestmark = pytest.mark.system


def as_parameters(name: str, model: control.StateSpace) -> dict[str, Any]:
    """Model as the service identify returns it."""
    return dict(model_parameters(name, model, provenance={}))


def foreign_model() -> control.StateSpace:
    """Model of another rig with two outputs."""
    return state_space(
        np.diag([0.9, 0.8]), np.ones((2, 1)), np.eye(2), 0.0, 0.01, outputs=["angle", "current"]
    )


def test_start___with_a_file_of_identify___takes_its_model(graph: Graph, tmp_path: Path) -> None:
    file = tmp_path / "model.yaml"
    save_model(file, identified_model(), name="arm", provenance={})

    chosen = {"law": "ilqr", "ilqr.model": "arm"}
    graph.start("controller", chosen, "--params-file", str(file))

    assert graph.transition("controller", "configure")
    assert graph.refusal("controller", {"law": "lqg", "lqg.model": str(file)}) == ""


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """Return a controller for all questions."""
    with Graph(tmp_path_factory.mktemp("running")) as graph:
        graph.start("controller")
        yield graph


def test_running_controller___takes_a_model_and_refuses_one_that_does_not_fit(
    running: Graph,
) -> None:
    good = as_parameters("arm", identified_model())
    assert running.refusal("controller", good | {"law": "ilqr", "ilqr.model": "arm"}) == ""

    foreign = as_parameters("foreign", foreign_model())
    # As a parameter it harms nobody; no law may be made of it.
    assert running.refusal("controller", foreign) == ""
    assert "inputs: 1, outputs: 2" in running.refusal("controller", {"ilqr.model": "foreign"})
    assert "inputs: 1, outputs: 2" in running.refusal(
        "controller", {"law": "lqg", "lqg.model": "foreign"}
    )

    changed = {"models.arm.b": [0.1] * identified_model().nstates}
    assert "hash" in running.refusal("controller", changed)
    nowhere = running.refusal("controller", {"ilqr.model": "nowhere"})
    assert "no model 'nowhere'" in nowhere
    assert "arm, foreign" in nowhere
    assert running.refusal("controller", {"ilqr.model": ""}) == ""


def test_running_controller___refuses_a_name_that_it_does_not_have(running: Graph) -> None:
    reason = running.refusal("controller", {"pdp.kpp": 1.0})

    assert reason == "no parameter pdp.kpp (nearest: pdp.kp)"
