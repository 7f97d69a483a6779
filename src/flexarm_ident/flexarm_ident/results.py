"""What an identification leaves behind: a parameter file, exports and a report in a folder."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_ident.friction.friction_parameters import friction_fields
from flexarm_ident.models.files import FORMATS, save_model
from flexarm_ident.models.model_parameters import model_parameters
from flexarm_ident.provenance import model_provenance
from flexarm_ident.report.page import render_report

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_ident.models.model_parameters import ParameterValue
    from flexarm_ident.records.source import Source
    from flexarm_ident.workflow.workflow import Outcome

MODEL_FILE = "model.yaml"
REPORT_FILE = "report.html"


def write_results(
    folder: Path,
    outcome: Outcome,
    measured: Sequence[Source],
    *,
    name: str,
    exports: Sequence[str] = (),
    before_commit: Callable[[], None] = lambda: None,
) -> dict[str, ParameterValue]:
    """Write `model.yaml`, ready for `--params-file`, `report.html`, and further formats.

    Everything is written beside the folder first. A new folder appears complete or not at all; in
    one that is there, files of an earlier identification are replaced and others stay.

    Parameters
    ----------
    folder : Path
        Created when it is missing.
    outcome : Outcome
        The identification.
    measured : sequence of Source
        The records as they were read; their hashes are written beside the model.
    name : str
        Name of the model.
    exports : sequence of str
        Suffixes of `exports.FORMATS` beside `.yaml`.
    before_commit : callable
        Called when all is written but nothing is in its place; may raise to leave no trace.

    Returns
    -------
    dict
        The model as flat parameters `models.<name>.*`.

    Raises
    ------
    ModelFileError
        When the model cannot be written in one of the formats.
    OSError
        When the folder cannot be written.
    """
    provenance = model_provenance(outcome, measured) | friction_fields(outcome.friction)
    parameters = model_parameters(name, outcome.model, provenance=provenance)
    model_files = [Path(MODEL_FILE), *(Path(MODEL_FILE).with_suffix(each) for each in exports)]
    report = render_report(
        outcome,
        title=_title(name),
        name=name,
        parameters=parameters,
        files=[str(file) for file in model_files],
    )
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as beside:
        # A folder inside has the usual permissions.
        staging = Path(beside, "results")
        staging.mkdir()
        for file in model_files:
            save_model(staging / file, outcome.model, name=name, provenance=provenance)
        (staging / REPORT_FILE).write_text(report, encoding="utf-8")
        before_commit()
        _commit(staging, folder)
    return parameters


def write_report(
    file: Path,
    outcome: Outcome,
    measured: Sequence[Source],
    *,
    name: str,
    before_commit: Callable[[], None] = lambda: None,
) -> dict[str, ParameterValue]:
    """Write nothing but the report; the model is inside it.

    Parameters
    ----------
    file : Path
        HTML file; its folder is created when it is missing.
    outcome, measured, name, before_commit
        As in `write_results`.

    Returns
    -------
    dict
        The model as flat parameters `models.<name>.*`.

    Raises
    ------
    OSError
        When the file cannot be written.
    """
    provenance = model_provenance(outcome, measured) | friction_fields(outcome.friction)
    parameters = model_parameters(name, outcome.model, provenance=provenance)
    report = render_report(outcome, title=_title(name), name=name, parameters=parameters)
    file.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{file.name}.", dir=file.parent) as beside:
        staged = Path(beside, REPORT_FILE)
        staged.write_text(report, encoding="utf-8")
        before_commit()
        staged.replace(file)
    return parameters


def _title(name: str) -> str:
    return f"Identification of {name}"


def _commit(staging: Path, folder: Path) -> None:
    if not folder.exists():
        staging.rename(folder)
        return
    for suffix in FORMATS:
        # A format of an earlier model would contradict the new ones.
        stale = (folder / MODEL_FILE).with_suffix(suffix)
        if not (staging / stale.name).exists():
            stale.unlink(missing_ok=True)
    for file in staging.iterdir():
        file.replace(folder / file.name)
