"""Model as a MATLAB file, version 5."""

from __future__ import annotations

import hashlib
import io
import json
import subprocess
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from flexarm_core.outputs import MARK
from flexarm_ident.models import mat_reader
from flexarm_ident.models.mat_reader import MATRICES, NAMES
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
# and a digest of all that follows shows damage.
_HEADER_SIZE = 116
# Of a machine that has much else to do; the reader's own time is bounded.
_DEADLINE_S = 60.0
_OURS = f"MATLAB 5.0 MAT-file, {MARK}, SHA-256 ".encode()


def mat_bytes(name: str, parameters: Mapping[str, ParameterValue]) -> bytes:
    """Return the content of a MAT-file with a model, given by its name and flat parameters.

    Its variables are ``A B C D dt``, ``input_names`` and ``output_names`` as cells, ``name``,
    ``hash``, and a structure ``provenance``.
    """
    fields: dict[str, Any] = model_fields(name, parameters)
    inputs, outputs = (_cells(fields[key]) for key in NAMES)
    heights = (fields["states"], fields["states"], len(outputs), len(outputs))
    variables: dict[str, Any] = {
        key: np.reshape(fields[key.lower()], (height, -1))
        for key, height in zip(MATRICES, heights, strict=True)
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
    answer = json.loads(_read_apart(content))
    if "error" in answer:
        raise ModelFileError(answer["error"])
    return flat_parameters(answer["tree"])


def _read_apart(content: bytes) -> str:
    """Return the answer of the reader, in a process that the file may kill."""
    try:
        done = subprocess.run(  # noqa: S603 - this Python and our own program
            [sys.executable, mat_reader.__file__],
            input=content,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_DEADLINE_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ModelFileError(f"reading it takes longer than {_DEADLINE_S:.0f} s") from None
    if done.returncode:
        raise ModelFileError(f"no MAT-file of version 5: it ends its reader ({done.returncode})")
    return done.stdout.decode()


def _header(body: bytes) -> bytes:
    return (_OURS + hashlib.sha256(body).hexdigest().encode()).ljust(_HEADER_SIZE)


def _column(values: list[Any]) -> NDArray[Any]:
    return _cells(values) if isinstance(values[0], str) else np.array(values)[:, np.newaxis]


def _cells(texts: Any) -> NDArray[np.object_]:  # noqa: ANN401 - a list of str
    return np.array(texts, dtype=object)[:, np.newaxis]
