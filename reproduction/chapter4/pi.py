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
from flexarm_control.laws.pdpc import Pi
from flexarm_control.simulation import simulate_loop
from flexarm_daq.experiments.catalogue import experiment
from flexarm_daq.rigs.beam import natural_frequencies_hz
from reproduction.chapter2.order_survey import updated_model
from reproduction.framework.findings import (
    SEEDS,
    Call,
    Finding,
    Plot,
    SideBySide,
    Subject,
    columns,
    prose,
    spread,
    subject,
    thesis_table,
)
from reproduction.framework.model_plots import match_plot
from reproduction.framework.realisations import rounded_model
from reproduction.framework.rig import RATE_HZ, STEP_S, step_to
from reproduction.framework.study_rig import calm_rig, choices
from reproduction.framework.verdicts import (
    Beside,
    Judgement,
    elsewhere,
    judged,
    less,
    mostly,
    p_text,
)

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
    made = updated_model(
        record,
        seed,
        (order, reduced_order),
        natural_frequencies_hz(arm)[:flexible_modes].tolist(),
        compensation="keep" if CODES[code]["type"] == "III" else "remove",
    )
    # In the digits in which processors agree: a search takes other ways from other models.
    model = rounded_model(made)
    tuned = tune_pi(model, duration_s=choices().criterion_s)
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
        text=(prose("table-4-1.text", length_s=choices().criterion_s, seeds=len(SEEDS)),),
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
    medians = {
        name: {
            code: float(np.median([getattr(case, name) for case in found]))
            for code, found in ours.items()
        }
        for name in ("criterion", "kp")
    }
    criteria = {code: np.array([case.criterion for case in found]) for code, found in ours.items()}
    best, others = (
        pick([each for code, each in criteria.items() if (code in _OTHER) == is_other], axis=0)
        for pick, is_other in ((np.max, False), (np.min, True))
    )
    small, large = (np.array([case.kp for case in ours[code]]) for code in ("Ac3r_8", "Ac3r_10"))
    return judged(
        figures=[
            Beside(
                f"values of {_WORDS[name].partition(',')[0]}",
                tuple(CODES[code][name] for code in ours),
                tuple(found.values()),
                1.0 + CLOSE,
            )
            for name, found in medians.items()
        ],
        statements=(
            less("both models of type II have the least J", best, others),
            mostly("they have the same Kp", np.abs(large / small - 1.0) < SAME_GAINS),
        ),
        evidence="Median J is "
        + ", ".join(f"{value:.3f} ({code})" for code, value in medians["criterion"].items())
        + ".",
        reason="The slow poles that friction leaves in a model decide J, and our arm has others.",
    )


def _figure(code: str, results: Results) -> Finding:
    found = cases(results, code)
    mismatches = [case.mismatch for case in found]
    shown = found[int(np.argsort(mismatches)[len(mismatches) // 2])]
    svg = match_plot(
        shown.time_s, shown.implemented_v, shown.simulated_v, "position_v", fitted_s=0.0, points=600
    )
    return Finding(
        elsewhere(
            "claim-4-1",
            f"Model and rig differ by {np.median(mismatches):.1%} of the set-point (root mean "
            f"square, median of {len(SEEDS)} seeds). The models are compared at",
        ),
        plots=(
            Plot(
                prose("pi-law.caption", code=code, setpoint_v=SETPOINT_V),
                svg,
            ),
        ),
        text=(_IMPLEMENTED,),
    )


def _claim(results: Results) -> Finding:
    mismatch = {code: [case.mismatch for case in cases(results, code)] for code in CODES}
    closer = {
        code: less(f"the rig is closer to {_BEST} than to {code}", mismatch[_BEST], mismatch[code])
        for code in _OTHER
    }
    rows = tuple(
        (
            code,
            made["type"],
            spread([100.0 * value for value in mismatch[code]], ".1f"),
            spread([100.0 * case.uncompensated_mismatch for case in cases(results, code)], ".0f"),
            spread([case.implemented_itae for case in cases(results, code)], ".2f"),
            p_text(closer[code].p_value) if code in closer else "",
        )
        for code, made in CODES.items()
    )
    heading = columns(prose("claim-4-1.columns", best=_BEST))
    return Finding(
        judged(
            statements=tuple(closer.values()),
            evidence=f"On the rig all laws have the compensation of {LEVEL_V:g} V: assumed.",
            reason="The models of the other types describe the compensated rig as well.",
        ),
        (SideBySide(f"Simulated and implemented step, {len(SEEDS)} seeds", heading, rows),),
        text=(_IMPLEMENTED,),
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
