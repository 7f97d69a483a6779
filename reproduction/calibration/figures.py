"""Figures of the thesis, from all chapters, beside those of a rig, and their distances.

They are those that the subjects of the study are judged by, from a part of the experiments, so that
one rig takes seconds and not minutes.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.models.nominal_models import nominal_model
from flexarm_ident import IdentificationError
from reproduction.appendices.nominal_models import described, gains_off_db, identified_once
from reproduction.chapter2.order_survey import TABLE_OF, survey_once
from reproduction.chapter3.examples import (
    EXAMPLES,
    LOW,
    TABLES,
    THESIS,
    thesis_rows,
)
from reproduction.chapter3.ranks import thesis_modes
from reproduction.chapter3.trial import reduction_trial, unstable_order
from reproduction.chapter4.pdpc import CASES, pdpc_step
from reproduction.chapter4.pi import pi_case
from reproduction.framework.findings import SENSORS, Call, thesis_table
from reproduction.framework.rig import step_trial
from reproduction.framework.study_rig import CHOICES, STUDY_RIG, studied_with
from reproduction.framework.verdicts import BAND

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flexarm_daq import RigParameters
    from reproduction.chapter3.examples import ReductionTrial

    Value = float | tuple[float, ...]

Changes = tuple[tuple[str, float | tuple[float, ...]], ...]
"""Parameters of a rig that differ from `STUDY_RIG`, by name."""
Settings = tuple[tuple[str, float], ...]
"""Other `Choices`, by name."""

RECORDS = ("O_dat2", "O_dat10", "B_dat9", "C_dat3", "C_dat6", "C_dat11")
"""Experiments of Tables 2-1, 2-3 and 2-4."""
RUNS_AWAY = "the loop runs away"
"""A figure of the bounded record, which no chapter counts: 1 or 0, see Figure 2-12."""
PI_MODELS = ("Ao2r_9", "Ac3r_8")
"""One model of type I and one of type II of Table 4-1."""
NOISES = (LOW, THESIS)
TRACKING = "tracking error"
UNSTABLE = "Ac3_21u"


SLACK = 0.05
"""Errors agree within a twentieth of the signal, as in the figures of chapter 3."""
CHAPTERS = ("2", "3", "4", "B")
FARTHEST = 3.0
"""Beyond so many times the logarithm of `BAND` nothing is gained by coming a little nearer."""


class Figure(NamedTuple):
    """A figure of the thesis beside ours.

    Attributes
    ----------
    chapter : str
        Chapter of the thesis.
    name : str
        Model and quantity.
    thesis, ours : float
        Its value there and here.
    slack : float
        Difference that no eye tells apart.
    """

    chapter: str
    name: str
    thesis: float
    ours: float
    slack: float = 0.0


def rig_of(changes: Changes) -> RigParameters:
    """Return the rig with some parameters changed."""
    return replace(STUDY_RIG, **dict(changes))  # type: ignore[arg-type]


def figures_of(
    part: str, subject: str, changes: Changes, seed: int, settings: Settings = ()
) -> tuple[Figure, ...]:
    """Return the figures of one model or record on a changed rig, with other settings as well."""
    with studied_with(replace(CHOICES, rig=rig_of(changes), **dict(settings))):  # type: ignore[arg-type]
        return tuple(_PARTS[part](subject, seed))


def parts(changes: Changes, seeds: Sequence[int]) -> tuple[Call, ...]:
    """Return the computations of all figures of a rig."""
    each = (
        *(("table", record) for record in RECORDS),
        *(("example", code) for code in TABLES.values()),
        *(("pi", code) for code in PI_MODELS),
        *(("tracking", f"{payload_kg:g}") for payload_kg, _ in CASES),
        *(("nominal", f"{payload_kg:g}") for payload_kg in thesis_table("appendix_b")["models"]),
    )
    return tuple(Call(figures_of, (*part, changes, seed)) for part in each for seed in seeds)


def unstable_order_of(changes: Changes, noise: str, seed: int) -> int:
    """Return the order of the unstable example of chapter 3 on a changed rig.

    Raises
    ------
    IdentificationError
        If there is none: on such a rig the study is not defined.
    """
    with studied_with(replace(CHOICES, rig=rig_of(changes))):
        return unstable_order(UNSTABLE, noise, seed)


def _record(name: str, seed: int) -> list[Figure]:
    row, ours = thesis_table(TABLE_OF[name[0]])[name], survey_once(name, seed)
    return [
        Figure("2", f"{name}, mean error", row["mean"], float(np.mean(ours["chosen_dmv"]))),
        Figure("2", f"{name}, position", row["delta"][0], float(ours["chosen_dmv"][0]), SLACK),
        Figure("2", f"{name}, stable orders", len(row["stable"]), float(ours["stable"].sum())),
        Figure("-", f"{name}, {RUNS_AWAY}", 1.0, float(not ours["printed_loop_stable"])),
    ]


def _example(code: str, seed: int) -> list[Figure]:
    number = next(number for number, each in TABLES.items() if each == code).replace("-", "_")
    rows, table = thesis_rows(thesis_table(f"table_{number}b")), thesis_table(f"table_{number}a")
    trial: ReductionTrial | None = None
    # A rig without such a model is as far off as figures can be.
    with suppress(IdentificationError):
        trial = reduction_trial(code, THESIS, seed)
    found = [
        Figure(
            "3",
            f"{code}, {row.stage}, {row.validation}, {sensor}",
            theirs,
            getattr(trial.stages[row.stage], row.validation)[k] if trial else np.inf,
            SLACK,
        )
        for row in rows
        for k, (sensor, theirs) in enumerate(zip(SENSORS, row.delta, strict=True))
    ]
    if trial is None:
        return found
    printed = {mode.label: mode.damping for mode in thesis_modes(table)}
    known_hz = EXAMPLES[code].known_modes_hz
    ours = {mode.label: mode for mode in trial.modes}
    bending = [ours[label] for label in trial.bending]
    for label, hz in zip(table["bending"], known_hz, strict=True):
        nearest = min(bending, key=lambda mode: abs(np.log(mode.frequency_hz / hz)), default=None)
        if nearest is not None:
            words = f"{code}, damping at {hz:.0f} Hz"
            found.append(Figure("3", words, printed[label], nearest.damping_ratio))
    return found


def _pi(code: str, seed: int) -> list[Figure]:
    printed, ours = thesis_table("table_4_1")[code], pi_case(code, seed)
    return [
        Figure("4", f"{code}, J", printed["criterion"], ours.criterion),
        Figure("4", f"{code}, Kp", printed["kp"], ours.kp),
    ]


def _tracking(payload: str, seed: int) -> list[Figure]:
    setpoint_v = dict(CASES)[float(payload)]
    step = step_trial(pdpc_step("pdpc", float(payload), setpoint_v, seed))
    return [Figure("4", f"{TRACKING} {payload} kg", 0.0, abs(step.mean_error_v), SLACK)]


def _nominal(payload: str, seed: int) -> list[Figure]:
    payload_kg = float(payload)
    made = thesis_table("appendix_b")["models"][payload_kg]
    ours = identified_once(payload_kg, made["record"], made["full_order"], made["order"], seed)
    off_db = gains_off_db(described(nominal_model(payload_kg)), (ours,))[0, 0]
    return [
        Figure("B", f"{payload} kg, gain of the {sensor}", 1.0, float(10.0 ** (gap / 20.0)))
        for sensor, gap in zip(SENSORS, off_db, strict=True)
    ]


_PARTS: dict[str, Callable[[str, int], list[Figure]]] = {
    "table": _record,
    "example": _example,
    "pi": _pi,
    "tracking": _tracking,
    "nominal": _nominal,
}


@dataclass(frozen=True)
class Point:
    """A rig and how near its figures lie.

    Attributes
    ----------
    changes : dict
        Values of its parameters that were changed.
    within : dict
        Figures within `BAND`, by chapter.
    figures : dict
        Number of figures, by chapter.
    distance : float
        How far the figures lie off, in logarithms of `BAND`: mean of each chapter, and of these.
    tracking_v : float
        Largest tracking error of PDPC.
    """

    changes: Mapping[str, Value]
    within: Mapping[str, int]
    figures: Mapping[str, int]
    distance: float
    tracking_v: float

    @property
    def total(self) -> int:
        """Figures within `BAND`, of all chapters."""
        return sum(self.within.values())


def distance(figure: Figure) -> float:
    """Return how far a figure lies from the thesis's, in logarithms of `BAND`."""
    if abs(figure.ours - figure.thesis) <= figure.slack:
        return 0.0
    if min(figure.ours, figure.thesis) <= 0.0:
        return FARTHEST
    return min(float(abs(np.log(figure.ours / figure.thesis)) / np.log(BAND)), FARTHEST)


def summed(changes: Mapping[str, Value], figures: Sequence[Figure]) -> Point:
    """Sum the figures of a rig up."""
    far = {
        chapter: [distance(each) for each in figures if each.chapter == chapter]
        for chapter in CHAPTERS
    }
    return Point(
        changes,
        {chapter: sum(each <= 1.0 for each in some) for chapter, some in far.items()},
        {chapter: len(some) for chapter, some in far.items()},
        float(np.mean([np.mean(some) for some in far.values()])),
        max(each.ours for each in figures if each.name.startswith(TRACKING)),
    )
