"""Model that a user names: among parameters `models.<name>.*`, or in a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_core.errors import IdentificationError, SettingError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

PREFIX = "models."
"""Beginning of the parameters of models, as the identification gives and writes them."""


class ModelChoices:
    """Choices of the models of all laws: also of one that is not in force, each when it changes.

    Parameters
    ----------
    keys : sequence of str
        Parameters that choose a model.
    """

    def __init__(self, keys: Sequence[str]) -> None:
        self._keys = keys
        self._in_force: dict[str, object] = {}

    def check(self, parameters: Mapping[str, object]) -> None:
        """Refuse a choice that differs from the one in force and is none.

        Raises
        ------
        SettingError
            When there is no such model, or it is incomplete or was changed.
        """
        for key, choice in self._of(parameters).items():
            if choice == self._in_force.get(key, ""):
                continue
            try:
                chosen_model(str(choice), parameters)
            except SettingError as error:
                raise SettingError(f"parameter {key}: {error}") from error

    def take(self, parameters: Mapping[str, object]) -> None:
        """Take choices that come into force: they are not looked up again."""
        self._in_force = self._of(parameters)

    def _of(self, parameters: Mapping[str, object]) -> dict[str, object]:
        return {key: parameters.get(key, "") for key in self._keys}


def chosen_model(choice: str, parameters: Mapping[str, object]) -> control.StateSpace | None:
    """Return the model that a user names; None for an empty choice.

    Parameters
    ----------
    choice : str
        Name of a model among the parameters, or a file of the identification with one model.
    parameters : mapping of str to object
        Flat parameters, those of models ``models.<name>.<field>``.

    Raises
    ------
    SettingError
        When there is no such model, or it is incomplete or was changed.
    """
    if not choice:
        return None
    # The identification is loaded only to make a model.
    from flexarm_ident.models.files import load_model  # noqa: PLC0415
    from flexarm_ident.models.model_parameters import model_from_parameters  # noqa: PLC0415

    names = {key.split(".")[1]: None for key in parameters if key.startswith(PREFIX)}
    try:
        if choice in names:
            return model_from_parameters(choice, parameters)
        if Path(choice).is_file():
            return load_model(choice)
    except IdentificationError as error:
        raise SettingError(str(error)) from error
    known = ", ".join(names) or "none"
    raise SettingError(
        f"no model {choice!r}: name a file from identify, with its whole path, or a model among "
        f"the parameters {PREFIX}<name>.* (there: {known})"
    )
