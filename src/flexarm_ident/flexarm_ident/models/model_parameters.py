"""Model as ROS parameters, also in a file, without loss.

A model `arm` is a set of flat parameters `models.arm.<field>`: the matrices `a`, `b`, `c`, `d` as
row-major lists, the number of `states`, `input_names`, `output_names`, the period `dt_s`, its
provenance, and a `hash` that reveals later changes. A model with dry friction has the fields of
`dry_friction` as well.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from flexarm_core.bounds import YamlError, shown, yaml_content
from flexarm_core.errors import IdentificationError, reason
from flexarm_core.outputs import MARK
from flexarm_ident.models.state_space import state_space

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    import control

    from flexarm_core.arrays import FloatArray

    ParameterValue = str | int | float | list[float] | list[str]
    Provenance = Mapping[str, str | list[str] | list[float]]

_ROOT = "models"
_MATRICES = ("a", "b", "c", "d")
FIELDS = (*_MATRICES, "states", "input_names", "output_names", "dt_s", "hash")
"""Fields of the linear model; every further field is friction or provenance."""
MOST_STATES = 10_000
_LONGEST_NAME = 1000


class ModelFileError(IdentificationError):
    """Error of a parameter file, or of a set of parameters, without a valid model."""


def model_parameters(
    name: str, model: control.StateSpace, *, provenance: Provenance
) -> dict[str, ParameterValue]:
    """Return a model as flat ROS parameters ``models.<name>.<field>``.

    Matrices are row-major lists, to the last bit but for entries below 2.2e-308, which become zero.

    Parameters
    ----------
    name : str
        Name of the model: letters, digits and underscores.
    model : control.StateSpace
        Discrete model with at least one state.
    provenance : mapping of str, list of str or list of float
        Origin of the model, such as ``source`` and ``method``, and its friction.

    Raises
    ------
    ModelFileError
        If the name, the model or a key of the provenance cannot be a parameter.
    """
    for token in (name, *provenance):
        if not re.fullmatch(r"\w+", token):
            raise ModelFileError(f"{token!r}: use letters, digits and underscores only")
    for key in provenance:
        if key in FIELDS:
            raise ModelFileError(f"provenance {key!r} is a field of the model: choose another key")
    _check_model(name, model)
    matrices = (model.A, model.B, model.C, model.D)
    fields: dict[str, ParameterValue] = {
        "states": int(model.nstates),
        "input_names": [str(label) for label in model.input_labels],
        "output_names": [str(label) for label in model.output_labels],
        "dt_s": float(model.dt),
        **provenance,
        "hash": model_hash(model),
        **{
            key: _entries(matrix).ravel().tolist()
            for key, matrix in zip(_MATRICES, matrices, strict=True)
        },
    }
    return {f"{_ROOT}.{name}.{field}": value for field, value in fields.items()}


def model_from_parameters(name: str, parameters: Mapping[str, object]) -> control.StateSpace:
    """Return one model among flat parameters, of `model_parameters`.

    Raises
    ------
    ModelFileError
        If a field is missing, has the wrong size or type, or the hash is not that of the model.
    """
    prefix = f"{_ROOT}.{name}."
    for field in FIELDS:
        if prefix + field not in parameters:
            raise ModelFileError(f"{prefix}{field} is missing")
    fields = {field: parameters[prefix + field] for field in FIELDS}
    dt_s, states = fields["dt_s"], fields["states"]
    if not isinstance(dt_s, float) or not (math.isfinite(dt_s) and dt_s > 0.0):
        raise ModelFileError(f"{prefix}dt_s must be a positive number of seconds: {shown(dt_s)}")
    if not isinstance(states, int) or isinstance(states, bool) or not 1 <= states <= MOST_STATES:
        raise ModelFileError(
            f"{prefix}states must be a whole number, 1 to {MOST_STATES}: {shown(states)}"
        )
    inputs, outputs = (_names(prefix + key, fields[key]) for key in ("input_names", "output_names"))
    rows = (states, states, len(outputs), len(outputs))
    columns = (states, len(inputs), states, len(inputs))
    A, B, C, D = (
        _matrix(prefix + key, fields[key], shape)
        for key, *shape in zip(_MATRICES, rows, columns, strict=True)
    )
    model = state_space(A, B, C, D, dt_s, inputs=inputs, outputs=outputs)
    if fields["hash"] != model_hash(model):
        raise ModelFileError(
            f"{prefix}hash does not belong to the model: it was changed after it was written, "
            "write it again"
        )
    return model


def model_hash(model: control.StateSpace) -> str:
    """Return the SHA-256 of a model's period, names and matrices, as hexadecimal digits.

    Equal bits give the same hash on every machine.
    """
    names = [list(model.input_labels), list(model.output_labels)]
    digest = hashlib.sha256(json.dumps([float(model.dt).hex(), int(model.nstates), names]).encode())
    for matrix in (model.A, model.B, model.C, model.D):
        digest.update(_entries(matrix).astype("<f8").tobytes())
    return digest.hexdigest()


def model_fields(name: str, parameters: Mapping[str, ParameterValue]) -> dict[str, ParameterValue]:
    """Return the parameters of one model by field, without their prefix ``models.<name>.``."""
    prefix = f"{_ROOT}.{name}."
    return {
        key.removeprefix(prefix): value
        for key, value in parameters.items()
        if key.startswith(prefix)
    }


def nested_parameters(parameters: Mapping[str, object]) -> dict[str, Any]:
    """Return flat parameters as nested ones: ``a.b`` becomes ``b`` in ``a``."""
    tree: dict[str, Any] = {}
    for key, value in parameters.items():
        *groups, field = key.split(".")
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})
        branch[field] = value
    return tree


def flat_parameters(tree: object) -> dict[str, object]:
    """Return nested parameters as flat ones, and none of anything but a mapping."""
    return dict(_flat(tree, ""))


def models_in(parameters: Mapping[str, object]) -> dict[str, control.StateSpace]:
    """Return all models among flat parameters by name, in their order.

    Raises
    ------
    ModelFileError
        If there is no model, or one is damaged.
    """
    keys = (key.split(".") for key in parameters)
    names = dict.fromkeys(key[1] for key in keys if key[0] == _ROOT and len(key) > 1)
    if not names:
        raise ModelFileError(f"no parameters {_ROOT}.<name>.*: not a model's file")
    return {name: model_from_parameters(name, parameters) for name in names}


def _entries(matrix: FloatArray) -> FloatArray:
    # The parser of ROS takes a number below the smallest normal double for a text.
    tiny = (matrix != 0.0) & (np.abs(matrix) < np.finfo(np.float64).tiny)
    return np.where(tiny, 0.0, matrix)


def _flat(tree: object, prefix: str) -> Iterator[tuple[str, object]]:
    if isinstance(tree, dict):
        for key, value in tree.items():
            if len(prefix) + len(key := str(key)) > _LONGEST_NAME:
                raise ModelFileError(f"a parameter's name has more than {_LONGEST_NAME} characters")
            yield from _flat(value, f"{prefix}.{key}" if prefix else key)
    elif prefix:
        yield prefix, tree


def _check_model(name: str, model: control.StateSpace) -> None:
    if model.nstates < 1:
        raise ModelFileError(f"model {name} has no states")
    if not (model.ninputs and model.noutputs):
        raise ModelFileError(f"model {name} has no inputs or no outputs")
    if isinstance(model.dt, bool) or model.dt is None or not 0.0 < model.dt < math.inf:
        raise ModelFileError(f"model {name} has no sampling period: dt = {model.dt}")
    for key, matrix in zip(_MATRICES, (model.A, model.B, model.C, model.D), strict=True):
        if not np.isfinite(matrix).all():
            raise ModelFileError(f"model {name}: matrix {key} is not finite")


def _names(key: str, value: object) -> list[str]:
    names = list(value) if isinstance(value, (list, tuple)) else []
    if not names or not all(isinstance(name, str) for name in names):
        raise ModelFileError(f"{key} must be a list of names: {shown(value)}")
    if len(set(names)) < len(names):
        raise ModelFileError(f"{key} must differ: {shown(names)}")
    return names


def _matrix(key: str, value: object, shape: list[int]) -> FloatArray:
    try:
        entries = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        entries = np.array(math.nan)
    if entries.ndim == 0:
        raise ModelFileError(f"{key} must be a list of numbers")
    rows, columns = shape
    if entries.shape != (rows * columns,):
        raise ModelFileError(
            f"{key} has {entries.size} numbers, {rows} x {columns} = {rows * columns} are needed, "
            "in one flat list"
        )
    if not np.isfinite(entries).all():
        raise ModelFileError(f"{key} has a number that is not finite")
    return entries.reshape(rows, columns)


def write_parameter_file(
    path: Path | str, parameters: Mapping[str, ParameterValue], *, node: str = "/**"
) -> None:
    """Write flat parameters as a YAML file for ``--params-file``.

    Parameters
    ----------
    path : Path or str
        File to write.
    parameters : mapping
        Flat parameters.
    node : str
        Node that takes them; ``/**`` is every node.

    Raises
    ------
    ModelFileError
        If a list is empty, which the parser of ROS refuses.
    OSError
        If the file cannot be written.
    """
    try:
        text = parameter_text(parameters, node=node)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from error
    Path(path).write_text(text, encoding="utf-8")


def parameter_text(parameters: Mapping[str, ParameterValue], *, node: str = "/**") -> str:
    """Return the text of a parameter file, see `write_parameter_file`."""
    for key, value in parameters.items():
        if isinstance(value, list) and not value:
            raise ModelFileError(f"{key} is an empty list, which ROS cannot read")
    quoted = {key: _quoted(value) for key, value in parameters.items()}
    text: str = yaml.dump(
        {node: {"ros__parameters": nested_parameters(quoted)}},
        Dumper=_Dumper,
        default_flow_style=None,
        sort_keys=False,
        allow_unicode=True,
        width=100,
    )
    return f"# {MARK}\n{text}"


def parameters_in_text(text: bytes) -> dict[str, object]:
    """Return the flat parameters in the text of a parameter file, of all its nodes together.

    Raises
    ------
    ModelFileError
        If it is not YAML.
    """
    try:
        document = yaml_content(text.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise ModelFileError(f"no YAML: {reason(error)}") from error
    except YamlError as error:
        raise ModelFileError(str(error)) from error
    nodes = document.values() if isinstance(document, dict) else ()
    parameters: dict[str, object] = {}
    for node in nodes:
        if isinstance(node, dict):
            parameters.update(flat_parameters(node.get("ros__parameters")))
    return parameters


class _Text(str):
    """String with forced quotes, since the ROS parser reads a hash such as 12e4... as a number."""

    __slots__ = ()


class _Dumper(yaml.SafeDumper):
    """Dumper of floats with all digits and a dot, which keeps them floats."""


_Dumper.add_representer(
    _Text, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')
)


def _quoted(value: ParameterValue) -> object:
    if isinstance(value, list):
        return [_Text(item) if isinstance(item, str) else item for item in value]
    return _Text(value) if isinstance(value, str) else value
