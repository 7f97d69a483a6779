"""Law and reference of a controller from its parameters, and these parameters as one text."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_control.joint_laws import compensation_v, require_known_outputs
from flexarm_control.laws.registry import LAWS, LawSpec, build_law
from flexarm_control.learning.columns import read_trajectory
from flexarm_control.learning.trajectory import FollowingLaw
from flexarm_control.models.nominal_models import PREFIX, chosen_model
from flexarm_control.planning.move import MoveSettings
from flexarm_control.references import REFERENCES, Reference, build_reference
from flexarm_control.sample_rate import suits
from flexarm_control.shaping.shaped_law import ShapedLaw, model_vibrations, nominal_vibrations
from flexarm_control.shaping.shapers import NONE, SHAPERS
from flexarm_core.errors import SettingError
from flexarm_core.tables import read_table

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import control

    from flexarm_control.laws.law_protocol import LawWithMemory
    from flexarm_control.laws.payload import PayloadEstimate
    from flexarm_core.rig_description import RigDescription
    from flexarm_core.specs import ParameterSpec

TOPIC = "topic"
"""The reference comes from the service and the topic, and not from a built-in profile."""


def _under(prefix: str, specs: tuple[ParameterSpec, ...]) -> list[ParameterSpec]:
    """Return parameters of a law or reference under its name, as ``pd.kp``."""
    return [replace(spec, name=f"{prefix}.{spec.name}", live=True) for spec in specs]


def _below(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a law or reference by the names that it has for them, as ``kp``."""
    start = prefix + "."
    return {name.removeprefix(start): values[name] for name in values if name.startswith(start)}


PARAMETERS = (
    *read_table(
        "flexarm_control",
        "controller",
        {
            "topic": TOPIC,
            "laws": (*LAWS, "servo"),
            "references": (TOPIC, *REFERENCES),
            "no_shaper": NONE,
            "shapers": (NONE, *SHAPERS),
            "designed_laws": tuple(row.name for row in LAWS.values() if row.takes_model),
        },
    ),
    *(
        spec
        for table in (LAWS, REFERENCES)
        for name, row in table.items()
        for spec in _under(name, row.parameters)
    ),
)
_SPECS = {spec.name: spec for spec in PARAMETERS}
MODEL_CHOICES = tuple(f"{row.name}.model" for row in LAWS.values() if row.takes_model)
"""Parameters that choose the model of a law."""
_OF_SHAPER = [name for name in _SPECS if name.startswith("shaper")]


@dataclass(frozen=True)
class Setup:
    """Law and reference in force; replaced as a whole, by one assignment.

    Attributes
    ----------
    law_spec : LawSpec
        Row of the control law.
    law : LawWithMemory
        The control law, behind its shaper.
    payload : callable or None
        Function that returns the law's estimate of the payload, if it has one.
    rate_hz : float or None
        Sampling rate of law and shaper, Hz; None when they suit any.
    profile : Reference or None
        Built-in reference or that of a trajectory, or None when it comes from the topic.
    text : str
        All that the setup was built from, as JSON; `parameters_in` reads it.
    """

    law_spec: LawSpec
    law: LawWithMemory
    payload: Callable[[], PayloadEstimate] | None
    rate_hz: float | None
    profile: Reference | None
    text: str

    @classmethod
    def of_joints(cls, values: Mapping[str, Any], rig: RigDescription) -> tuple[Setup, ...]:
        """Build law and reference of each joint of a rig that is not the thesis's arm.

        The compensation of friction is that of the rig's description. A random reference is another
        one for each joint, by which an identification tells the inputs apart.

        Raises
        ------
        SettingError
            When the values do not fit together, or the rig lacks what the law needs.
        """
        name = values["law"]
        require_known_outputs(LAWS[name], rig)
        level, of_wave = f"{name}.compensation_v", f"{values['reference']}.seed"
        made = []
        for number, joint in enumerate(rig.joints):
            own = {level: compensation_v(rig, joint)} if level in values else {}
            rate = {f"{name}.rate_hz": rig.rate_hz} if f"{name}.rate_hz" in values else {}
            seed = {of_wave: values[of_wave] + number} if of_wave in values else {}
            made.append(cls.of({**values, **own, **rate, **seed}))
        return tuple(made)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Setup:
        """Build law and reference from all parameters of the node.

        Raises
        ------
        SettingError
            When the values do not fit together.
        """
        name, reference = values["law"], values["reference"]
        profile = None
        if reference != TOPIC:
            profile = build_reference(reference, _below(reference, values))
        law_spec, gains = LAWS[name], _below(name, values)
        model = chosen_model(gains.pop("model", ""), values)
        law, rate_hz = build_law(name, gains, model), law_spec.rate_hz(gains, model)
        payload = partial(law_spec.payload, law) if law_spec.payload else None
        used = _used(values)
        _replace_model(used, f"{name}.model", "", model)
        if values.get("trajectory"):
            _refuse_beside_trajectory(values, law_spec)
            following = _following(law_spec, law, gains, values["trajectory"])
            law, rate_hz = following, following.rate_hz
            payload = None
            profile = following.asked_v
            used["trajectory"] = values["trajectory"]
        elif values.get("shaper", NONE) != NONE:
            shaper = {key: values.get(key, _SPECS[key].default) for key in _OF_SHAPER}
            named = chosen_model(shaper["shaper_model"], values)
            rate_hz = rate_hz or shaper["shaper_rate_hz"]
            law = _shaped(law, shaper, model if named is None else named, rate_hz, payload)
            used |= shaper
            _replace_model(used, "shaper_model", "shaper_", named)
        return cls(law_spec, law, payload, rate_hz, profile, json.dumps(used))

    def check_rate(self, measured_hz: float | None) -> None:
        """Refuse samples at another rate than that of the law.

        Raises
        ------
        SettingError
            When the rates differ; the message states the remedy.
        """
        if self.rate_hz is None or measured_hz is None or suits(self.rate_hz, measured_hz):
            return
        name = self.law_spec.name
        remedy = "sample at that rate or take another law"
        if f"{name}.rate_hz" in _SPECS:
            remedy = f"set {name}.rate_hz"
        elif self.law_spec.rate_hz({}) is None:
            remedy = "set shaper_rate_hz"
        raise SettingError(
            f"law {name} is made for {self.rate_hz:g} Hz and the samples come at "
            f"{measured_hz:.0f} Hz: {remedy}"
        )


def parameters_in(text: str) -> dict[str, Any]:
    """Return the parameters in a text of `Setup`, which may come from anywhere.

    Raises
    ------
    SettingError
        When the text is not JSON, or a parameter is unknown, out of range or of another type.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SettingError(f"the parameters of the law are not JSON: {error}") from error
    if not isinstance(values, dict) or not {"law", "reference"} <= values.keys():
        raise SettingError("the parameters of the law are without law or reference")
    for name, value in values.items():
        if name.startswith(PREFIX) or name in {"rig", "servo.content"}:
            continue
        spec = _SPECS.get(name)
        if spec is None:
            raise SettingError(f"no parameter {name}: it was recorded by another version")
        if not _has_type(value, type(spec.default)):
            raise SettingError(f"parameter {name} must be a {type(spec.default).__name__}")
        spec.check(value, "parameter")
    return values


def _has_type(value: object, wanted: type) -> bool:
    """Return whether a value can be a parameter's; JSON may write 3.0 as 3.

    A number stands for a list of it alone: older versions had one weight for all states.
    """
    if isinstance(value, bool) or wanted is bool:
        return isinstance(value, bool) and wanted is bool
    return isinstance(value, wanted) or (wanted in {float, list} and isinstance(value, int | float))


def _used(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return what law and reference are built from."""
    name, reference = values["law"], values["reference"]
    groups = (f"{name}.", f"{reference}.")
    used: dict[str, Any] = {"law": name, "reference": reference}
    return used | {key: value for key, value in values.items() if key.startswith(groups)}


def _replace_model(
    used: dict[str, Any], key: str, prefix: str, model: control.StateSpace | None
) -> None:
    """Put a model in the place of its file."""
    if model is None:
        return
    # The identification is loaded only for a model.
    from flexarm_ident.models.model_parameters import model_parameters  # noqa: PLC0415

    choice = prefix + re.sub(r"\W", "_", Path(used[key]).stem).removeprefix(prefix)
    used[key] = choice
    used |= model_parameters(choice, model, provenance={})


def _refuse_beside_trajectory(values: Mapping[str, Any], law_spec: LawSpec) -> None:
    """Refuse what a trajectory takes the place of, and laws without a PDP loop."""
    if values["reference"] != TOPIC:
        raise SettingError(
            f"a trajectory takes the place of the reference {values['reference']}: set reference "
            f"to {TOPIC}, or trajectory to nothing"
        )
    if values.get("shaper", NONE) != NONE:
        raise SettingError(f"a trajectory is not shaped: set shaper to {NONE}")
    if law_spec.plays is None:
        playing = ", ".join(name for name, row in LAWS.items() if row.plays)
        raise SettingError(f"law {law_spec.name} plays no trajectory; choose one of {playing}")


def _following(
    law_spec: LawSpec, law: LawWithMemory, gains: Mapping[str, Any], path: str
) -> FollowingLaw:
    """Return a law's loop that plays the trajectory of a file."""
    assert law_spec.plays is not None  # noqa: S101 - refused before
    usual = {spec.name: spec.default for spec in law_spec.parameters} | dict(gains)
    return FollowingLaw(
        law_spec.plays(law),
        read_trajectory(Path(path)),
        compensation_v=usual.get("compensation_v", 0.0),
        full_speed_v=usual.get("full_speed_v", MoveSettings().full_speed_v),
    )


def _shaped(
    law: LawWithMemory,
    shaper: Mapping[str, Any],
    model: control.StateSpace | None,
    rate_hz: float,
    payload: Callable[[], PayloadEstimate] | None,
) -> ShapedLaw:
    """Return a law behind a shaper, for the vibration of a model or the printed ones."""
    return ShapedLaw(
        law,
        shaper["shaper"],
        nominal_vibrations() if model is None else model_vibrations(model),
        rate_hz=rate_hz,
        payload_kg=shaper["shaper_payload_kg"],
        payload=payload if model is None else None,
    )
