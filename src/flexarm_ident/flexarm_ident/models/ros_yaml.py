"""Models in a ROS parameter file, without loss."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from flexarm_core.bounds import YamlError, yaml_content
from flexarm_core.errors import reason
from flexarm_core.outputs import MARK
from flexarm_ident.models.model_parameters import (
    ModelFileError,
    flat_parameters,
    nested_parameters,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

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
