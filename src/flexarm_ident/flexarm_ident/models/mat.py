"""Model as a MATLAB file, version 5."""

from __future__ import annotations

import hashlib
import io
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from flexarm_core.errors import one_line
from flexarm_core.outputs import MARK
from flexarm_ident.models.model_parameters import (
    FIELDS,
    ModelFileError,
    flat_parameters,
    model_fields,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from flexarm_ident.models.model_parameters import ParameterValue

# The header's free text, where scipy puts the date. The same model has to give the same file,
# and damage is told by a digest of all that follows.
_HEADER_SIZE = 116
_MATRICES = ("A", "B", "C", "D")
_NAMES = ("input_names", "output_names")
_VARIABLES = (*_MATRICES, "dt", *_NAMES, "name", "hash")
_OURS = f"MATLAB 5.0 MAT-file, {MARK}, SHA-256 ".encode()


def mat_bytes(name: str, parameters: Mapping[str, ParameterValue]) -> bytes:
    """Return the content of a MAT-file with a model, given by its name and flat parameters.

    Its variables are ``A B C D dt``, ``input_names`` and ``output_names`` as cells, ``name``,
    ``hash``, and a structure ``provenance``.
    """
    fields: dict[str, Any] = model_fields(name, parameters)
    inputs, outputs = (_cells(fields[key]) for key in _NAMES)
    heights = (fields["states"], fields["states"], len(outputs), len(outputs))
    variables: dict[str, Any] = {
        key: np.reshape(fields[key.lower()], (height, -1))
        for key, height in zip(_MATRICES, heights, strict=True)
    }
    variables |= {"dt": fields["dt_s"], "input_names": inputs, "output_names": outputs}
    variables |= {"name": name, "hash": fields["hash"]}
    origin = {
        key: _column(value) if isinstance(value, list) else value
        for key, value in fields.items()
        if key not in FIELDS
    }
    if origin:
        variables["provenance"] = origin
    buffer: Any = io.BytesIO()
    scipy.io.savemat(buffer, variables, long_field_names=True)
    body: bytes = buffer.getvalue()[_HEADER_SIZE:]
    return _header(body) + body


def parameters_in_mat(content: bytes) -> dict[str, object]:
    """Return the flat parameters of the one model in a MAT-file.

    Parameters
    ----------
    content : bytes
        From `mat_bytes`, or saved again by MATLAB as ``-v6`` or ``-v7``.

    Raises
    ------
    ModelFileError
        If the file is damaged or lacks a variable.
    """
    header, body = content[:_HEADER_SIZE], content[_HEADER_SIZE:]
    if header.startswith(_OURS) and header != _header(body):
        raise ModelFileError("was damaged or changed after it was written: write it again")
    try:
        stream: Any = io.BytesIO(content)
        variables = scipy.io.loadmat(stream)
        missing = [name for name in _VARIABLES if name not in variables]
        nested = None if missing else _nested(variables)
    except Exception as error:  # a damaged file makes scipy raise almost anything
        raise ModelFileError(f"no MAT-file of version 5: {one_line(error)}") from error
    if missing:
        raise ModelFileError(f"variable {missing[0]} is missing")
    return flat_parameters(nested)


def _nested(variables: Mapping[str, Any]) -> dict[str, object]:
    """Return the nested parameters of the one model among the variables of a file."""
    fields: dict[str, object] = {key.lower(): _list(variables[key]) for key in _MATRICES}
    fields |= {key: [_scalar(cell) for cell in variables[key].ravel()] for key in _NAMES}
    fields |= {"states": len(variables["A"]), "hash": _scalar(variables["hash"])}
    fields["dt_s"] = _scalar(variables["dt"])
    return {"models": {str(_scalar(variables["name"])): fields | _origin(variables)}}


def _origin(variables: Mapping[str, Any]) -> dict[str, object]:
    """Return the fields of the structure `provenance`: lists are columns, texts are lines."""
    structure = variables.get("provenance")
    if structure is None or structure.dtype.names is None or structure.size != 1:
        return {}
    found = {key: structure[key].item() for key in structure.dtype.names}
    return {key: _entries(value) for key, value in found.items()}


def _entries(value: Any) -> object:  # noqa: ANN401 - whatever the file held
    array = np.asarray(value)
    if array.dtype == object:
        return [_scalar(cell) for cell in array.ravel()]
    return _scalar(array) if array.dtype.kind == "U" else _list(array)


def _list(matrix: Any) -> object:  # noqa: ANN401 - whatever the file held
    return np.asarray(matrix).ravel().tolist()


def _scalar(value: Any) -> object:  # noqa: ANN401 - whatever the file held
    array = np.asarray(value)
    return array.item() if array.size == 1 else None


def _header(body: bytes) -> bytes:
    return (_OURS + hashlib.sha256(body).hexdigest().encode()).ljust(_HEADER_SIZE)


def _column(values: list[Any]) -> NDArray[Any]:
    return _cells(values) if isinstance(values[0], str) else np.array(values)[:, np.newaxis]


def _cells(texts: Any) -> NDArray[np.object_]:  # noqa: ANN401 - a list of str
    return np.array(texts, dtype=object)[:, np.newaxis]
