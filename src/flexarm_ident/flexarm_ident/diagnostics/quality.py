"""Quality warnings of records, with their names, grades and figures."""

from __future__ import annotations

from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING

from flexarm_ident.diagnostics.change import changes, differences
from flexarm_ident.diagnostics.channel_defects import channel_defects, offsets
from flexarm_ident.diagnostics.drive import drive_defects
from flexarm_ident.diagnostics.excitation import excited_bands, richness
from flexarm_ident.diagnostics.input_answer import answer_defects, static_outputs
from flexarm_ident.diagnostics.outliers import outliers
from flexarm_ident.diagnostics.quantisation import quantisation
from flexarm_ident.records.iodata import DataWarning, Grade
from flexarm_ident.records.naming import short_names
from flexarm_ident.subspace.feedback import feedback_test, reaches_inputs
from flexarm_ident.subspace.gram import block_gram

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram

_OF_ONE_RECORD = (
    channel_defects,
    outliers,
    quantisation,
    drive_defects,
    excited_bands,
    answer_defects,
    changes,
)

# Figure of the notices of changes that a bag of our own rig tells, see `reading.told_changes`.
_AT = "at_s"


def assess(
    records: Sequence[IoData], gram: BlockGram, *, feedthrough: bool = False
) -> tuple[DataWarning, ...]:
    """Return the defects of an identification's data; none for good data.

    Parameters
    ----------
    records : sequence of IoData
        Records of one rig.
    gram : BlockGram
        Their Gram, of as many block rows as the identification uses.
    feedthrough : bool
        Whether D is fitted.

    Returns
    -------
    tuple of DataWarning
        ``feedback``, ``input_condition``, ``too_short``, ``plant_differs`` once; for each record
        its notices, such as ``lost_samples`` and ``clock_jitter`` from a bag, ``few_moves``,
        ``held_drive``, ``plant_changed`` and ``law_changed``; and for each of its channels
        ``constant_channel``, ``offset``, ``saturation``, ``dead_sensor``, ``unmeasured``,
        ``duplicated_channel``, ``outliers``, ``quantisation``, ``excitation_band``, ``delay``,
        ``static_gain`` and ``no_answer``.
    """
    found = [*_feedback(records, gram, feedthrough=feedthrough), *richness(gram, records)]
    found += differences(records)
    names_of = short_names([record.label for record in records])
    for record in records:
        of_one = [each for look in _OF_ONE_RECORD for each in look(record)]
        notices = [each for each in record.notices if _AT not in each.figures]
        found += [replace(each, record=names_of[record.label]) for each in (*notices, *of_one)]
    wholes = [list(parts) for _, parts in groupby(records, lambda each: each.part_of or id(each))]
    labels = [parts[0].part_of or parts[0].label for parts in wholes]
    names = short_names(labels)
    of_wholes, inexact = [], set()
    for label, parts in zip(labels, wholes, strict=True):
        told = list(_told(parts))
        # What a bag tells of a change is exact, and what the signals show of it is not.
        inexact |= {(names_of[part.label], each.name) for part in parts for each in told}
        of_wholes += [replace(each, record=names[label]) for each in (*told, *offsets(parts))]
    return (*(each for each in found if (each.record, each.name) not in inexact), *of_wholes)


def _told(parts: Sequence[IoData]) -> Iterator[DataWarning]:
    """Yield the changes that a bag tells within the parts of a record, or in a hole between them.

    The notices are those of the whole record, of which this may be a span.
    """
    dt_s, begin_s = parts[0].dt_s, parts[0].begins_s
    end_s = parts[-1].begins_s + len(parts[-1]) * dt_s
    for each in parts[0].notices:
        # A change at an end is none within.
        if begin_s + 0.5 * dt_s < each.figures.get(_AT, begin_s) < end_s - 0.5 * dt_s:
            yield each


def _feedback(
    records: Sequence[IoData], gram: BlockGram, *, feedthrough: bool
) -> Iterator[DataWarning]:
    declared = any(record.closed_loop for record in records)
    if not declared:
        # The answer of an output without dynamics cannot be told from that of a controller.
        static = {name for record in records for name in static_outputs(record)}
        dynamic = [name for name in records[0].outputs if name not in static]
        if not dynamic:
            return
        if static:
            records = [_with_outputs(record, dynamic) for record in records]
            gram = block_gram(records, gram.block_rows)
    test = feedback_test(records, gram, feedthrough=feedthrough)
    if not (test.detected or declared):
        return
    figures = {
        "statistic": test.statistic,
        "degrees": float(test.degrees),
        "p_value": test.p_value,
        "background": test.background,
    }
    biased = "plain ORSE is biased, and a small bias remains with the other methods"
    usual = f"chi-square {test.statistic:.0f} where {test.degrees} is usual"
    if not test.detected:
        text = "closed-loop data: the record states it, and its noise is too small to tell; "
    elif declared or reaches_inputs(gram):
        though = "" if declared else ", though no loop is declared"
        text = f"closed-loop data: the inputs correlate with the outputs' noise, {usual}{though}; "
    else:
        # What the choice of a method asks as well: later inputs.
        biased = "fit D in the former case (feedthrough); a small bias remains in the latter"
        text = (
            "an output follows the input within a sample, or a controller answers within one: the "
            f"inputs of the same sample correlate with the outputs' noise, {usual}, later ones do "
            "not; "
        )
    yield DataWarning(
        "feedback",
        text + biased,
        figures,
        grade=Grade.INFORMATION if declared else Grade.CAUTION,
    )


def _with_outputs(record: IoData, names: Sequence[str]) -> IoData:
    """Return a record with some of its outputs."""
    columns = [record.outputs.index(name) for name in names]
    missing = None if record.missing is None else record.missing[:, columns]
    return replace(record, y=record.y[:, columns], outputs=tuple(names), missing=missing)
