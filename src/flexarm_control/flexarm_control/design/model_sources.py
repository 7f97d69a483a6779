"""Models of a tuning by their names: files, bags, nominal ones, with their payloads."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_control.models.arm_model import check_arm_signals
from flexarm_control.models.nominal_models import nominal_model
from flexarm_core.channels import COMMAND
from flexarm_core.errors import IdentificationError, SettingError
from flexarm_ident.job import MODEL_FILE
from flexarm_ident.models import files
from flexarm_ident.reading.read import read_bag_report
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

_NOMINAL = "nominal:"
_LEVEL = ".friction_level"
_FLIPPED = ":flipped"
_PAYLOAD = re.compile(r"(\d*\.?\d+)=(.+)", re.DOTALL)


def load_models(names: Sequence[str]) -> dict[str, control.StateSpace]:
    """Load models from files, identify them from bags, or take nominal ones.

    Parameters
    ----------
    names : sequence of str
        Model files (YAML, JSON, MAT), bags (identified, reduced by MRM and updated by B),
        ``nominal:0.2`` for the nominal model with 0.2 kg, ``nominal:0.2:flipped`` for it with the
        sign of y3 inverted. Before each may stand its payload, ``0.15=out/model.yaml``.

    Returns
    -------
    dict of str to control.StateSpace
        Models by name.

    Raises
    ------
    SettingError
        When a file, bag or payload has no model.
    """
    models: dict[str, control.StateSpace] = {}
    for name in names:
        source = _source(name)
        if source.startswith(_NOMINAL):
            models[name] = nominal_model(
                _nominal_kg(source.removesuffix(_FLIPPED)),
                flip_middle_strain=source.endswith(_FLIPPED),
            )
            continue
        if not Path(source).exists():
            raise SettingError(
                f"{source}: no such file: name a file from identify, a bag, or nominal:KG"
            )
        if (Path(source) / MODEL_FILE).is_file():
            raise SettingError(f"{source}: is the folder of a model: name {source}/{MODEL_FILE}")
        try:
            if Path(source).is_dir():
                models[name] = _identified(Path(source))
                continue
            found = files.load_models(source)
        except IdentificationError as error:
            raise SettingError(str(error)) from error
        models.update({f"{name} {key}": model for key, model in found.items()})
    return models


def friction_levels_v(names: Sequence[str]) -> dict[str, float]:
    """Return the friction that `identify` found, V, for each model file that has it.

    Parameters
    ----------
    names : sequence of str
        Models as `load_models` takes them, which has read them before.
    """
    found: dict[str, float] = {}
    for name in names:
        if not Path(_source(name)).is_file():
            continue
        parameters = files.load_parameters(_source(name))
        for key, levels in parameters.items():
            if key.endswith(_LEVEL) and isinstance(levels, list) and len(levels) == 1:
                prefix = key.removesuffix(_LEVEL)
                if parameters.get(f"{prefix}.input_names") == [COMMAND.name]:
                    found[f"{name} {prefix.rpartition('.')[2]}"] = float(levels[0])
    return found


def payload_kg(name: str) -> float:
    """Return the payload in the name of a model, kg.

    Raises
    ------
    SettingError
        When the name has none.
    """
    if given := _PAYLOAD.fullmatch(name):
        return float(given[1])
    if name.startswith(_NOMINAL):
        return _nominal_kg(name.removesuffix(_FLIPPED))
    raise SettingError(f"{name}: write its payload in kg before it, such as 0.15={name}")


def is_nominal(name: str) -> bool:
    """Return whether a model is one of the thesis's arm."""
    return _source(name).startswith(_NOMINAL)


def parameter_name(name: str) -> str:
    """Return the name of a model with the characters that a parameter's name may have.

    A file's model has its name in the file, which comes last.
    """
    last = _source(name).rpartition(" ")[2].rstrip("/").rpartition("/")[2]
    return re.sub(r"\W+", "_", last) or "model"


def _source(name: str) -> str:
    """Return the name without a payload before it; a file may be named like that, too."""
    given = _PAYLOAD.fullmatch(name)
    return given[2] if given and not Path(name).exists() else name


def _identified(bag: Path) -> control.StateSpace:
    record = read_bag_report(bag).data
    # Before the identification, which may take a minute.
    check_arm_signals(record.inputs, record.outputs, str(bag))
    return run(record, Request(reduction="mrm", update="b")).model


def _nominal_kg(name: str) -> float:
    try:
        return float(name.removeprefix(_NOMINAL))
    except ValueError as error:
        raise SettingError(f"{name}: write the payload in kg, such as nominal:0.2") from error
