"""Models in a ROS parameter file, without loss."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from flexarm_ident.models.model_parameters import (
    ModelFileError,
    flat_parameters,
    models_in,
    nested_parameters,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    import control

    from flexarm_ident.models.model_parameters import ParameterValue


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
    return text


def read_parameter_file(path: Path | str) -> dict[str, control.StateSpace]:
    """Return the models in a parameter file of any node by name, in the order of the file.

    Parameters
    ----------
    path : Path or str
        YAML file for ``--params-file``, with nested or flat keys.

    Raises
    ------
    ModelFileError
        If the file cannot be read, holds no model, or a model is damaged.
    """
    try:
        return models_in_text(Path(path).read_bytes())
    except OSError as error:
        raise ModelFileError(f"{path}: {error.strerror}") from error
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from error


def models_in_text(text: bytes) -> dict[str, control.StateSpace]:
    """Return the models in the text of a parameter file, see `read_parameter_file`."""
    try:
        document = yaml.safe_load(text.decode("utf-8"))
    except (ValueError, yaml.YAMLError) as error:
        raise ModelFileError(f"no YAML: {' '.join(str(error).split())}") from error
    nodes = document.values() if isinstance(document, dict) else ()
    parameters: dict[str, object] = {}
    for node in nodes:
        if isinstance(node, dict):
            parameters.update(flat_parameters(node.get("ros__parameters")))
    return models_in(parameters)


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
