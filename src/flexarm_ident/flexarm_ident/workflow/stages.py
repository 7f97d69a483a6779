"""Stages from records to a validated, reduced model: preprocess, identify, reduce, validate.

Preprocess every record (section 2.5), identify on its leading part, reduce and update (chapter 3),
validate on the whole of it (section 2.4).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.diagnostics.quality import graded
from flexarm_ident.estimation.pipeline import (
    excerpt,
    identify,
    leading,
    validate_stream,
    without_bias,
)
from flexarm_ident.estimation.simulation_fit import is_compensated
from flexarm_ident.fitting.validation import (
    LAW_OUTPUTS,
    mean_error,
    recover_gains,
    validate_dmv,
    validate_sfv,
)
from flexarm_ident.friction.dry_friction import refer_friction
from flexarm_ident.friction.first_motion import validate_with_friction
from flexarm_ident.records.data_warning import Grade
from flexarm_ident.records.iodata import IoData, as_records
from flexarm_ident.records.preprocess import preprocess
from flexarm_ident.records.span import measured
from flexarm_ident.records.unknown_inputs import known_parts
from flexarm_ident.reduction.modal import reduce_model
from flexarm_ident.workflow.outcome import Outcome
from flexarm_ident.workflow.request import FEEDTHROUGH

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.estimation.identification import Identification
    from flexarm_ident.fitting.validation import Dmv, Sfv
    from flexarm_ident.friction.dry_friction import DryFriction
    from flexarm_ident.records.source import Source
    from flexarm_ident.reduction.modal import Reduction
    from flexarm_ident.workflow.request import Request

# The chosen reduced order may cost this much of the fit.
_REDUCTION_COST = 1.04
_SMALLEST_REDUCED_ORDER = 4


@dataclass(frozen=True, eq=False)
class _Record:
    """A preprocessed record, and the part of it that is in memory: all or a leading one."""

    whole: Source
    shown: IoData

    @property
    def is_streamed(self) -> bool:
        return self.whole is not self.shown

    def head(self, fraction: float) -> _Record:
        samples = max(1, round(fraction * len(self.whole)))
        shown = self.shown.head(samples)
        return _Record(leading(self.whole, samples) if self.is_streamed else shown, shown)


def run(
    records: IoData | Sequence[Source], request: Request, *, progress: Progress | None = None
) -> Outcome:
    """Identify, reduce, update and validate.

    Parameters
    ----------
    records : IoData or sequence of Source
        Records of one rig as measured. With one that is read in chunks, memory does not depend on
        their lengths; a reduction then uses the leading parts, and there is neither set-point
        following nor friction nor refinement.
    request : Request
        Options.
    progress : callable, optional
        Called with the name of the stage and the part of it that is done.

    Raises
    ------
    DataError
        If the records or their fitted parts are too short, or an input does not change in them.
    IdentificationError
        If the data or the request do not allow it.
    """
    report = progress or (lambda _stage, _fraction: None)
    given = [records] if isinstance(records, IoData) else records
    parts = [
        part
        for record in given
        for part in (_parts(record) if isinstance(record, IoData) else (record,))
    ]
    _check_known_modes(request, parts[0])
    prepared = [_prepared(part, request) for part in parts]
    shown = as_records([record.shown for record in prepared])
    trained = [record.head(request.train_fraction) for record in prepared]
    in_memory = [part for part in parts if isinstance(part, IoData)]
    # Compensated drives show no friction that a model could be fitted to: the thesis's own way.
    friction_wanted = request.friction and not is_compensated(in_memory)
    identification = _identify(trained, replace(request, friction=friction_wanted), progress)
    report("reduction", 0.0)
    reduction = _reduce(identification, request)
    report("validation", 0.0)
    full, friction = identification.model, identification.friction
    full_dmv = _validate(full, friction, identification.x0, prepared)
    if reduction is None:
        model, dmv = full, full_dmv
    else:
        model = reduction.model
        if friction is not None:
            friction = refer_friction(
                friction,
                (full, model),
                (identification.x0, reduction.x0),
                identification.linear_records,
            )
        dmv = _validate(model, friction, reduction.x0, prepared)
    powers = [_deviation_power(record.whole) for record in prepared]
    sfv, omitted = (None, []) if friction else _set_point_following(model, prepared[0], request)
    report("validation", 1.0)
    return Outcome(
        request=request,
        records=shown,
        samples=tuple(len(record.whole) for record in prepared),
        fitted=tuple(len(record.whole) for record in trained),
        identification=identification,
        reduction=reduction,
        friction=friction,
        full_dmv=full_dmv,
        dmv=dmv,
        full_dmv_errors=_joined_errors(full_dmv, powers),
        dmv_errors=_joined_errors(dmv, powers),
        sfv=sfv,
        warnings=_warnings(identification, reduction, omitted),
    )


def _warnings(
    identification: Identification, reduction: Reduction | None, omitted: Sequence[str]
) -> tuple[str, ...]:
    """Return all notes with their grades; those on a reduction change what was asked for."""
    others = [(Grade.INFORMATION, note) for note in (*identification.notes, *omitted)]
    others += [(Grade.CAUTION, note) for note in (reduction.warnings if reduction else ())]
    return graded(identification.data_warnings, others)


def _parts(record: IoData) -> tuple[IoData, ...]:
    """Return the parts of a record in which the rig can be simulated from their first rows on."""
    return tuple(map(measured, known_parts(measured(record))))


def _check_known_modes(request: Request, record: Source) -> None:
    nyquist_hz = 0.5 / record.dt_s
    for hz in request.known_modes_hz:
        if hz >= nyquist_hz:
            raise IdentificationError(
                f"{record.label}: a known mode of {hz:g} Hz does not show in samples at "
                f"{2.0 * nyquist_hz:g} Hz: leave out what is not below {nyquist_hz:g} Hz "
                "(known_modes_hz, --known-mode)"
            )


def _prepared(record: Source, request: Request) -> _Record:
    if isinstance(record, IoData):
        data = preprocess(
            record,
            compensation="remove" if request.remove_compensation else "keep",
            bias=request.bias,
            cutoff_hz=request.cutoff_hz or None,
            filter_input=request.filter_input,
        )
        return _Record(data, data)
    whole = without_bias(record)
    return _Record(whole, excerpt(whole))


def _identify(
    trained: Sequence[_Record], request: Request, progress: Progress | None
) -> Identification:
    found = identify(
        [record.whole for record in trained],
        order=request.order,
        singular_value_threshold=request.singular_value_threshold,
        block_rows=request.block_rows,
        method=request.method,
        stable=request.stabilise,
        feedthrough=FEEDTHROUGH[request.feedthrough],
        friction=request.friction,
        refine=request.refine,
        progress=progress,
    )
    if not any(record.is_streamed for record in trained):
        return found
    samples = sum(len(record.whole) for record in trained)
    held = sum(len(record.shown) for record in trained)
    note = (
        f"{samples} samples were fitted in pieces: a chosen method or order, the modes' weights "
        f"and a reduction are from the first {held}; no search for friction, no refinement"
    )
    return replace(found, notes=(*found.notes, note))


def _validate(
    model: control.StateSpace,
    friction: DryFriction | None,
    x0: Sequence[FloatArray],
    records: Sequence[_Record],
) -> tuple[Dmv, ...]:
    found = []
    for record, start in zip(records, x0, strict=True):
        if friction is not None:
            found.append(validate_with_friction(model, friction, record.shown, start))
        elif record.is_streamed:
            found.append(validate_stream(model, record.whole, start))
        else:
            found.append(validate_dmv(model, record.shown))
    return tuple(found)


def _deviation_power(record: Source) -> FloatArray:
    """Return the sum of squares of each output about its mean, (outputs,)."""
    power, total, count = np.zeros((3, len(record.outputs)))
    for _, y in record.chunks(1 << 14):
        power += np.nansum(y**2, axis=0)
        total += np.nansum(y, axis=0)
        count += np.count_nonzero(~np.isnan(y), axis=0)
    return np.asarray(power - total**2 / np.maximum(count, 1.0))


def _joined_errors(dmv: Sequence[Dmv], powers: Sequence[FloatArray]) -> FloatArray:
    """Return the errors over all records together, from those of each and the outputs' power."""
    if len(dmv) == 1:
        return dmv[0].error
    deltas = np.array([each.error for each in dmv])
    # An output that is constant in one record may vary in another.
    known = ~np.isnan(deltas)
    power = np.where(known, powers, 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        missed = np.where(known, deltas**2 * power, 0.0)
        error = np.sqrt(missed.sum(axis=0) / power.sum(axis=0))
    return np.where(known.any(axis=0), np.where(np.isfinite(error), error, np.inf), np.nan)


def _reduce(identification: Identification, request: Request) -> Reduction | None:
    if request.reduction == "none":
        return None
    records = identification.linear_records

    def reduced(order: int) -> Reduction:
        return reduce_model(
            identification,
            records,
            ranking=request.reduction,  # type: ignore[arg-type]
            order=order,
            known_modes_hz=request.known_modes_hz,
            update=request.update,  # type: ignore[arg-type]
        )

    if request.reduced_order is not None:
        if request.reduced_order > identification.order:
            return _noted(reduced(identification.order), request.reduced_order)
        return reduced(request.reduced_order)
    affordable = _REDUCTION_COST * _fit_error(identification.model, records)
    smallest = min(
        identification.order, max(_SMALLEST_REDUCED_ORDER, 2 * len(request.known_modes_hz))
    )
    for order in range(smallest, identification.order):
        candidate = reduced(order)
        # With pairs alone left it has one state more: it is that of the next order.
        if candidate.order == order and _fit_error(candidate.model, records) <= affordable:
            return candidate
    return reduced(identification.order)


def _noted(whole: Reduction, asked: int) -> Reduction:
    note = (
        f"the whole model was kept: the data gave {whole.order} states, {asked} were to be kept; "
        "a longer record or a stronger excitation shows more"
    )
    return replace(whole, warnings=(note, *whole.warnings))


def _fit_error(model: control.StateSpace, records: Sequence[IoData]) -> float:
    return float(np.mean([mean_error(validate_dmv(model, record).error) for record in records]))


def _set_point_following(
    model: control.StateSpace, record: _Record, request: Request
) -> tuple[Sfv | None, list[str]]:
    if record.shown.reference is None or not set(LAW_OUTPUTS) <= set(record.shown.outputs):
        return None, []
    law = recover_gains(record.shown)
    if law is None:
        why = "no linear law of position, speed and middle strain made the recorded effort"
        if request.cutoff_hz and not request.filter_input:
            why = "the controller used the unfiltered outputs; --cutoff 0 takes these"
        return None, [f"no set-point following validation: {why}"]
    try:
        return validate_sfv(model, record.shown, law), []
    except IdentificationError as error:
        return None, [f"no set-point following validation: {error}"]
