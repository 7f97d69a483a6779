"""From bags to a folder of results: what the command, the service and the action do."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_ident.estimation import progress as stages
from flexarm_ident.reading.read import read_bag, sample_count, stream_bag
from flexarm_ident.results import write_report, write_results
from flexarm_ident.workflow import workflow

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from flexarm_ident.estimation.progress import Progress
    from flexarm_ident.models.model_parameters import ParameterValue
    from flexarm_ident.records.source import Source

LARGEST_IN_MEMORY = 1_000_000
"""Samples of a bag from which it is read in pieces, each time it is gone through."""


@dataclass(frozen=True, eq=False)
class Results:
    """An identified model and where it was written.

    Attributes
    ----------
    name : str
        Name of the model.
    folder : Path
        Folder of the files.
    outcome : Outcome
        The identification.
    parameters : dict
        The model as flat parameters `models.<name>.*`.
    """

    name: str
    folder: Path
    outcome: workflow.Outcome
    parameters: dict[str, ParameterValue]


def model_name(bag: Path) -> str:
    """Return the name of a bag, as far as a parameter's name can hold it."""
    return re.sub(r"\W", "_", bag.resolve().stem) or "model"


def identify_bags(
    bags: Sequence[Path],
    folder: Path,
    request: workflow.Request,
    *,
    exports: Sequence[str] = (),
    progress: Progress = lambda _stage, _fraction: None,
) -> Results:
    """Read bags, identify one model, and write it with its report.

    A bag of more than `LARGEST_IN_MEMORY` samples is read in pieces, so that memory does not grow
    with its length; see `workflow.run` for what that leaves out.

    Parameters
    ----------
    bags : sequence of Path
        Bags of one rig, one or more. The first one names the model.
    folder : Path
        Folder of the results, see `write_results`.
    request : Request
        What is to be done.
    exports : sequence of str
        Suffixes of further formats, see `exports.parse_exports`.
    progress : callable
        Called with the stage and the part of the whole that is done. What it raises ends the job
        and leaves no file.

    Returns
    -------
    Results
        The model and its files.

    Raises
    ------
    IdentificationError
        If the bags or the request do not allow an identification.
    OSError
        If the folder cannot be written.
    """
    report = stages.whole(progress)
    measured, outcome = _identified(bags, request, report)
    name = model_name(bags[0])
    parameters = write_results(
        folder,
        outcome,
        measured,
        name=name,
        exports=exports,
        before_commit=lambda: report("writing", 1.0),
    )
    return Results(name, folder, outcome, parameters)


def report_bags(
    bags: Sequence[Path],
    file: Path,
    request: workflow.Request,
    *,
    progress: Progress = lambda _stage, _fraction: None,
) -> Results:
    """Identify as `identify_bags` does, and write the report alone, with the model inside.

    Parameters
    ----------
    bags, request, progress
        As in `identify_bags`.
    file : Path
        HTML file.

    Returns
    -------
    Results
        The model and the folder of the file.

    Raises
    ------
    IdentificationError
        If the bags or the request do not allow an identification.
    OSError
        If the file cannot be written.
    """
    report = stages.whole(progress)
    measured, outcome = _identified(bags, request, report)
    name = model_name(bags[0])
    parameters = write_report(
        file, outcome, measured, name=name, before_commit=lambda: report("writing", 1.0)
    )
    return Results(name, file.parent, outcome, parameters)


def _identified(
    bags: Sequence[Path], request: workflow.Request, report: Progress
) -> tuple[list[Source], workflow.Outcome]:
    """Return the records as measured, and what was identified from them."""
    measured: list[Source] = []
    for done, bag in enumerate(bags):
        report("reading", done / len(bags))
        measured.append(_read(bag, request))
    outcome = workflow.run(measured, request, progress=report)
    report("writing", 0.0)
    return measured, outcome


def _read(bag: Path, request: workflow.Request) -> Source:
    # In pieces, the compensation is always removed.
    if request.remove_compensation and sample_count(bag) > LARGEST_IN_MEMORY:
        return stream_bag(bag)
    return read_bag(bag)
