"""Table 4-1: models of three types, judged by the PI law that each leads to (section 4.1).

The thesis does not say what compensated the friction when its PI laws were implemented. Its models
of type II know of none, and their laws would stop far away from the set-point. So all laws, of
whatever type, are implemented with the compensation of the closed-loop record, as the laws of
section 2.4.3, and once more without.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from flexarm_control.design.criteria import step_figures
from flexarm_control.design.tuning import tune_pi
from flexarm_control.laws.gains import PiGains, Sampling
from flexarm_control.laws.law_protocol import Effort
from flexarm_control.laws.pi import Pi
from flexarm_control.simulation import simulate_loop
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run as identify_record
from reproduction.chapter2.order_survey import METHOD, block_rows_for
from reproduction.framework.findings import (
    LEVEL,
    SEEDS,
    Call,
    Finding,
    Judgement,
    Plot,
    SideBySide,
    Subject,
    columns,
    judged,
    p_text,
    prose,
    sign_test,
    spread,
    subject,
    thesis_table,
)
from reproduction.framework.model_plots import match_plot
from reproduction.framework.realisations import rounded_model
from reproduction.framework.rig import RATE_HZ, STEP_S, simulated_record, step_to
from reproduction.framework.study_rig import calm_rig

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from flexarm_control.laws.law_protocol import Law
    from reproduction.framework.findings import Results


SETPOINT_V = 3.0
LEVEL_V = experiment("C_dat3").gains["compensation_v"]
"""Compensation of the record that the models of types II and III come from."""


CODES = thesis_table("table_4_1")


def _knows_no_friction(code: str) -> bool:
    return bool(CODES[code]["type"] == "II")


class _Compensated:
    """A law with the unconditional compensation of section 2.4.3 on top."""

    def __init__(self, law: Law, level_v: float) -> None:
        self._law, self._level_v = law, level_v

    def step(self, volts: Sequence[float], reference_v: float) -> Effort:
        effort_v, _ = self._law.step(volts, reference_v)
        return Effort(effort_v, math.copysign(self._level_v, effort_v))

    def reset(self) -> None:
        self._law.reset()


@dataclass(frozen=True)
class PiCase:
    """One model, its PI law, and the step to 3 V that the law makes on the model and on the rig.

    The criterion is J of (4-1); the error for a step of 1 V and the rise time are on the model. The
    law is implemented with the compensation, and once more without.
    """

    order: int
    kp: float
    ki: float
    criterion: float
    error_v: float
    rise_s: float
    time_s: NDArray[np.float64]
    simulated_v: NDArray[np.float64]
    implemented_v: NDArray[np.float64]
    uncompensated_v: NDArray[np.float64]

    @property
    def mismatch(self) -> float:
        """Root mean square of the difference of the two steps over the set-point."""
        return self._mismatch(self.implemented_v)

    @property
    def uncompensated_mismatch(self) -> float:
        """The same where the friction was not compensated."""
        return self._mismatch(self.uncompensated_v)

    def _mismatch(self, measured_v: NDArray[np.float64]) -> float:
        difference = np.nan_to_num(self.simulated_v, nan=np.inf) - measured_v
        return float(np.sqrt(np.mean(np.square(difference))) / SETPOINT_V)

    @property
    def implemented_itae(self) -> float:
        """J of (4-1) of the step on the rig, for 1 V."""
        share = 1.0 - self.implemented_v / SETPOINT_V
        return float(np.sum(self.time_s * np.abs(share)) / RATE_HZ)


def pi_case(code: str, seed: int) -> PiCase:
    """Identify, reduce and update one of the `CODES`, tune its PI law, step model and rig."""
    record, order, reduced_order, flexible_modes = CODES[code]["made"]
    entry = experiment(record)
    arm = calm_rig(entry.payload_kg)
    outcome = identify_record(
        simulated_record(record, seed, calm=True),
        Request(
            train_fraction=0.5,
            method=METHOD,
            order=order,
            block_rows=block_rows_for(order),
            feedthrough="no",
            reduction="mrmc",
            reduced_order=reduced_order,
            known_modes_hz=tuple(natural_frequencies_hz(arm)[:flexible_modes].tolist()),
            update="b",
            remove_compensation=CODES[code]["type"] != "III",
            friction=False,
        ),
    )
    # In the digits in which processors agree: a search takes other ways from other models.
    model = rounded_model(outcome.model)
    tuned = tune_pi(model)
    # J is flat about its least, and two digits are what the searches of all processors share.
    gains = PiGains(*(float(f"{gain:.2g}") for gain in (tuned.gains.kp, tuned.gains.ki)))
    law = Pi(gains, Sampling(RATE_HZ))
    on_rig, bare = (
        step_to(each, SETPOINT_V, arm=arm, seed=seed) for each in (_Compensated(law, LEVEL_V), law)
    )
    on_model = simulate_loop(model, law, on_rig.reference_v)
    position_v = np.array(on_model.y[:, 0], dtype=float)
    figures = step_figures(on_model.time_s, position_v, SETPOINT_V)
    return PiCase(
        model.nstates,
        gains.kp,
        gains.ki,
        tuned.criterion,
        abs(figures.mean_error_v) / SETPOINT_V,
        min(figures.rise_s, STEP_S),
        on_rig.time_s,
        position_v,
        on_rig.y[:, 0],
        bare.y[:, 0],
    )


FIGURES = dict(zip(("4-2", "4-3", "4-4", "4-5"), CODES, strict=True))
CLOSE = 0.25
"""J and Kp agree when the thesis's value is within this share of our median: its own two models of
type II differ from each other by less than 1 %, ours by seed differ by more."""
SAME_GAINS = 0.05
"""Two models count as one when their gains differ by less."""
FIGURE_MATCH = 0.06
"""Two steps that differ by less than this share of the set-point lie on each other to the eye."""

_OTHER = tuple(code for code in CODES if not _knows_no_friction(code))
_BEST = "Ac3r_10"
_IMPLEMENTED = prose("chapter-4.compensation", level_v=LEVEL_V)


def cases(results: Results, code: str) -> list[PiCase]:
    """Return the cases of a model, one per seed."""
    return [results[Call(pi_case, (code, seed))] for seed in SEEDS]


_NEEDS = tuple(Call(pi_case, (code, seed)) for code in CODES for seed in SEEDS)


def _table(results: Results) -> Finding:
    rows = []
    for code, made in CODES.items():
        ours, thesis = cases(results, code), made
        for name, digits in (("criterion", 3), ("error_v", 3), ("rise_s", 2), ("kp", 2), ("ki", 3)):
            rows.append(
                (
                    code,
                    made["type"],
                    _WORDS[name],
                    f"{thesis[name.removesuffix('_v')]:.4g}",
                    spread([getattr(case, name) for case in ours], f".{digits}f"),
                )
            )
    return Finding(
        table_judgement({code: cases(results, code) for code in CODES}),
        (SideBySide("PI laws", ("model", "type", "figure", "thesis", "ours"), tuple(rows)),),
        text=(prose("table-4-1.text", seeds=len(SEEDS)),),
    )


_WORDS = {
    "criterion": "J, V s²",
    "error_v": "steady-state error, V",
    "rise_s": "rise time, s",
    "kp": "Kp",
    "ki": "Ki, 1/s",
}


def table_judgement(ours: dict[str, list[PiCase]]) -> Judgement:
    """Judge Table 4-1 by J and Kp; Ki hardly changes J, and is not judged."""
    ratios = {
        f"{name} of {code}": float(np.median([getattr(case, name) for case in found]))
        / CODES[code][name]
        for code, found in ours.items()
        for name in ("criterion", "kp")
    }
    far = [f"{what} {ratio:.2f}" for what, ratio in ratios.items() if abs(ratio - 1.0) > CLOSE]
    best = {code: np.median([case.criterion for case in found]) for code, found in ours.items()}
    smallest = min(best[code] for code in _OTHER)
    ranked = all(best[code] < smallest for code in CODES if code not in _OTHER)
    small, large = (np.median([case.kp for case in ours[code]]) for code in ("Ac3r_8", "Ac3r_10"))
    apart = abs(large / small - 1.0)
    return judged(
        agrees=ranked and not far,
        same_ranking=ranked,
        evidence=f"Median J is {best['Ac3r_8']:.3f} and {best['Ac3r_10']:.3f} for type II, "
        f"{best['Ao2r_9']:.3f} for type I, {best['Ac3r_10c']:.3f} for type III: type II "
        f"{'is' if ranked else 'is not'} best, as in the thesis. "
        f"Kp of the two models of type II differs by {apart:.1%}, so the third flexible mode "
        f"{'does not matter' if apart < SAME_GAINS else 'matters'}. "
        + (f"Ours over the thesis's, beyond {CLOSE:.0%}: {', '.join(far)}." if far else ""),
        reason="The slow poles that friction leaves in a model decide J, and our arm has others.",
    )


def _figure(code: str, results: Results) -> Finding:
    found = cases(results, code)
    mismatches = [case.mismatch for case in found]
    shown = found[int(np.argsort(mismatches)[len(mismatches) // 2])]
    others = {
        other: float(np.median([case.mismatch for case in cases(results, other)]))
        for other in CODES
        if other != code
    }
    svg = match_plot(
        shown.time_s, shown.implemented_v, shown.simulated_v, "position_v", fitted_s=0.0, points=600
    )
    return Finding(
        figure_judgement(code, float(np.median(mismatches)), others),
        plots=(
            Plot(
                prose("pi-law.caption", code=code, setpoint_v=SETPOINT_V),
                svg,
            ),
        ),
        text=(_IMPLEMENTED,),
    )


def figure_judgement(code: str, mismatch: float, others: dict[str, float]) -> Judgement:
    """Judge a figure: type II follows its simulation, the others do not."""
    without = code not in _OTHER
    rivals = [value for other, value in others.items() if (other not in _OTHER) != without]
    close = mismatch <= FIGURE_MATCH
    better = mismatch < min(rivals) if without else mismatch > max(rivals)
    return judged(
        agrees=better and close == without,
        same_ranking=better,
        evidence=f"Model and rig differ by {mismatch:.1%} of the set-point (root mean square, "
        f"median of {len(SEEDS)} seeds); the other models by "
        f"{', '.join(f'{value:.1%} ({other})' for other, value in others.items())}.",
        reason="The thesis's figure shows the models of type II closest to the rig.",
    )


def _claim(results: Results) -> Finding:
    mismatch = {code: [case.mismatch for case in cases(results, code)] for code in CODES}
    p_values = {code: sign_test(mismatch[_BEST], mismatch[code]) for code in _OTHER}
    rows = tuple(
        (
            code,
            made["type"],
            spread([100.0 * value for value in mismatch[code]], ".1f"),
            spread([100.0 * case.uncompensated_mismatch for case in cases(results, code)], ".0f"),
            spread([case.implemented_itae for case in cases(results, code)], ".2f"),
            p_text(p_values[code]) if code in p_values else "",
        )
        for code, made in CODES.items()
    )
    heading = columns(prose("claim-4-1.columns", best=_BEST))
    return Finding(
        claim_judgement(p_values),
        (SideBySide(f"Simulated and implemented step, {len(SEEDS)} seeds", heading, rows),),
        text=(_IMPLEMENTED,),
    )


def claim_judgement(p_values: dict[str, float]) -> Judgement:
    """Judge whether the models of type II are the closest."""
    holds = max(p_values.values()) < LEVEL
    words = ", ".join(f"{code}: {p_text(value)}" for code, value in p_values.items())
    return judged(
        agrees=holds,
        same_ranking=False,
        evidence=f"The step on the rig is closer to {_BEST} than to the other types, {words}.",
        reason=f"At p < {LEVEL:g} it does not hold for all of them.",
    )


SUBJECTS = (
    subject("table-4-1", _NEEDS, _table),
    *(
        Subject(
            f"figure-{number}",
            f"PI law of {code}: simulated and implemented step to 3 V",
            _NEEDS,
            partial(_figure, code),
        )
        for number, code in FIGURES.items()
    ),
    subject("claim-4-1", _NEEDS, _claim),
)
