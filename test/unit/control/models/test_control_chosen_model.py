"""Models by their names: parameters first, then files, and what is said of the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_control.models.nominal_models import chosen_model, nominal_model
from flexarm_core.errors import SettingError
from flexarm_ident.models.files import save_model
from flexarm_ident.models.model_parameters import model_parameters, write_parameter_file

if TYPE_CHECKING:
    from pathlib import Path


def parameters(name: str, payload_kg: float) -> dict[str, Any]:
    return dict(model_parameters(name, nominal_model(payload_kg), provenance={}))


def test_no_choice___is_no_model() -> None:
    assert chosen_model("", parameters("arm", 0.0)) is None


def test_name_among_the_parameters___is_that_model() -> None:
    both = parameters("light", 0.0) | parameters("heavy", 0.4) | {"law": "ilqr"}

    found = chosen_model("heavy", both)

    assert found is not None
    np.testing.assert_array_equal(found.A, nominal_model(0.4).A)


def test_file___is_its_model(tmp_path: Path) -> None:
    file = tmp_path / "model.json"
    save_model(file, nominal_model(0.2), name="arm", provenance={})

    found = chosen_model(str(file), {})

    assert found is not None
    np.testing.assert_array_equal(found.A, nominal_model(0.2).A)


def test_unknown_name___is_refused_with_those_there_are() -> None:
    with pytest.raises(SettingError, match=r"no model 'arm': .*\(there: light\)$"):
        chosen_model("arm", parameters("light", 0.0))
    with pytest.raises(SettingError, match=r"\(there: none\)$"):
        chosen_model("nowhere/model.yaml", {})


def test_model_without_a_field___is_refused_with_it() -> None:
    part = parameters("arm", 0.0)
    del part["models.arm.b"]

    with pytest.raises(SettingError, match=r"models\.arm\.b is missing"):
        chosen_model("arm", part)


def test_file_of_no_model_or_of_two___is_refused_with_its_name(tmp_path: Path) -> None:
    none, two = tmp_path / "none.yaml", tmp_path / "two.yaml"
    none.write_text("a: [", encoding="utf-8")
    write_parameter_file(two, parameters("light", 0.0) | parameters("heavy", 0.4))

    with pytest.raises(SettingError, match=r"none\.yaml: no YAML"):
        chosen_model(str(none), {})
    with pytest.raises(SettingError, match=r"two\.yaml: holds the models light, heavy"):
        chosen_model(str(two), {})
