"""Verb design on models and records of any plant."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np
import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.simulated.design import design
from flexarm_control import load_controller
from flexarm_core.errors import FlexarmError
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_columns import guessed_columns
from flexarm_ident.models.files import save_model
from support.servo_plants import bending_arm

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def model(tmp_path: Path) -> Path:
    file = tmp_path / "model.yaml"
    save_model(file, bending_arm(), name="arm", provenance={"source": "closed form"})
    return file


@pytest.mark.parametrize("law", ["servo", "hinf"])
def test_design___model___writes_controller_summary_report_and_c(
    model: Path, tmp_path: Path, law: str
) -> None:
    out = tmp_path / "out"
    words = [str(model), "--track", "hub", "--limit", "torque=3", "--bandwidth", "1Hz"]
    words += ["--law", law]

    done = CliRunner().invoke(design, [*words, "--fast", "-o", str(out)], catch_exceptions=False)

    assert done.exit_code == 0
    found = json.loads((out / "summary.json").read_text("utf-8"))
    assert (found["law"], found["tracked"], found["rate_hz"]) == (law, ["hub"], 500.0)
    assert found["bandwidth_hz"] == pytest.approx(1.0)
    assert 0.0 < found["disk_margin"] < 2.0
    (step,) = found["step"]
    assert step["output"] == "hub"
    assert step["overshoot"] < 0.02
    assert step["settling_s"] < 2.0
    assert abs(step["steady_error"]) < 1e-3
    assert load_controller(out / "controller.yaml").inputs == ["torque"]
    for name, word in (("report.html", "disk margin"), ("controller.h", "servo_step")):
        assert word in (out / name).read_text("utf-8")


def test_design___model_of_a_record___keeps_to_the_commands_of_the_record(tmp_path: Path) -> None:
    file = tmp_path / "model.yaml"
    ends = {"input_low": [-3.0], "input_high": [2.0]}
    ends |= {"output_low": [-0.4, -1.0], "output_high": [0.6, 1.0], "noise_sd": [1e-4, 1e-4]}
    save_model(file, bending_arm(), name="arm", provenance=ends)
    words = [str(file), "--track", "hub", "--bandwidth", "1Hz", "-o", str(tmp_path / "out")]

    done = CliRunner().invoke(design, words, catch_exceptions=False)

    assert "limit of torque: 3, the largest command in the record" in done.output
    controller = load_controller(tmp_path / "out" / "controller.yaml")
    assert max(abs(controller.step([0.0, 0.0], [100.0])[0]) for _ in range(200)) <= 3.0 + 1e-9


@pytest.mark.slow
def test_design___auto___meets_the_margin_that_was_asked_for(model: Path, tmp_path: Path) -> None:
    words = [str(model), "--track", "hub", "--limit", "torque=3", "--robustness", "0.6"]

    CliRunner().invoke(design, [*words, "-o", str(tmp_path / "out")], catch_exceptions=False)

    found = json.loads((tmp_path / "out/summary.json").read_text("utf-8"))
    assert found["disk_margin"] >= 0.6
    assert found["limited_by"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{model}", "--track", "hubb"], "nearest: hub"),
        (["{model}", "--track", "hub", "--limit", "torque"], "INPUT=VALUE"),
        (["{model}", "--track", "hub", "--law", "ilqr"], "--payload"),
        (["--track", "hub"], "needs a record or a model"),
        (["--law", "hinf"], "needs a record or a model"),
        (["none.csv", "--track", "hub"], "no such file"),
        (["{model}", "--track", "hub", "--input", "torque"], "signals of a record"),
    ],
)
def test_design___wrong_words___are_reported_in_one_line(
    model: Path, tmp_path: Path, words: list[str], said: str
) -> None:
    said_words = [word.format(model=model) for word in words]

    done = CliRunner().invoke(design, [*said_words, "-o", str(tmp_path / "out")])

    assert done.exit_code != 0
    error = done.exception
    text = str(error) if isinstance(error, FlexarmError) else done.output
    assert said in text
    assert not (tmp_path / "out").exists()


def _csv(folder: Path, header: str, rows: int = 5) -> Path:
    file = folder / "run.csv"
    table = np.column_stack([0.01 * np.arange(rows), np.zeros((rows, header.count(",")))])
    np.savetxt(file, table, delimiter=",", header=header, comments="")
    return file


def test_design___signal_that_a_record_lacks___is_refused_before_the_identification(
    tmp_path: Path,
) -> None:
    file = _csv(tmp_path, "time,torque,hub,rate", rows=500)  # none of them moves: no model

    for words, said in ((["--track", "hubb"], "hubb"), (["--track", "hub", "--limit", "t=1"], "t")):
        done = CliRunner().invoke(design, [str(file), *words, "-o", str(tmp_path / "out")])

        assert f"{said}: " in str(done.exception)
        assert "no such" in str(done.exception)


@pytest.mark.parametrize(
    ("header", "inputs", "outputs"),
    [
        ("time,torque,hub,rate", ("torque",), ("hub", "rate")),
        ("t,torque1,torque2,hub1,hub2", ("torque1", "torque2"), ("hub1", "hub2")),
        ("time_s,u,y", ("u",), ("y",)),
        ("time,angle,current_cmd [A]", ("current_cmd [A]",), ("angle",)),
    ],
)
def test_guessed_columns___usual_names___are_distinguished(
    tmp_path: Path, header: str, inputs: tuple[str, ...], outputs: tuple[str, ...]
) -> None:
    assert guessed_columns(_csv(tmp_path, header), (), ()) == (inputs, outputs)


def test_guessed_columns___one_side_said___takes_the_rest(tmp_path: Path) -> None:
    file = _csv(tmp_path, "time,a,b,c")

    assert guessed_columns(file, ("b",), ()) == (("b",), ("a", "c"))
    with pytest.raises(CsvImportError, match="--input"):
        guessed_columns(file, (), ())
