"""Models of the arm that come with the package: of thesis and rig, and an identified one."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING

import yaml

from flexarm_control.models.arm_model import MIDDLE_STRAIN
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    import control


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
