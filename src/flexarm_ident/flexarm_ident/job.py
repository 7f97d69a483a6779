"""Identification job: from bags to a folder with the model and its report."""

from __future__ import annotations

import re
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_core.errors import DataError
from flexarm_core.outputs import HEAD_BYTES, is_replaceable, require_place
from flexarm_ident.fitting.blas import one_thread
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.friction.dry_friction import friction_fields
from flexarm_ident.importing.csv_columns import TableColumns
from flexarm_ident.importing.csv_layout import is_table
from flexarm_ident.importing.csv_map import CsvMap
from flexarm_ident.importing.csv_record import read_csv
from flexarm_ident.models.files import FORMATS, save_model
from flexarm_ident.models.model_parameters import model_parameters
from flexarm_ident.provenance import model_provenance
from flexarm_ident.reading.read import (
    begin_date,
    read_bag,
    read_channels,
    sample_count,
    stream_bag,
)
from flexarm_ident.records.span import EVERYTHING, Span
from flexarm_ident.report.content.blocks import Subject
from flexarm_ident.report.page import render_report
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.models.model_parameters import ParameterValue
    from flexarm_ident.reading.channels import Selection
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source
    from flexarm_ident.workflow.outcome import Outcome
    from flexarm_ident.workflow.request import Request

    Chosen = Selection | CsvMap | TableColumns | None
    Read = Callable[[Path, Request, Chosen, Span], Source]

LARGEST_IN_MEMORY = 1_000_000
"""Samples of a bag from which it is read in pieces, each time it is gone through."""
MODEL_FILE = "model.yaml"
REPORT_FILE = "report.html"
# End of each stage as a part of the whole: rough shares of the time.
_ENDS = {
    "reading": 0.05,
    "Hankel matrices": 0.1,
    "subspace": 0.12,
    "order": 0.3,
    "fit": 0.35,
    "friction": 0.6,
    "refinement": 0.75,
    "reduction": 0.85,
    "validation": 0.92,
    "writing": 1.0,
}
_SMALLEST_PART = 0.01
_STARTS = dict(zip(_ENDS, (0.0, *_ENDS.values()), strict=False))


def whole(progress: Progress) -> Progress:
    """Return a callback for stages that reports the part of the whole that is done.

    It reports news alone: a stage that begins, or another per cent. Nothing goes back: the part
    never falls, and a stage that was left is not named again. One of unknown share leaves the part
    unchanged.
    """
    stages = [""]
    done = reported = 0.0

    def report(stage: str, fraction: float) -> None:
        nonlocal done, reported
        if stage in _ENDS:
            start, end = _STARTS[stage], _ENDS[stage]
            done = max(done, start + (end - start) * min(max(fraction, 0.0), 1.0))
        is_new = stage not in stages
        if is_new:
            stages.append(stage)
        if is_new or done >= min(reported + _SMALLEST_PART, 1.0) > reported:
            reported = done
            progress(stages[-1], done)

    return report


def model_name(bag: Path) -> str:
    """Return the name of a bag with the characters that a parameter's name may have."""
    return re.sub(r"\W", "_", bag.resolve().stem) or "model"


def model_in(folder: Path) -> str:
    """Return the name of the model whose results stand in a folder; empty without any."""
    file = folder / MODEL_FILE
    if not (file.is_file() and is_replaceable(file)):
        return ""
    with file.open("rb") as stream:
        head = stream.read(HEAD_BYTES)
    found = re.search(rb"^ +models:\n +(\w+):$", head, re.MULTILINE)
    return found[1].decode() if found else ""


@one_thread()
def identify_bags(
    bags: Sequence[Path],
    folder: Path,
    request: Request,
    *,
    channels: Chosen = None,
    span: Span = EVERYTHING,
    exports: Sequence[str] = (),
    force: bool = False,
    read: Read | None = None,
    found: Callable[[str, Outcome], None] = lambda _name, _outcome: None,
    progress: Progress = lambda _stage, _fraction: None,
) -> Results:
    """Read bags, identify one model, and write it with its report.

    A bag of more than `LARGEST_IN_MEMORY` samples is read in pieces, so that memory does not grow
    with its length; see `workflow.stages.run` for the restrictions.

    Parameters
    ----------
    bags : sequence of Path
        Bags of one rig, one or more. The first one names the model.
    folder : Path
        Folder of the results, see `write_results`.
    request : Request
        Options.
    channels : Selection, CsvMap or TableColumns, optional
        Inputs and outputs among the topics of bags that other programs recorded, or the columns of
        CSV files. None: the bags hold samples of flexarm's own types. Chosen channels are read
        whole.
    span : Span
        Part of each record that is used. A record of which a part is used is read whole.
    exports : sequence of str
        Suffixes of further formats, see `models.files.parse_exports`.
    force : bool
        Files of these names that flexarm did not write are replaced too.
    read : callable, optional
        Reads a bag in the place of `read_record`, for a caller that keeps records.
    found : callable
        Called with the name of the model and its identification before they are written.
    progress : callable
        Called with the stage and the part of the whole that is done. An exception from it ends the
        job without a file.

    Raises
    ------
    IdentificationError
        If the bags or the request do not allow an identification.
    OutputError
        If the folder cannot be written, or has a file of these names from somebody else; found
        before the work.
    """
    require_place(result_files(folder, exports), force=force)
    report = whole(progress)
    taken = read or read_record
    measured, outcome = _identified(
        bags, request, report, lambda bag: taken(bag, request, channels, span)
    )
    name = model_name(bags[0])
    found(name, outcome)
    parameters = write_results(
        folder,
        outcome,
        measured,
        name=name,
        exports=exports,
        force=force,
        begun=begun(bags[0]),
        before_commit=lambda: report("writing", 1.0),
    )
    return Results(name, folder, outcome, parameters)


@one_thread()
def report_bags(
    bags: Sequence[Path],
    file: Path,
    request: Request,
    *,
    channels: Chosen = None,
    span: Span = EVERYTHING,
    force: bool = False,
    progress: Progress = lambda _stage, _fraction: None,
) -> Results:
    """Identify as `identify_bags` does, and write the report alone, with the model inside.

    Parameters
    ----------
    file : Path
        HTML file. The other parameters and the errors are those of `identify_bags`.
    """
    require_place([file], force=force)
    report = whole(progress)
    measured, outcome = _identified(
        bags, request, report, lambda bag: read_record(bag, request, channels, span)
    )
    name = model_name(bags[0])
    subject, _ = _subject(name, outcome, measured)
    page = render_report(replace(subject, begun=begun(bags[0])), title=_title(name))
    with _staging(file) as staging:
        staged = staging / REPORT_FILE
        staged.write_text(page, encoding="utf-8")
        report("writing", 1.0)
        staged.replace(file)
    return Results(name, file.parent, outcome, dict(subject.parameters))


def write_results(
    folder: Path,
    outcome: Outcome,
    measured: Sequence[Source],
    *,
    name: str,
    exports: Sequence[str] = (),
    force: bool = False,
    begun: str = "",
    before_commit: Callable[[], None] = lambda: None,
) -> dict[str, ParameterValue]:
    """Write `model.yaml`, ready for `--params-file`, `report.html`, and further formats.

    Everything is written beside the folder first. A new folder appears complete or not at all; in
    an existing one, files of an earlier identification are replaced and others stay.

    Parameters
    ----------
    folder : Path
        Created when it is missing.
    outcome : Outcome
        The identification.
    measured : sequence of Source
        The records before any processing; their hashes are written beside the model.
    name : str
        Name of the model.
    exports : sequence of str
        Suffixes of `models.files.FORMATS` beside `.yaml`.
    force : bool
        Files of these names that flexarm did not write are replaced too.
    begun : str
        Instant at which the first record begins, see `reading.read.begin_date`.
    before_commit : callable
        Called when all is written but nothing is in its place; an exception leaves no trace.

    Returns
    -------
    dict
        The model as flat parameters `models.<name>.*`.

    Raises
    ------
    ModelFileError
        When the model cannot be written in one of the formats.
    OutputError
        When the folder cannot be written, or has a file of these names from somebody else.
    """
    *model_files, _ = files = result_files(folder, exports)
    require_place(files, force=force)
    subject, provenance = _subject(name, outcome, measured)
    place = folder.absolute().name
    listed = replace(subject, files=[f"{place}/{file.name}" for file in model_files], begun=begun)
    report = render_report(listed, title=_title(name))
    with _staging(folder) as staging:
        for file in model_files:
            save_model(staging / file.name, outcome.model, name=name, provenance=provenance)
        (staging / REPORT_FILE).write_text(report, encoding="utf-8")
        before_commit()
        _commit(staging, folder)
    return dict(subject.parameters)


def result_files(folder: Path, exports: Sequence[str]) -> list[Path]:
    """Return the files of `write_results`: the model in its formats, and last the report."""
    model = folder / MODEL_FILE
    return [model, *map(model.with_suffix, exports), folder / REPORT_FILE]


def _identified(
    bags: Sequence[Path],
    request: Request,
    report: Progress,
    read: Callable[[Path], Source],
) -> tuple[list[Source], Outcome]:
    """Return the records as measured, and the outcome of their identification."""
    measured: list[Source] = []
    for done, bag in enumerate(bags):
        report("reading", done / len(bags))
        measured.append(read(bag))
    outcome = run(measured, request, progress=report)
    report("writing", 0.0)
    return measured, outcome


def read_record(bag: Path, request: Request, channels: Chosen, span: Span = EVERYTHING) -> Source:
    """Return the record of a bag as measured; arguments and errors as in `identify_bags`."""
    # In pieces, a record is prepared in the default way alone.
    usual = request.remove_compensation and request.bias == "rest" and not request.cutoff_hz
    may_stream = usual and span.is_whole and channels is None and not is_table(bag)
    if may_stream and sample_count(bag) > LARGEST_IN_MEMORY:
        return stream_bag(bag, wrap=span.wrap)
    return read_whole(bag, channels, span)


def read_whole(bag: Path, channels: Chosen, span: Span = EVERYTHING) -> IoData:
    """Return the record of a bag or a CSV file in memory; arguments as in `identify_bags`."""
    if isinstance(channels, (CsvMap, TableColumns)):
        if is_table(bag):
            return span.of(read_csv(bag, channels, wrap=span.wrap))
        # A bag beside tables has names of its own.
        channels = None
    if is_table(bag):
        raise DataError(f"{bag}: say which of its columns is what (--input, --output, --map)")
    if channels is None:
        return span.of(read_bag(bag, wrap=span.wrap))
    return span.of(read_channels(bag, channels, wrap=span.wrap))


def begun(bag: Path) -> str:
    """Return the instant at which a record begins, as `begin_date`; empty for a CSV file."""
    return "" if is_table(bag) else begin_date(bag)


def _subject(
    name: str, outcome: Outcome, measured: Sequence[Source]
) -> tuple[Subject, dict[str, str | list[str] | list[float]]]:
    """Return the subject of the report, and the provenance of the model."""
    provenance = model_provenance(outcome, measured) | friction_fields(outcome.friction)
    parameters = model_parameters(name, outcome.model, provenance=provenance)
    return Subject(outcome, name, parameters), provenance


def _title(name: str) -> str:
    return f"Identification of {name}"


@contextmanager
def _staging(target: Path) -> Iterator[Path]:
    """Yield a folder beside the target, for files that are moved when they are complete."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as beside:
        # A folder inside has the usual permissions.
        staging = Path(beside, "results")
        staging.mkdir()
        yield staging


def _commit(staging: Path, folder: Path) -> None:
    if not folder.exists():
        staging.rename(folder)
        return
    for suffix in FORMATS:
        # A format of an earlier model would contradict the new ones.
        stale = (folder / MODEL_FILE).with_suffix(suffix)
        if not (staging / stale.name).exists() and is_replaceable(stale):
            stale.unlink(missing_ok=True)
    for file in staging.iterdir():
        file.replace(folder / file.name)


@dataclass(frozen=True, eq=False)
class Results:
    """An identified model and its folder.

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
    outcome: Outcome
    parameters: dict[str, ParameterValue]

    @property
    def dmv(self) -> tuple[float, ...]:
        """Data matching errors (2-25) of the outputs, and their mean."""
        return _with_mean(self.outcome.dmv_errors)

    @property
    def left_out(self) -> tuple[float, ...]:
        """Errors on blocks that were left out of the fit, likewise; empty where there are none."""
        found = self.outcome.cross_validation
        return () if found is None else _with_mean(found.error)

    @property
    def frequency_std_hz(self) -> tuple[float, ...]:
        """Standard deviations of the modes' frequencies, where the errors are noise."""
        known = self.outcome.identification.known_deviations
        return tuple(each.frequency_std_hz for each in known)

    @property
    def sfv(self) -> tuple[float, ...]:
        """Set-point following errors, likewise; empty without a recorded reference."""
        found = self.outcome.sfv
        return () if found is None else _with_mean(found.error)

    def text(self, elapsed_s: float) -> str:
        """Return the identification in one line, with the time that it took."""
        outcome = self.outcome
        order, states = outcome.identification.order, outcome.model.nstates
        return (
            f"{outcome.verdict} {self.name}: order {order}"
            + (f" reduced to {states}" if states < order else "")
            + (" with dry friction" if outcome.friction else "")
            + f", relative error {self.dmv[-1]:.4f} (DMV), {elapsed_s:.1f} s"
            + (f"; {outcome.identification.choice}" if outcome.identification.choice else "")
        )


def _with_mean(errors: FloatArray) -> tuple[float, ...]:
    return (*errors.tolist(), mean_error(errors))
