"""What an identification leaves behind: a parameter file and a report in a folder."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_ident.model_io import model_parameters, write_parameter_file
from flexarm_ident.report import render_report

if TYPE_CHECKING:
    from flexarm_ident.model_io import ParameterValue
    from flexarm_ident.workflow import Outcome

MODEL_FILE = "model.yaml"
REPORT_FILE = "report.html"


def model_name(outcome: Outcome) -> str:
    """Return the name of the first bag, as far as a parameter's name can hold it."""
    return re.sub(r"\W", "_", Path(outcome.records[0].source).stem) or "model"


def write_results(folder: Path, outcome: Outcome) -> dict[str, ParameterValue]:
    """Write `model.yaml`, ready for `--params-file`, and `report.html`.

    Parameters
    ----------
    folder : Path
        Created when it is missing; files of an earlier identification are replaced.
    outcome : Outcome
        The identification.

    Returns
    -------
    dict
        The model as flat parameters `models.<name>.*`.

    Raises
    ------
    OSError
        When the folder cannot be written.
    """
    name = model_name(outcome)
    provenance = {
        "source": ", ".join(record.source for record in outcome.records),
        "method": outcome.identification.method,
        "request": repr(outcome.request),
    }
    parameters = model_parameters(name, outcome.model, provenance=provenance)
    folder.mkdir(parents=True, exist_ok=True)
    write_parameter_file(folder / MODEL_FILE, parameters)
    facts = {"parameter file": MODEL_FILE, "hash": str(parameters[f"models.{name}.hash"])}
    text = render_report(outcome, title=f"Identification of {name}", facts=facts)
    (folder / REPORT_FILE).write_text(text, encoding="utf-8")
    return parameters
