"""Law and reference of a controller from its parameters, and these parameters as one text."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm_control.laws.registry import LAWS, LawSpec, build_law
from flexarm_control.models.chosen_model import PREFIX, chosen_model
from flexarm_control.references import REFERENCES, Reference, build_reference
from flexarm_control.sample_rate import suits
from flexarm_core.errors import SettingError
from flexarm_core.tables import read_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    import control

    from flexarm_control.laws.law_protocol import LawWithMemory
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
            "laws": tuple(LAWS),
            "references": (TOPIC, *REFERENCES),
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


@dataclass(frozen=True)
class Setup:
    """Law and reference in force; replaced as a whole, by one assignment.

    Attributes
    ----------
    law_spec : LawSpec
        Row of the control law.
    law : LawWithMemory
        The control law.
    rate_hz : float or None
        Sampling rate of the law, Hz; None when it suits any.
    profile : Reference or None
        Built-in reference, or None when it comes from the topic.
    text : str
        All that the setup was built from, as JSON; `parameters_in` reads it.
    """

    law_spec: LawSpec
    law: LawWithMemory
    rate_hz: float | None
    profile: Reference | None
    text: str

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
        return cls(law_spec, law, rate_hz, profile, _text(values, model))

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
        raise SettingError(
            f"law {name} is made for {self.rate_hz:g} Hz and the samples come at "
            f"{measured_hz:.0f} Hz: {remedy}"
        )


def parameters_in(text: str) -> dict[str, Any]:
    """Return the parameters in a text of `Setup`, which may come from anywhere.

    Raises
    ------
    SettingError
        When the text is no JSON, or a parameter is unknown, out of range or of another type.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SettingError(f"the parameters of the law are no JSON: {error}") from error
    if not isinstance(values, dict) or not {"law", "reference"} <= values.keys():
        raise SettingError("the parameters of the law are without law or reference")
    for name, value in values.items():
        if name.startswith(PREFIX):
            continue
        spec = _SPECS.get(name)
        if spec is None:
            raise SettingError(f"no parameter {name}: it was recorded by another version")
        if not _has_type(value, type(spec.default)):
            raise SettingError(f"parameter {name} must be a {type(spec.default).__name__}")
        spec.check(value, "parameter")
    return values


def _has_type(value: object, wanted: type) -> bool:
    """Return whether a value can be a parameter's; JSON may write 3.0 as 3."""
    if isinstance(value, bool) or wanted is bool:
        return isinstance(value, bool) and wanted is bool
    return isinstance(value, wanted) or (wanted is float and isinstance(value, int))


def _text(values: Mapping[str, Any], model: control.StateSpace | None) -> str:
    """Return what law and reference are built from, with the model in place of its file."""
    name, reference = values["law"], values["reference"]
    groups = (f"{name}.", f"{reference}.")
    used: dict[str, Any] = {"law": name, "reference": reference}
    used |= {key: value for key, value in values.items() if key.startswith(groups)}
    if model is not None:
        # The identification is loaded only for a model.
        from flexarm_ident.models.model_parameters import model_parameters  # noqa: PLC0415

        choice = re.sub(r"\W", "_", Path(used[f"{name}.model"]).stem)
        used[f"{name}.model"] = choice
        used |= model_parameters(choice, model, provenance={})
    return json.dumps(used)
