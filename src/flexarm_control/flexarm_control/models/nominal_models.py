"""Models of the arm that come with the package, and one that a user names."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from flexarm_control.models.arm_model import MIDDLE_STRAIN
from flexarm_core.errors import IdentificationError, SettingError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

PREFIX = "models."
"""Beginning of the parameters of models, as the identification gives and writes them."""


@cache
def _available() -> dict[float, str]:
    folder = files("flexarm_control.models")
    documents = [file.read_text("utf-8") for file in folder.iterdir() if file.name.endswith("yaml")]
    texts = {float(yaml.safe_load(text)["payload_kg"]): text for text in documents}
    return dict(sorted(texts.items()))


def nominal_payloads_kg() -> tuple[float, ...]:
    """Return the payloads that have a nominal model, kg, smallest first."""
    return tuple(_available())


def nominal_model(payload_kg: float, *, flip_middle_strain: bool = False) -> control.StateSpace:
    """Return the nominal model of Appendix B, printed to four decimals.

    Parameters
    ----------
    payload_kg : float
        Payload at the tip, kg: 0, 0.2 or 0.4.
    flip_middle_strain : bool
        True inverts the sign of the middle strain y3. As printed, the margins of the gains of Table
        4-2 are below its own constraints, and the best Ksg is at its lower bound. With the sign
        inverted, the best gains are close to those of the table. The thesis's own models therefore
        probably had the other sign.

    Returns
    -------
    control.StateSpace
        Model from the motor command to position, base strain, middle strain and speed, all in V, at
        300 Hz and with D = 0.

    Raises
    ------
    SettingError
        When there is no model for the payload; the message names the available payloads.

    Examples
    --------
    >>> from flexarm_control import nominal_model
    >>> nominal_model(0.2).nstates
    9
    """
    if payload_kg not in _available():
        payloads = ", ".join(f"{payload:g}" for payload in nominal_payloads_kg())
        raise SettingError(
            f"no nominal model for payload_kg = {payload_kg:g}; Appendix B has {payloads} kg"
        )
    model = _read(_available()[payload_kg])
    if flip_middle_strain:
        model.C[MIDDLE_STRAIN] *= -1.0
    return model


def identified_model() -> control.StateSpace:
    """Return a model of order 8 of the arm with 300 g, as in the ILQR design of section 4.4.

    The thesis does not print its own. This model is identified from the simulated experiment
    C_dat11; its file describes the identification. Its signals are those of `nominal_model`.
    """
    file = files("flexarm_control.models") / "identified" / "payload_300g.yaml"
    return _read(file.read_text("utf-8"))


def rig_model(payload_kg: float) -> control.StateSpace:
    """Return the model of the simulated rig without friction, gap and delay, as a design needs it.

    Parameters
    ----------
    payload_kg : float
        Payload at the tip, kg: 0, 0.2 or 0.4.

    Returns
    -------
    control.StateSpace
        Model of order 8 at 300 Hz: rigid motion and three bending modes. Its file says how it was
        made. Its signals are those of `nominal_model`.
    """
    name = f"payload_{1000 * payload_kg:03.0f}g.yaml"
    return _read((files("flexarm_control.models") / "rig" / name).read_text("utf-8"))


def _read(text: str) -> control.StateSpace:
    # The identification is loaded only to make a model.
    from flexarm_ident.models.state_space import state_space  # noqa: PLC0415

    content = yaml.safe_load(text)
    return state_space(
        content["a"],
        content["b"],
        content["c"],
        0.0,
        1.0 / content["sampling_rate_hz"],
        inputs=content["inputs"],
        outputs=content["outputs"],
        name=f"payload_{1000 * content['payload_kg']:.0f}g",
    )


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
