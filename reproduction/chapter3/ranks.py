"""Tables 3-1a to 3-5a: the modes of a model, ranked by MRM and by MSV."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from reproduction.chapter3.examples import BENDING_NEAR, SLOW, TABLES, Records
from reproduction.chapter3.trial import SEARCHED, both_calls, records_of
from reproduction.framework.findings import Finding, SideBySide, Subject, prose, thesis_table
from reproduction.framework.verdicts import Beside, judged, less

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from reproduction.chapter3.examples import Example, ReductionTrial
    from reproduction.framework.findings import Results


NEAR = 0.1
"""A bending mode agrees within a tenth: the thesis's own vary by as much between its models."""
_HEADINGS = ("mode", "Hz", "damping", "MRM", "MSV")


@dataclass(frozen=True)
class RankedMode:
    """A row of a table: a mode, its kind and its two ranks."""

    label: str
    frequency_hz: float
    damping: float
    is_real: bool
    kind: str
    mrm: int
    msv: int

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as text."""
        shown = (
            ("real", "") if self.is_real else (f"{self.frequency_hz:.2f}", f"{self.damping:.3f}")
        )
        return (self.label, *shown, str(self.mrm), str(self.msv))


def thesis_modes(table: Mapping[str, Any]) -> tuple[RankedMode, ...]:
    """Return the modes of a table of the thesis."""
    rows = table["modes"]
    slowest_hz = min(row["frequency_hz"] for row in rows if row["mode"] in table["bending"])

    def kind(row: Mapping[str, Any]) -> str:
        if row["mode"] in table["bending"]:
            return "bending"
        return "rigid" if (row["frequency_hz"] or 0.0) < SLOW * slowest_hz else "other"

    return tuple(
        RankedMode(
            label=row["mode"],
            frequency_hz=row["frequency_hz"] or 0.0,
            damping=row["damping"] or 1.0,
            is_real=row["frequency_hz"] is None,
            kind=kind(row),
            mrm=row["mrm"],
            msv=row["msv"],
        )
        for row in rows
    )


def trial_modes(trial: ReductionTrial) -> tuple[RankedMode, ...]:
    """Return the modes of one of our models."""

    def kind(label: str) -> str:
        if label in trial.bending:
            return "bending"
        return "rigid" if label in trial.rigid else "other"

    return tuple(
        RankedMode(
            label=mode.label,
            frequency_hz=mode.frequency_hz,
            damping=mode.damping_ratio,
            is_real=not mode.is_pair,
            kind=kind(mode.label),
            mrm=mode.mrm_rank,
            msv=mode.msv_rank,
        )
        for mode in trial.modes
    )


def preference(modes: Sequence[RankedMode]) -> float:
    """Return the ranks by which MSV prefers bending to rigid modes more than MRM does."""
    lost = {
        kind: np.mean([mode.msv - mode.mrm for mode in modes if mode.kind == kind])
        for kind in ("rigid", "bending")
    }
    return float(lost["rigid"] - lost["bending"])


def compare_ranks(table: Mapping[str, Any], found: Records) -> Finding:
    """Set the modes of a model beside the thesis's; judge those with little noise."""
    example, low, noisy = found
    theirs = thesis_modes(table)
    by_label = {mode.label: mode for mode in theirs}
    thesis_hz = [by_label[label].frequency_hz for label in table["bending"]]
    whole = [trial for trial in low if len(trial.bending) == len(thesis_hz)]
    found_hz = np.array([trial.stages["initial"].bending_hz for trial in whole])
    half = len(low) / 2
    median_hz = np.median(found_hz, axis=0).tolist() if len(whole) > half else []
    ours = [trial_modes(trial) for trial in low]
    preferences = [preference(modes) for modes in ours if any(m.kind == "bending" for m in modes)]
    shown = found.shown(noisy=False)
    lack = "" if median_hz else " The others lack one, so none is compared: all count as missing."
    ours_hz = median_hz or [np.inf] * len(thesis_hz)
    return Finding(
        judged(
            figures=(Beside("bending frequencies", tuple(thesis_hz), tuple(ours_hz), 1.0 + NEAR),),
            statements=(
                less(
                    "MSV prefers bending modes to the rigid motion more than MRM does",
                    [0.0] * len(preferences),
                    preferences,
                ),
            ),
            evidence=f"It does by {np.median(preferences):.1f} ranks, median of "
            f"{len(preferences)} records, the thesis's table by {preference(theirs):.1f}. With "
            f"little noise all bending modes are found in {len(whole)} of {len(low)} records."
            + lack,
            reason="In our records the two indices do not part rigid and bending modes.",
        ),
        tables=(
            _ranks_beside(example, theirs, trial_modes(shown)),
            _kind_table(example, theirs, ours, [trial_modes(trial) for trial in noisy]),
        ),
        text=_text(found),
    )


def _ranks_beside(
    example: Example, theirs: Sequence[RankedMode], ours: Sequence[RankedMode]
) -> SideBySide:
    empty = ("",) * len(_HEADINGS)
    return SideBySide(
        prose(
            "table-3-xa.modes_title",
            code=example.code,
            record=example.experiment,
            shown_seed=example.shown_seed,
        ),
        (*_HEADINGS, *(f"our {heading}" for heading in _HEADINGS)),
        tuple(
            (*(left.cells if left else empty), *(right.cells if right else empty))
            for left, right in zip_longest(theirs, ours)
        ),
    )


def _kind_table(
    example: Example,
    theirs: Sequence[RankedMode],
    low: Sequence[Sequence[RankedMode]],
    noisy: Sequence[Sequence[RankedMode]],
) -> SideBySide:
    def mean_ranks(models: Sequence[Sequence[RankedMode]], kind: str) -> str:
        each = [[(mode.mrm, mode.msv) for mode in modes if mode.kind == kind] for modes in models]
        ranks = np.array([np.mean(ranks, axis=0) for ranks in each if ranks])
        if not len(ranks):
            return "none"
        mrm, msv = np.median(ranks, axis=0).tolist()
        return f"{mrm:.1f} / {msv:.1f}"

    rows = [
        (kind, mean_ranks([theirs], kind), mean_ranks(low, kind), mean_ranks(noisy, kind))
        for kind in ("rigid", "bending", "other")
    ]
    return SideBySide(
        prose("table-3-xa.kinds_title", code=example.code, records=len(low)),
        ("modes", "thesis", "ours, little noise", "ours, strong noise"),
        tuple(rows),
    )


def _text(found: Records) -> tuple[str, ...]:
    example, low, noisy = found
    beam_hz = " / ".join(f"{hz:.1f}" for hz in example.known_modes_hz)
    third = [
        sum(len(trial.bending) == len(example.known_modes_hz) for trial in each)
        for each in (low, noisy)
    ]
    lines = [
        prose("table-3-xa.text", beam_hz=beam_hz, factor=np.exp(BENDING_NEAR)),
        prose(
            "table-3-xa.text2",
            little=third[0],
            records=len(low),
            number=_number(example.code),
            strong=third[1],
        ),
    ]
    if example.unstable:
        orders = [trial.order for trial in low]
        moved = [abs(trial.moved[0]) for trial in low]
        shown = found.shown(noisy=False)
        lines.append(
            prose(
                "table-3-xa.text3",
                order=example.order,
                first=SEARCHED[0],
                last=SEARCHED[-1],
                same=orders.count(example.order),
                records=len(low),
                least=min(orders),
                most=max(orders),
                nearest=min(moved),
                farthest=max(moved),
                moved=abs(shown.moved[0]),
                printed=example.unstable,
            )
        )
    return tuple(lines)


def _number(code: str) -> str:
    return next(number for number, each in TABLES.items() if each == code)


_NOTES = {
    "3-3": "an unstable model",
    "3-4": "a model from an open-loop record",
    "3-5": "a model from a record with its Coulomb compensation",
}


def _subject(number: str, code: str) -> Subject:
    def build(results: Results) -> Finding:
        table = thesis_table(f"table_{number.replace('-', '_')}a")
        return compare_ranks(table, records_of(results, code))

    title = f"Modes of {code} by MRM and MSV" + (f": {_NOTES[number]}" if number in _NOTES else "")
    return Subject(f"table-{number}a", title, both_calls(code), build)


SUBJECTS = tuple(_subject(number, code) for number, code in TABLES.items())
