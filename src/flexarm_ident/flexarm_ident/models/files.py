"""Model files in the format of their suffix, with provenance and hash."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_core.bounds import BoundError, read_text_bytes
from flexarm_core.outputs import MARK_KEY
from flexarm_ident.models.c_header import c_header
from flexarm_ident.models.mat import mat_bytes, parameters_in_mat
from flexarm_ident.models.model_parameters import (
    ModelFileError,
    flat_parameters,
    model_parameters,
    models_in,
    nested_parameters,
    parameter_text,
    parameters_in_text,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    import control

    from flexarm_ident.models.model_parameters import ParameterValue, Provenance


@dataclass(frozen=True)
class Format:
    """File format of models.

    Attributes
    ----------
    encode : callable
        From the name of the model and its flat parameters to the content.
    decode : callable or None
        From the content to its flat parameters; raises `ModelFileError`. None for write-only
        formats.
    """

    encode: Callable[[str, Mapping[str, ParameterValue]], bytes]
    decode: Callable[[bytes], dict[str, object]] | None


def _json_bytes(_name: str, parameters: Mapping[str, ParameterValue]) -> bytes:
    tree = MARK_KEY | nested_parameters(parameters)
    return (json.dumps(tree, ensure_ascii=False, indent=1) + "\n").encode()


def _parameters_in_json(content: bytes) -> dict[str, object]:
    try:
        return flat_parameters(json.loads(content))
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"no JSON: {error}") from error


FORMATS = {
    ".yaml": Format(lambda _, parameters: parameter_text(parameters).encode(), parameters_in_text),
    ".json": Format(_json_bytes, _parameters_in_json),
    ".mat": Format(mat_bytes, parameters_in_mat),
    ".h": Format(lambda name, parameters: c_header(name, parameters).encode(), None),
}
"""Suffix -> format: ROS parameter file, JSON, MATLAB version 5, C header."""

EXPORTS = tuple(suffix for suffix in FORMATS if suffix != ".yaml")
"""Suffixes of the formats beside the parameter file."""


def save_model(
    path: Path | str, model: control.StateSpace, *, name: str, provenance: Provenance
) -> None:
    """Write a model, to the last bit, in the format of the suffix.

    Parameters
    ----------
    path : Path or str
        File ending with one of `FORMATS`.
    model : control.StateSpace
        Discrete model with at least one state.
    name : str
        Name of the model: letters, digits and underscores.
    provenance : mapping of str, list of str or list of float
        Origin of the model, and its friction.

    Raises
    ------
    ModelFileError
        If the suffix is unknown or the format cannot hold the model.
    OSError
        If the file cannot be written.
    """
    encode = _format(path).encode
    try:
        content = encode(name, model_parameters(name, model, provenance=provenance))
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from error
    Path(path).write_bytes(content)


def load_model(path: Path | str) -> control.StateSpace:
    """Read a model and check its period, names, sizes and hash.

    Parameters
    ----------
    path : Path or str
        File of `save_model`, or any other with one model in the same form.

    Returns
    -------
    control.StateSpace
        The model, with ``dt`` and the names of inputs and outputs.

    Raises
    ------
    ModelFileError
        If the file cannot be read, or the model is incomplete or was changed after it was written.
    """
    models = load_models(path)
    if len(models) > 1:
        raise ModelFileError(
            f"{path}: holds the models {', '.join(models)}: models.files.load_models reads them all"
        )
    (model,) = models.values()
    return model


def load_models(path: Path | str) -> dict[str, control.StateSpace]:
    """Read all models of a file by name, in the order of the file, as `load_model` reads one."""
    parameters = load_parameters(path)
    try:
        return models_in(parameters)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from error


def load_parameters(path: Path | str) -> dict[str, object]:
    """Read the flat parameters of a file, those of its models among them, unchecked.

    Raises
    ------
    ModelFileError
        If the file cannot be read.
    """
    decode = _format(path).decode
    if decode is None:
        readable = ", ".join(suffix for suffix, each in FORMATS.items() if each.decode)
        raise ModelFileError(f"{path}: this format is for compilers only: read one of {readable}")
    try:
        return decode(read_text_bytes(Path(path)))
    except OSError as error:
        raise ModelFileError(f"{path}: {error.strerror}") from error
    except BoundError as error:
        raise ModelFileError(str(error)) from error
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from error


def parse_exports(text: str) -> tuple[str, ...]:
    """Return the suffixes in a list of formats such as ``json,mat,h``, each once.

    Raises
    ------
    ModelFileError
        If a format is unknown.
    """
    words = [word.strip() for word in text.split(",")]
    suffixes = tuple(dict.fromkeys(f".{word}" for word in words if word))
    for suffix in suffixes:
        if suffix not in EXPORTS:
            choices = ", ".join(each.removeprefix(".") for each in EXPORTS)
            raise ModelFileError(f"no format {suffix[1:]!r} to export: choose from {choices}")
    return suffixes


def _format(path: Path | str) -> Format:
    suffix = Path(path).suffix
    if suffix not in FORMATS:
        raise ModelFileError(f"{path}: no format {suffix!r}: use one of {', '.join(FORMATS)}")
    return FORMATS[suffix]
