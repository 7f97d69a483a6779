"""The verb tune, in this process."""

from __future__ import annotations

from inspect import signature
from typing import TYPE_CHECKING

import control
import pytest
from click.testing import CliRunner

from flexarm_bringup.verbs.laboratory.up import up
from flexarm_bringup.verbs.offline.tune import tune, tune_models
from flexarm_control.design.tuning import tune_pdp
from flexarm_control.models.nominal_models import nominal_model
from flexarm_core.errors import SettingError
from flexarm_core.outputs import MARK, OutputError
from flexarm_ident.models.files import save_model

if TYPE_CHECKING:
    from pathlib import Path


def test_help___says_the_defaults_of_the_tuning() -> None:
    said = {option.name: option.default for option in tune.params}
    names = ("error_weight", "strain_weight", "gain_margin_db", "phase_margin_deg", "delay_s")
    assert {name: said[name] for name in names} == {
        name: signature(tune_pdp).parameters[name].default for name in names
    }


def test_pi___with_a_margin___is_refused_by_its_name(tmp_path: Path) -> None:
    gains = tmp_path / "gains.yaml"
    words = ["nominal:0", "--law", "pi", "-o", str(gains)]
    refused = CliRunner().invoke(tune, [*words, "--gain-margin", "10"])
    assert isinstance(refused.exception, SettingError)
    assert "gain_margin_db" in str(refused.exception)
    assert not gains.exists()

    taken = CliRunner().invoke(tune, [*words, "--delay", "0.001"])
    assert (taken.exit_code, gains.exists()) == (0, True), taken.output


@pytest.mark.parametrize("name", ["file/gains.yaml", "folder"])
def test_gains___that_cannot_be_written___are_refused_before_the_search(
    tmp_path: Path, name: str
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    # The model is none either, which shows what was looked at first.
    with pytest.raises(OutputError, match=f"{name}: cannot be written: "):
        tune_models(("nominal:none",), tmp_path / name)


def test_gains___that_are_not_found___leave_what_was_there(tmp_path: Path) -> None:
    old, new = tmp_path / "old.yaml", tmp_path / "new.yaml"
    old.write_text(f"# {MARK}\nold")
    for out in (old, new):
        with pytest.raises(SettingError):
            tune_models(("nominal:none",), out)
    assert old.read_text() == f"# {MARK}\nold"
    assert not new.exists()


def test_file_of_somebody_else___is_refused_before_the_search___and_replaced_when_forced(
    tmp_path: Path,
) -> None:
    out = tmp_path / "gains.yaml"
    out.write_text("mine")
    with pytest.raises(OutputError, match=r"gains\.yaml: was not written by flexarm: .*--force"):
        tune_models(("nominal:none",), out)
    assert out.read_text() == "mine"
    words = ["nominal:0", "--law", "pi", "-o", str(out)]
    # Its own gains of the first run need no force in the second.
    for more in (["--force"], []):
        done = CliRunner().invoke(tune, [*words, *more])
        assert done.exit_code == 0, done.output
    assert "ros__parameters" in out.read_text()


def test_next_step___has_the_rate_of_the_model(tmp_path: Path) -> None:
    nominal = nominal_model(0.0)
    slow = control.ss(nominal.A, nominal.B, nominal.C, nominal.D, 1 / 200)
    file, gains = tmp_path / "model.yaml", tmp_path / "gains.yaml"
    save_model(file, slow, name="arm", provenance={})
    done = CliRunner().invoke(tune, [str(file), "--law", "pi", "-o", str(gains)])
    assert done.exit_code == 0, done.output
    assert "flexarm up --law pi --rate 200 --params-file" in " ".join(done.output.split())
    # What is said there is what `up` takes.
    parsed = up.make_context("up", ["--law", "pi", "--rate", "200", "--params-file", str(gains)])
    assert parsed.params["rate_hz"] == pytest.approx(200.0)
