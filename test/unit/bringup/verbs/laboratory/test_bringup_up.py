"""Laws for one rate under the verb up."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.laboratory import up
from flexarm_ident.models.files import save_model
from support.servo_plants import two_joints

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


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


def test_controller___with_another_law___is_refused(tmp_path: Path) -> None:
    file = tmp_path / "controller.yaml"
    file.touch()
    said = CliRunner().invoke(up.up, ["--controller", str(file), "--law", "pd"])
    assert said.exit_code == 2
    assert "--controller is one of law servo, not of pd" in said.output


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a model of two joints, in the working folder."""
    monkeypatch.chdir(tmp_path)
    return saved(tmp_path / "mine" / "model.yaml", 1.0)


def saved(file: Path, limit: float) -> Path:
    """Write a model of two joints, with the largest command of its record."""
    file.parent.mkdir(parents=True, exist_ok=True)
    ends = {"input_low": [-limit] * 2, "input_high": [limit] * 2}
    save_model(file, two_joints(), name="joints", provenance=ends)
    return file


def test_twin___of_a_model_that_changed_since___is_reported(
    controller: dict[str, Any], model: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for limit, is_reported in ((1.0, False), (2.0, True)):
        saved(model, limit)
        with pytest.raises(Started):
            up.up.main(["--twin", str(model)], standalone_mode=False)
        reported = (
            "mine.yaml does not match the model any more: remove it" in capsys.readouterr().out
        )
        assert reported is is_reported
    assert controller["law"] == "pd"


@pytest.mark.usefixtures("controller")
def test_twin___of_another_model_in_a_folder_of_the_same_name___is_refused(
    tmp_path: Path, model: Path
) -> None:
    with pytest.raises(Started):
        up.up.main(["--twin", str(model)], standalone_mode=False)
    other = saved(tmp_path / "elsewhere" / "mine" / "model.yaml", 1.0)
    said = CliRunner().invoke(up.up, ["--twin", str(other)])
    assert said.exit_code == 2
    assert "describes the twin of another model" in said.output


def test_twin___beside_a_rig___is_refused(model: Path) -> None:
    said = CliRunner().invoke(up.up, ["--twin", str(model), "--rig", "mujoco-two-link"])
    assert said.exit_code == 2
    assert "--rig and --twin each name an arm" in said.output
