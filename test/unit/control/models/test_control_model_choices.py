from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_control.loop_setup import MODEL_CHOICES
from flexarm_control.models.nominal_models import ModelChoices, nominal_model
from flexarm_core.errors import SettingError
from flexarm_ident.models.model_parameters import model_parameters

if TYPE_CHECKING:
    from pathlib import Path

NONE = dict.fromkeys(MODEL_CHOICES, "")


def test_choices___are_those_of_the_laws_with_a_model() -> None:
    assert {"ilqr.model", "lqg.model", "planned.model"} <= set(MODEL_CHOICES)


@pytest.mark.parametrize("key", MODEL_CHOICES)
def test_choice_that_is_no_model___of_any_law___is_refused_by_name(key: str) -> None:
    choices = ModelChoices(MODEL_CHOICES)
    choices.check(NONE)
    for _ in range(2):
        with pytest.raises(SettingError, match=f"parameter {key}: no model 'nope.yaml'"):
            choices.check(NONE | {key: "nope.yaml"})
    choices.check(NONE)


def test_choice_in_force___is_not_looked_up_again(tmp_path: Path) -> None:
    given: dict[str, object] = dict(model_parameters("mine", nominal_model(0.2), provenance={}))
    choices = ModelChoices(MODEL_CHOICES)
    choices.check(NONE | {"lqg.model": "mine"} | given)
    # It was checked, and another parameter of the same set may have been refused.
    with pytest.raises(SettingError, match="no model 'mine'"):
        choices.check(NONE | {"lqg.model": "mine"})
    choices.take(NONE | {"lqg.model": "mine"} | given)
    # Its parameters may go: the law that is in force has the model.
    choices.check(NONE | {"lqg.model": "mine"})
    with pytest.raises(SettingError, match="no model"):
        choices.check(NONE | {"lqg.model": str(tmp_path / "gone.yaml")})
