"""Reader of a MAT-file as a program of its own, since a damaged file can kill scipy's.

It takes the file from its standard input and writes one JSON object: the `tree` of a model's
parameters, or an `error`. It imports nothing of flexarm, and takes little memory and time.
"""

from __future__ import annotations

import io
import json
import resource
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

if TYPE_CHECKING:
    from collections.abc import Mapping

MATRICES = ("A", "B", "C", "D")
NAMES = ("input_names", "output_names")
VARIABLES = (*MATRICES, "dt", *NAMES, "name", "hash")
_MEMORY_BYTES = 512 << 20
_CPU_S = 20


class VariableError(Exception):
    """A variable of a model is missing."""


def tree(content: bytes) -> dict[str, object]:
    """Return the nested parameters of the one model in a MAT-file; whatever scipy raises."""
    stream: Any = io.BytesIO(content)
    variables = scipy.io.loadmat(stream)
    for variable in VARIABLES:
        if variable not in variables:
            raise VariableError(f"variable {variable} is missing")
    fields: dict[str, object] = {key.lower(): _list(variables[key]) for key in MATRICES}
    fields |= {key: [_scalar(cell) for cell in variables[key].ravel()] for key in NAMES}
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


def answer(content: bytes) -> str:
    """Return a JSON object: the tree of a file, or its error."""
    try:
        # A matrix of complex numbers is none: a list of texts says so.
        return json.dumps({"tree": tree(content)}, default=str)
    except VariableError as error:
        return json.dumps({"error": str(error)})
    except Exception as error:  # noqa: BLE001 - a damaged file makes scipy raise almost anything
        text = " ".join(str(error).split()) or type(error).__name__
        return json.dumps({"error": f"no MAT-file of version 5: {text}"})


def main() -> None:
    """Read, within bounds of this process, and answer."""
    pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
    allowed = pages * resource.getpagesize() + _MEMORY_BYTES
    for limit, most in (
        (resource.RLIMIT_AS, allowed),
        (resource.RLIMIT_CPU, _CPU_S),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(limit, (most, most))
    sys.stdout.write(answer(sys.stdin.buffer.read()))


if __name__ == "__main__":
    main()
