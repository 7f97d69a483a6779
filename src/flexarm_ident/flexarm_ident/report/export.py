"""The model inside a report: files to take out of it, how to read them, and where it came from."""

from __future__ import annotations

import base64
import json
from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_ident.models.files import FORMATS
from flexarm_ident.models.model_parameters import model_fields

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexarm_ident.models.model_parameters import ParameterValue

_USES = {
    ".yaml": "ROS parameters, for --params-file and load_model",
    ".json": "the same as JSON, for load_model and other programs",
    ".mat": "MATLAB and Octave, for load_model too",
    ".h": "C and C++ constants",
}
_MEDIA = {
    ".yaml": "application/yaml",
    ".json": "application/json",
    ".mat": "application/octet-stream",
    ".h": "text/plain",
}


class Download(NamedTuple):
    """A file inside a report: its name, what it is for, its size in kB, and its content as URI."""

    file: str
    use: str
    size_kb: float
    uri: str


def downloads(name: str, parameters: Mapping[str, ParameterValue]) -> list[Download]:
    """Return a model in every format, to the last bit.

    Parameters
    ----------
    name : str
        Name of the model.
    parameters : mapping
        Its flat parameters, see `model_parameters`.

    Returns
    -------
    list of Download
        One per format of `exports.FORMATS`.
    """
    found = []
    for suffix, each in FORMATS.items():
        content = each.encode(name, parameters)
        text = base64.b64encode(content).decode("ascii")
        uri = f"data:{_MEDIA[suffix]};base64,{text}"
        found.append(Download(f"{name}{suffix}", _USES[suffix], len(content) / 1000.0, uri))
    return found


def loading_lines(name: str) -> tuple[str, str]:
    """Return what reads the downloaded model in Python and gives it to a node."""
    return (
        f'from flexarm_ident import load_model; model = load_model("{name}.yaml")',
        f"ros2 run flexarm_ident ident_node --ros-args --params-file {name}.yaml",
    )


def provenance(name: str, parameters: Mapping[str, ParameterValue]) -> list[tuple[str, str]]:
    """Return where a model came from, as pairs of words.

    Parameters
    ----------
    name, parameters
        As in `downloads`, with the fields of `model_provenance`.

    Returns
    -------
    list of pair of str
        Records with their hashes, request, versions and the model's hash.
    """
    fields: dict[str, Any] = model_fields(name, parameters)
    pairs = []
    for source, digest in zip(fields["source"], fields["source_sha256"], strict=True):
        pairs += [("record", source), ("SHA-256 of its samples", digest)]
    request = json.loads(fields["request"])
    asked = ", ".join(f"{key} {_words(value)}" for key, value in request.items())
    return [
        *pairs,
        ("request", asked),
        ("versions", fields["versions"]),
        ("hash of the model", fields["hash"]),
    ]


def _words(value: object) -> str:
    if value is None:
        return "chosen"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return str(value)
