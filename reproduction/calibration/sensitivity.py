"""Choices that the thesis leaves open: what each of them does to the figures of every chapter.

A choice is taken by what the thesis's text says. Where it says nothing, that value is taken with
which the calibration found the figures of all chapters nearest, with the settings that it had.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.criteria import itae, step_itae
from flexarm_control.design.tuning import pdp_step_response
from flexarm_control.laws.gains import PdpGains
from flexarm_control.models.nominal_models import nominal_model, nominal_payloads_kg
from reproduction.calibration.figures import (
    CHAPTERS,
    FARTHEST,
    RUNS_AWAY,
    SLACK,
    figures_of,
    parts,
    summed,
)
from reproduction.framework.findings import (
    SEEDS,
    Call,
    Finding,
    SideBySide,
    prose,
    subject,
    thesis_table,
)
from reproduction.framework.rig import RATE_HZ
from reproduction.framework.study_rig import CHOICES
from reproduction.framework.verdicts import BAND, Judgement, Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from reproduction.calibration.figures import Changes, Figure, Settings
    from reproduction.framework.findings import Results

    Swept = dict[float, dict[int, list[Figure]]]

SWEEP_SEEDS = SEEDS[:2]
NM_PER_V = 0.55
"""Torque of the drive with the gear, which friction in volts is told by."""


@dataclass(frozen=True)
class Choice:
    """A choice: its parameter of the rig or its setting, the values, and how they are written.

    `records` are the experiments that it matters to; without them all figures are computed.
    """

    parameter: str
    values: tuple[float, ...]
    unit: str
    factor: float = 1.0
    of_rig: bool = False
    records: tuple[str, ...] = ()

    @property
    def taken(self) -> float:
        """Value of the study."""
        return float(getattr(CHOICES.rig if self.of_rig else CHOICES, self.parameter))

    def text(self, value: float) -> str:
        """Return a value as it is told."""
        if self.parameter == "hold_s" and value < 1.0 / RATE_HZ:
            return "one sample"
        return f"{self.factor * value:g} {self.unit}".strip()

    def calls(self, value: float, seed: int) -> tuple[Call, ...]:
        """Return the computations of the figures with a value."""
        changes: Changes = ((self.parameter, value),) if self.of_rig else ()
        settings: Settings = () if self.of_rig else ((self.parameter, value),)
        if value == self.taken:
            changes, settings = (), ()
        kinds = [("table", record) for record in self.records] or [
            call.arguments[:2] for call in parts((), SWEEP_SEEDS[:1])
        ]
        return tuple(Call(figures_of, (*kind, changes, seed, settings)) for kind in kinds)


CHOICES_SWEPT = {
    "choice-s-1": Choice(
        *("hold_s", (0.002, 0.01, 0.05), "ms", 1e3),
        records=("O_dat5", "O_dat6", "O_dat13", "O_dat14", "B_dat1", "B_dat3"),
    ),
    "choice-s-2": Choice(
        *("coulomb_friction_nm", (0.22, 0.275, 0.352, 0.385), "V", 1.0 / NM_PER_V), of_rig=True
    ),
    "choice-s-3": Choice("base_gauge_v_per_nm", (1.6, 2.4), "V/(N m)", of_rig=True),
    "choice-s-4": Choice("loop_delay_s", (5e-4, 1e-3, 2e-3, 3e-3), "ms", 1e3, of_rig=True),
    "choice-s-5": Choice("block_rows", (20, 30, 40, 60), ""),
}


def _swept(key: str, results: Results) -> Finding:
    choice = CHOICES_SWEPT[key]
    found: Swept = {
        value: {
            seed: [figure for call in choice.calls(value, seed) for figure in results[call]]
            for seed in SWEEP_SEEDS
        }
        for value in choice.values
    }
    rows = _record_rows if choice.records else _chapter_rows
    headings, cells, distances = rows(found)
    shown = {value: f"{far:.2f}" for value, far in distances.items()}
    least = f"{min(distances.values()):.2f}"
    nearest = [choice.text(value) for value, far in shown.items() if far == least]
    marked = tuple(
        (f"{choice.text(value)}{' (taken)' * (value == choice.taken)}", *cells[value])
        for value in choice.values
    )
    listed = ", ".join(f"{far} ({choice.text(value)})" for value, far in shown.items())
    return Finding(
        Judgement(
            Verdict.OURS,
            f"{choice.text(choice.taken)}. Distance of the figures: {listed}; "
            f"{' and '.join(nearest)} {'tie' if len(nearest) > 1 else 'is nearest'}. "
            f"{' '.join((prose(f'{key}.rule'), *_fewer(choice, found)))}",
        ),
        (SideBySide(f"Seeds {_seeds()}", ("value", *headings), marked),),
        text=(
            prose(
                f"choice-s.{'records' if choice.records else 'chapters'}",
                band=BAND,
                farthest=FARTHEST,
                slack=SLACK,
            ),
        ),
    )


def _fewer(choice: Choice, found: Swept) -> Iterator[str]:
    """Yield how many figures a value has fewer than another, and why."""
    numbers = {value: len(_of_all_seeds(figures)) for value, figures in found.items()}
    most = max(numbers.values())
    for value, number in numbers.items():
        if number < most:
            yield prose("choice-s.fewer", value=choice.text(value), fewer=most - number)


def _of_all_seeds(figures: dict[int, list[Figure]]) -> list[Figure]:
    return [each for some in figures.values() for each in some]


def _with_each(far: float, of_each: Iterable[float]) -> str:
    """Return a distance with that of each seed in brackets."""
    return f"{far:.2f} ({', '.join(f'{each:.2f}' for each in of_each)})"


def _seeds() -> str:
    return " and ".join(map(str, SWEEP_SEEDS))


def _chapter_rows(
    found: Swept,
) -> tuple[tuple[str, ...], dict[float, tuple[str, ...]], dict[float, float]]:
    points = {value: summed({}, _of_all_seeds(figures)) for value, figures in found.items()}
    away = {
        value: [each.ours for each in _of_all_seeds(figures) if each.name == f"B_dat9, {RUNS_AWAY}"]
        for value, figures in found.items()
    }
    cells = {
        value: (
            *(f"{point.within[each]} of {point.figures[each]}" for each in CHAPTERS),
            f"{point.total}",
            _with_each(
                point.distance, (summed({}, some).distance for some in found[value].values())
            ),
            f"{sum(away[value]):.0f} of {len(away[value])}",
        )
        for value, point in points.items()
    }
    names = (f"{'appendix' if each == 'B' else 'chapter'} {each}" for each in CHAPTERS)
    headings = (*names, "all", "distance", "loop of 2-12 runs away")
    return headings, cells, {value: point.distance for value, point in points.items()}


def _record_rows(
    found: Swept,
) -> tuple[tuple[str, ...], dict[float, tuple[str, ...]], dict[float, float]]:
    theirs = {
        each.name: each.thesis
        for each in _of_all_seeds(next(iter(found.values())))
        if "mean error" in each.name
    }

    def means(figures: list[Figure]) -> list[float]:
        ours = ([each.ours for each in figures if each.name == name] for name in theirs)
        return [float(np.mean(some)) for some in ours]

    def far(figures: list[Figure]) -> float:
        ratios = np.array(means(figures)) / np.array(list(theirs.values()))
        return float(np.mean(np.abs(np.log(ratios))) / np.log(BAND))

    cells, distances = {}, {}
    for value, of_seeds in found.items():
        figures = _of_all_seeds(of_seeds)
        distances[value] = far(figures)
        of_each = _with_each(distances[value], map(far, of_seeds.values()))
        cells[value] = (*(f"{each:.3f}" for each in means(figures)), of_each)
    headings = (*(f"{name} (thesis {each:.3f})" for name, each in theirs.items()), "distance")
    return headings, cells, distances


HORIZONS_S = (2.0, 3.0, 3.5, 4.0, 5.0)


def criterion_sums(length_s: float) -> tuple[float, float, float]:
    """Return the sums of E, of Y and of Y's base gauge alone, for the gains of Table 4-2.

    They are on the printed models with y3 turned.
    """
    printed = thesis_table("table_4_2")
    gains = PdpGains(*(printed[name] for name in ("kp", "kd", "ksg")))
    sums = np.zeros(3)
    for payload_kg in nominal_payloads_kg():
        model = nominal_model(payload_kg, flip_middle_strain=True)
        y = pdp_step_response(model, gains, round(length_s / float(model.dt)))
        base_v = y[:, 1] / np.abs(y[:, 1]).max()
        sums += (*step_itae(y, dt_s=float(model.dt)), itae(base_v, dt_s=float(model.dt)))
    error, strain, base = sums.tolist()
    return error, strain, base


def _horizon(results: Results) -> Finding:
    printed = thesis_table("table_4_2")
    sums = {length_s: results[Call(criterion_sums, (length_s,))] for length_s in HORIZONS_S}
    error, strain, criterion = (
        printed[name] for name in ("error_itae_sum", "strain_itae_sum", "criterion")
    )
    errors, strains, bases = (
        {length_s: each[k] for length_s, each in sums.items()} for k in range(3)
    )
    totals = {length_s: errors[length_s] + strains[length_s] for length_s in sums}
    nearest, both, base, whole = (
        min(ours, key=lambda length_s: abs(np.log(ours[length_s] / theirs)))
        for ours, theirs in (
            (errors, error),
            (strains, strain),
            (bases, strain),
            (totals, criterion),
        )
    )
    thesis = ("thesis", f"{error:.3f}", f"{strain:.3f}", "", f"{error + strain:.3f}")
    rows = tuple(
        (
            f"{length_s:g} s{' (taken)' * (length_s == CHOICES.criterion_s)}",
            *(f"{each:.3f}" for each in each_of),
            f"{totals[length_s]:.3f}",
        )
        for length_s, each_of in sums.items()
    )
    return Finding(
        Judgement(
            Verdict.OURS,
            f"{CHOICES.criterion_s:g} s. The sum of E of the thesis's gains comes nearest to the "
            f"printed one with {nearest:g} s. "
            + prose(
                "choice-s-6.rule",
                strain=strain,
                both_s=both,
                both=strains[both],
                base_s=base,
                base=bases[base],
                criterion=criterion,
                length_s=whole,
                total=totals[whole],
            ),
        ),
        (
            SideBySide(
                "The gains of Table 4-2 on the models of Appendix B, y3 turned",
                ("length", "sum of E", "sum of Y", "of the base gauge alone", "E + Y"),
                (thesis, *rows),
            ),
        ),
    )


def _calls(choice: Choice) -> tuple[Call, ...]:
    pairs = product(choice.values, SWEEP_SEEDS)
    return tuple(dict.fromkeys(call for pair in pairs for call in choice.calls(*pair)))


SUBJECTS = (
    *(subject(key, _calls(choice), partial(_swept, key)) for key, choice in CHOICES_SWEPT.items()),
    subject(
        "choice-s-6",
        tuple(Call(criterion_sums, (length_s,)) for length_s in HORIZONS_S),
        _horizon,
    ),
)
