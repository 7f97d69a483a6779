"""A tuning from names to parameters."""

from __future__ import annotations

import re
from dataclasses import replace
from inspect import signature
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_control import ControlError, build_law, nominal_model, tune_pdp, tune_pi
from flexarm_control.design import model_sources, tuning_job
from flexarm_control.design.model_sources import friction_levels_v, load_models
from flexarm_control.design.tuning import PdpTuning, Search
from flexarm_control.design.tuning_job import TuneRequest, tune
from flexarm_control.laws.gains import PdpGains, PiGains, Sampling
from flexarm_control.laws.pdpc import Pi
from flexarm_control.laws.registry import LAWS
from flexarm_control.models.nominal_models import chosen_model, identified_model
from flexarm_control.simulation import simulate_loop
from flexarm_ident.models.files import save_model
from flexarm_ident.models.model_parameters import model_parameters, write_parameter_file
from flexarm_ident.models.state_space import with_matrices
from support.exhaustive import first_of
from support.project import BAGS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import control


def test_load_models___file_and_nominal___are_the_models(tmp_path: Path) -> None:
    file = tmp_path / "model.yaml"
    write_parameter_file(file, model_parameters("arm", nominal_model(0.4), provenance={}))

    models = load_models([str(file), "nominal:0.2"])

    assert list(models) == [f"{file} arm", "nominal:0.2"]
    assert np.array_equal(models[f"{file} arm"].A, nominal_model(0.4).A)


def test_load_models___bag_of_other_signals___is_refused_before_its_identification(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(model_sources, "run", lambda *_: pytest.fail("identified"))
    bag = BAGS / "quanser_2dsfl"
    with pytest.raises(ControlError, match=r"quanser_2dsfl's inputs: 2, outputs: 4; every law"):
        load_models([str(bag)])


def test_load_models___flipped___has_the_other_sign_of_y3() -> None:
    model = load_models(["nominal:0.2:flipped"])["nominal:0.2:flipped"]

    assert np.array_equal(model.C[2], -nominal_model(0.2).C[2])


@pytest.mark.slow
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
    result = tune(load_models(["nominal:0"]), TuneRequest(gain_margin_db=14.0))

    assert result.margins[0].gain_margin_db >= 14.0 - 1e-3
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


def test_tune___duration___is_the_length_of_the_criterion() -> None:
    model = nominal_model(0.0)
    short = tune(load_models(["nominal:0"]), TuneRequest("pi", duration_s=2.0))
    kp, ki = (short.parameters[f"pi.{name}"] for name in ("kp", "ki"))
    assert isinstance(kp, float)
    assert isinstance(ki, float)
    law = Pi(PiGains(kp, ki), Sampling(1.0 / model.dt))
    step = simulate_loop(model, law, np.ones(600))
    since_s = np.arange(600) * model.dt
    expected = float(np.sum(since_s * np.abs(1.0 - step.y[:, 0])) * model.dt)
    assert short.criteria[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("law", ["pdp", "pi"])
@pytest.mark.parametrize("duration_s", [0.0, 61.0, float("nan")])
def test_tune___duration_out_of_range___is_refused(law: str, duration_s: float) -> None:
    with pytest.raises(ControlError, match=r"^duration_s = .*at most 60 s"):
        tune(load_models(["nominal:0"]), TuneRequest(law, duration_s=duration_s))


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
    with pytest.raises(ControlError, match="pdpc_scheduled, ilqr or lqg"):
        tune({}, TuneRequest("pd"))


@pytest.mark.parametrize("law", first_of(["ilqr", "lqg"]))
@pytest.mark.slow
def test_tune___regulator___gives_model_and_weights_that_the_law_is_built_of(
    law: str, tmp_path: Path
) -> None:
    file = tmp_path / "300g.yaml"
    save_model(file, identified_model(), name="C_dat11", provenance={})

    result = tune(load_models([str(file)]), TuneRequest(law, delay_s=0.001))

    parameters = dict(result.parameters)
    assert parameters[f"{law}.model"] == "C_dat11"
    model = chosen_model("C_dat11", parameters)
    assert model is not None
    np.testing.assert_array_equal(model.A, identified_model().A)
    values = {
        name.removeprefix(f"{law}."): value
        for name, value in parameters.items()
        if name.startswith(f"{law}.") and isinstance(value, float)
    }
    build_law(law, values, model).step((0.0,) * 4, 1.0)
    assert result.margins[0].gain_margin_db >= 10.0
    assert result.margins[0].phase_margin_deg >= 55.0


@pytest.mark.slow
@pytest.mark.exhaustive
def test_tune___schedule___has_a_row_for_each_payload_and_gains_for_all() -> None:
    names = ["nominal:0.4", "nominal:0", "0.15=nominal:0.2"]

    result = tune(load_models(names), TuneRequest("pdpc_scheduled"))

    values = {name.partition(".")[2]: value for name, value in result.parameters.items()}
    assert [values[f"{row}_kg"] for row in ("light", "medium", "heavy")] == [0.0, 0.15, 0.4]
    for row, kg in (("light", 0.0), ("medium", 0.2), ("heavy", 0.4)):
        alone = tune_pdp([nominal_model(kg)]).gains
        assert values[f"{row}_kd"] == pytest.approx(alone.kd, abs=0.05)
    build_law("pdpc_scheduled", values)  # type: ignore[arg-type]


def test_tune___schedule_whose_search_ends_at_a_bound___says_so_for_that_payload(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    light = nominal_model(0.0)

    def tuned(models: Sequence[control.StateSpace], **_: object) -> PdpTuning:
        is_light = len(models) == 1 and np.array_equal(models[0].A, light.A)
        active = ("phase margin of model 1", *(["bound of kp"] if is_light else []))
        searches = (Search(PdpGains(), PdpGains(), 1.0, feasible=True),) * 2
        return PdpTuning(PdpGains(), 1.0, (1.0,), (1.0,), (), active, searches, 0.0)

    monkeypatch.setattr(tuning_job, "tune_pdp", tuned)
    names = ["nominal:0", "nominal:0.2", "nominal:0.4"]
    notes = tune(load_models(names), TuneRequest("pdpc_scheduled")).notes

    assert [note.partition(" alone: ")[0] for note in notes if "active: bound of kp;" in note] == [
        "0 kg"
    ]
    assert sum("phase margin" in note for note in notes) == 1


@pytest.mark.parametrize(
    ("names", "complaint"),
    [
        (["nominal:0", "nominal:0.2"], "at three payloads, light, medium, heavy; got 2 models"),
        (["nominal:0", "0=nominal:0.2", "nominal:0.4"], "must increase"),
    ],
)
def test_tune___schedule_of_other_payloads___is_refused(names: list[str], complaint: str) -> None:
    with pytest.raises(ControlError, match=complaint):
        tune(load_models(names), TuneRequest("pdpc_scheduled"))


def test_tune___schedule_of_a_file_without_its_payload___is_refused(tmp_path: Path) -> None:
    file = tmp_path / "model.yaml"
    save_model(file, nominal_model(0.2), name="arm", provenance={})
    names = ["nominal:0", str(file), "nominal:0.4"]

    with pytest.raises(ControlError, match=r"write its payload in kg before it, such as 0\.15="):
        tune(load_models(names), TuneRequest("pdpc_scheduled"))


@pytest.mark.slow
def test_tune___whatever_the_law___explains_its_figures() -> None:
    models = load_models(["nominal:0"])
    for law in ("pdp", "pi", "lqg"):
        said = " ".join(tune(models, TuneRequest(law)).explanation)
        assert "J: " in said
        assert re.search("searched|tried", said)


@pytest.mark.parametrize(
    ("law", "reported"), first_of([("pdp", "pdpc"), ("ilqr", "ilqr"), ("lqg", "lqg")])
)
@pytest.mark.slow
def test_tune___models_from_elsewhere___says_which_friction_the_law_makes_up_for(
    law: str, reported: str
) -> None:
    result = tune({"out/arm.yaml arm": identified_model()}, TuneRequest(law))
    usual = {spec.name: spec.default for spec in LAWS[reported].parameters}
    level_v = result.parameters.get(f"{reported}.compensation_v", usual["compensation_v"])
    assert result.notes[-1].startswith(
        f"{reported}.compensation_v is {level_v} V, the friction of "
    )
    assert "set it to the level that identify finds, or to 0" in result.notes[-1]


def rubbing(folder: Path, level_v: float, input_name: str = "command_v") -> str:
    """Return a file of a model with dry friction."""
    model = identified_model()
    model.input_labels = [input_name]
    levels = {f"friction_{each}": [0.1] for each in ("offset", "level_std", "offset_std")}
    friction = {"friction_level": [level_v], **levels, "friction_speed": [0.0] * model.nstates}
    file = folder / f"{level_v}.yaml"
    save_model(file, model, name="arm", provenance=friction)
    return str(file)


@pytest.mark.parametrize(
    ("law", "laws"),
    first_of([("pdp", ["pdpc", "pdpc_plus"]), ("ilqr", ["ilqr"]), ("lqg", ["lqg"])]),
)
@pytest.mark.slow
def test_tune___models_with_their_friction___makes_up_for_the_least_of_it(
    tmp_path: Path, law: str, laws: list[str]
) -> None:
    names = [rubbing(tmp_path, 0.61234), rubbing(tmp_path, 0.75)]
    result = tune(load_models(names[:1]), TuneRequest(law), friction_levels_v(names))
    assert {result.parameters[f"{each}.compensation_v"] for each in laws} == {0.612}
    assert result.notes[-1] == (
        f"{laws[0]}.compensation_v is 0.612 V, the friction that identify found in {names[0]} arm"
    )
    # The law takes them.
    prefix = f"{laws[0]}."
    own = {k.removeprefix(prefix): v for k, v in result.parameters.items() if k.startswith(prefix)}
    assert own.keys() <= {spec.name for spec in LAWS[laws[0]].parameters} | {"model"}


def test_friction_of_models___is_that_of_files_with_the_drive_as_input(tmp_path: Path) -> None:
    torque = rubbing(tmp_path, 0.3, "torque_nm")
    plain = tmp_path / "plain.yaml"
    save_model(plain, identified_model(), name="arm", provenance={})
    assert friction_levels_v(["nominal:0", torque, str(plain)]) == {}
    assert friction_levels_v([f"0.2={rubbing(tmp_path, 0.5)}"]) == {
        f"0.2={tmp_path / '0.5.yaml'} arm": 0.5
    }


@pytest.mark.slow
def test_tune___friction_beyond_what_a_law_makes_up_for___is_left_to_the_user() -> None:
    model = {"arm.yaml arm": identified_model()}
    result = tune(model, TuneRequest("ilqr"), {"arm.yaml arm": 2.5})
    assert result.parameters["ilqr.compensation_v"] == 0.7
    assert "set it to the level that identify finds" in result.notes[-1]


@pytest.mark.parametrize("law", first_of(["pdp", "ilqr", "pi"]))
@pytest.mark.slow
def test_tune___models_of_the_thesis_or_law_without_compensation___says_nothing_of_friction(
    law: str,
) -> None:
    name = "out/arm.yaml arm" if law == "pi" else "nominal:0"
    result = tune({name: nominal_model(0.0)}, TuneRequest(law))
    assert not any("compensation_v" in note for note in result.notes)


def without(*outputs: int) -> control.StateSpace:
    """Return the model of a rig that lacks some channels: these are constant."""
    model = identified_model()
    C = np.array(model.C)
    C[list(outputs)] *= 1e-17
    C[max(outputs)] = 0.0
    return with_matrices(model, A=model.A, B=model.B, C=C, D=model.D)


@pytest.mark.parametrize("law", first_of(["pdp", "lqg", "pi"]))
@pytest.mark.slow
def test_tune___outputs_that_the_input_does_not_reach___are_named(law: str) -> None:
    (note, *others) = tune({"rig": without(2, 3)}, TuneRequest(law=law)).notes
    assert "the input does not reach middle_strain_v, speed_v of rig" in note
    assert note.endswith("kd and ksg act on nothing there: set them to 0") == (law == "pdp")
    assert not any("reach" in each for each in others)


def test_tune___model_whose_position_does_not_move___is_refused() -> None:
    with pytest.raises(ControlError, match=r"^rig: the input does not move position_v: .*identify"):
        tune({"rig": without(0)}, TuneRequest())


def test_tune___model_with_all_outputs___says_nothing_of_them() -> None:
    notes = tune({"rig": nominal_model(0.2)}, TuneRequest(law="pi")).notes
    assert not any("reach" in each for each in notes)
