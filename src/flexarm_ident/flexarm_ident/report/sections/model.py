"""Model section: method, downloads, and provenance."""

from __future__ import annotations

import base64
import json
from typing import TYPE_CHECKING, Any

from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.models.files import FORMATS
from flexarm_ident.models.model_parameters import model_fields
from flexarm_ident.report.content.blocks import (
    Code,
    Download,
    Downloads,
    Facts,
    Heading,
    Section,
    Words,
)
from flexarm_ident.report.content.wording import error_text

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_RANKINGS = {
    "mrm": "largest modal response (MRM)",
    "msv": "largest mode singular value (MSV)",
    "mrmc": "known flexible modes first, then largest modal response (MRMC)",
}
_UPDATES = {"none": "nothing was refitted", "b": "B was refitted", "c": "C was refitted"}
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


def _build(subject: Subject) -> Iterator[Block]:
    yield _making(subject.outcome)
    yield Heading("Downloads")
    yield _downloads(subject)
    if subject.files:
        yield Words(f"Written by the identification: {', '.join(subject.files)}.")
    file = f"{subject.name}.yaml"
    yield Code(f'from flexarm_ident import load_model; model = load_model("{file}")')
    yield Code(f"ros2 run flexarm_ident ident_node --ros-args --params-file {file}")
    yield Heading("Provenance")
    yield _origin(subject)


SECTION = Section(110, "The model", _build)


def _making(outcome: Outcome) -> Facts:
    """Return the method and the choices that made the model."""
    identification = outcome.identification
    facts = {
        "method": identification.title,
        "block rows": str(identification.block_rows),
        "full order": str(identification.order),
        "sampling period": f"{outcome.model.dt:.6g} s",
        "eigenvalues moved into the unit circle": str(identification.moved_eigenvalues),
    }
    if identification.choice:
        facts["reason for the method"] = identification.choice
    if identification.start_error is not None:
        by = "simulation" if identification.likelihood is None else "maximum likelihood"
        facts[f"fitted by {by}"] = (
            f"mean δ of the fitted part {error_text(mean_error(identification.fit_error))}, "
            f"of the subspace model before {error_text(mean_error(identification.start_error))}"
        )
    if outcome.reduction:
        facts["reduction"] = (
            f"{_RANKINGS[outcome.request.reduction]}; {_UPDATES[outcome.request.update]}"
        )
        facts["kept states"] = ", ".join(outcome.reduction.kept)
    return Facts(tuple(facts.items()))


def _downloads(subject: Subject) -> Downloads:
    """Return the model in every format, to the last bit."""
    found = []
    for suffix, each in FORMATS.items():
        content = each.encode(subject.name, subject.parameters)
        text = base64.b64encode(content).decode("ascii")
        uri = f"data:{_MEDIA[suffix]};base64,{text}"
        file = f"{subject.name}{suffix}"
        found.append(Download(file, _USES[suffix], max(len(content) / 1000.0, 1.0), uri))
    return Downloads(tuple(found))


def _origin(subject: Subject) -> Facts:
    """Return the records with their hashes, the request, the versions and the model's hash."""
    fields: dict[str, Any] = model_fields(subject.name, subject.parameters)
    facts = []
    for source, digest in zip(fields["source"], fields["source_sha256"], strict=True):
        facts += [("record", source), ("SHA-256 of its samples", digest)]
    request = json.loads(fields["request"])
    asked = ", ".join(f"{key} {_words(value)}" for key, value in request.items())
    facts += [
        ("request", asked),
        ("versions", fields["versions"]),
        ("hash of the model", fields["hash"]),
    ]
    return Facts(tuple(facts))


def _words(value: object) -> str:
    if value is None:
        return "chosen"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return str(value)
