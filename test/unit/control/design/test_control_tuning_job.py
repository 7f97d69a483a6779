"""A tuning from names to parameters."""

from __future__ import annotations

from dataclasses import replace
from inspect import signature
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control import ControlError, nominal_model, tune_pdp, tune_pi
from flexarm_control.design.tuning_job import TuneRequest, load_models, tune
from flexarm_ident.models.files import save_model
from flexarm_ident.models.model_parameters import model_parameters
from flexarm_ident.models.ros_yaml import write_parameter_file
from support.project import BAGS

if TYPE_CHECKING:
    from pathlib import Path


def test_load_models___file_and_nominal___are_the_models(tmp_path: Path) -> None:
    file = tmp_path / "model.yaml"
    write_parameter_file(file, model_parameters("arm", nominal_model(0.4), provenance={}))

    models = load_models([str(file), "nominal:0.2"])

    assert list(models) == [f"{file} arm", "nominal:0.2"]
    assert np.array_equal(models[f"{file} arm"].A, nominal_model(0.4).A)


def test_load_models___flipped___has_the_other_sign_of_y3() -> None:
    model = load_models(["nominal:0.2:flipped"])["nominal:0.2:flipped"]

    assert np.array_equal(model.C[2], -nominal_model(0.2).C[2])


def test_load_models___bag___is_identified() -> None:
    bag = str(BAGS / "c_dat3_0g")

    model = load_models([bag])[bag]

    hz = np.abs(np.log(np.linalg.eigvals(model.A))) / (2 * np.pi * model.dt)
    assert np.min(np.abs(hz - 9.4)) < 0.5
    assert not model.D.any()


@pytest.mark.parametrize("suffix", ["yaml", "json", "mat"])
def test_load_models___file_of_any_format_that_can_be_read___is_its_model(
    tmp_path: Path, suffix: str
) -> None:
    file, model = tmp_path / f"model.{suffix}", nominal_model(0.2)
    save_model(file, model, name="arm", provenance={})
    ((name, found),) = load_models([str(file)]).items()
    assert name == f"{file} arm"
    np.testing.assert_array_equal(found.A, model.A)


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("nominal:x", "such as nominal:0.2"),
        ("nominal:0.1", "no nominal"),
        ("none.yaml", "none.yaml: no such file: name a file from identify, a bag, or nominal:KG"),
        ("bags/nowhere", "bags/nowhere: no such file"),
        ("nominal:0:flip", "such as"),
        (str(BAGS), "no bag"),
    ],
)
def test_load_models___bad_name___is_refused(name: str, match: str) -> None:
    with pytest.raises(ControlError, match=match):
        load_models([name])


def test_tune___pdp___meets_the_margins_and_names_every_gain() -> None:
    result = tune(load_models(["nominal:0"]), TuneRequest(gain_margin_db=12.0))

    assert result.margins[0].gain_margin_db >= 12.0 - 1e-3
    assert {"pdp.kp", "pdpc.kp", "pdpc.kd", "pdpc.ksg"} <= set(result.parameters)
    j, errors, strains = result.criteria
    assert j == pytest.approx(0.5 * errors + 0.5 * strains)


def test_tune___pi___is_tune_pi_on_one_model() -> None:
    result = tune(load_models(["nominal:0"]), TuneRequest("pi"))

    assert result.parameters["pi.kp"] == pytest.approx(
        tune_pi(nominal_model(0.0)).gains.kp, rel=1e-6
    )
    with pytest.raises(ControlError, match="one model, got 2"):
        tune(load_models(["nominal:0", "nominal:0.2"]), TuneRequest("pi"))


@pytest.mark.parametrize(
    "name", ["error_weight", "strain_weight", "gain_margin_db", "phase_margin_deg"]
)
def test_tune___pi_with_what_it_does_not_use___is_refused_even_for_the_usual_value(
    name: str,
) -> None:
    usual = signature(tune_pdp).parameters[name].default

    with pytest.raises(ControlError, match=f"^pi is tuned without {name}:"):
        tune(load_models(["nominal:0"]), replace(TuneRequest("pi"), **{name: usual}))


def test_tune___unknown_law___is_refused() -> None:
    with pytest.raises(ControlError, match="pdp or pi"):
        tune({}, TuneRequest("lqg"))
