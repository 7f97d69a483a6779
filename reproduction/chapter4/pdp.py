"""Table 4-2, Figure 4-8 and claim 4-2: the PDP law on the models of Appendix B (section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from flexarm_control.design.margins import margins
from flexarm_control.design.tuning import tune_pdp
from flexarm_control.laws.gains import Compensation, PdpGains
from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.models.nominal_models import nominal_model, nominal_payloads_kg
from flexarm_ident.fitting.validation import frequency_response
from flexarm_ident.series.picture import (
    DASHED,
    DOTTED,
    SOLID,
    STYLE,
    figure_of,
    inline_svg,
    legend_above,
)
from reproduction.framework.findings import (
    LEVEL,
    SEEDS,
    Call,
    Finding,
    Judgement,
    Plot,
    SideBySide,
    columns,
    judged,
    p_text,
    prose,
    sign_test,
    subject,
    thesis_table,
)
from reproduction.framework.rig import STEP_S, step_to, step_trial
from reproduction.framework.study_rig import calm_rig

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from reproduction.framework.findings import Results


TRIAL_GAINS = PdpGains(0.5, 3.3, 0.07)
SAME_J = 0.005
"""The starting points lead to the same J when it differs by less than this share."""
CLOSE = 0.15
"""A gain agrees when it is within this share of the thesis's: the optimum is flat, and Appendix B
is printed to four decimals."""
_FREQUENCIES_HZ = np.geomspace(0.2, 30.0, 300)
_POSITION, _MIDDLE_STRAIN, _SPEED = 0, 2, 3
SIGNS = {False: "as printed", True: "y3 turned"}
_LOOKS = (SOLID, DASHED, DOTTED)


@dataclass(frozen=True)
class Tuned:
    """Tuned PDP law: Kp, Kd, Ksg, its J of (4-3) and the sums of (4-4) and (4-5).

    Margins are on each model, `active` are the constraints at the optimum, `criteria` the J of each
    starting point.
    """

    gains: tuple[float, float, float]
    criterion: float
    error_itae_sum: float
    strain_itae_sum: float
    gain_margins_db: tuple[float, ...]
    phase_margins_deg: tuple[float, ...]
    active: tuple[str, ...]
    criteria: tuple[float, ...]


def tuned_pdp(flipped: bool) -> Tuned:  # noqa: FBT001 - a call has plain arguments
    """Tune on the printed models from the thesis's starting points, y3 as printed or turned."""
    starts = [PdpGains(*start) for start in thesis_table("table_4_2")["starts"]]
    models = [
        nominal_model(payload_kg, flip_middle_strain=flipped)
        for payload_kg in nominal_payloads_kg()
    ]
    found = tune_pdp(models, starts=starts)
    return Tuned(
        (found.gains.kp, found.gains.kd, found.gains.ksg),
        found.criterion,
        sum(found.error_itae),
        sum(found.strain_itae),
        tuple(each.gain_margin_db for each in found.margins),
        tuple(each.phase_margin_deg for each in found.margins),
        found.active,
        tuple(each.criterion for each in found.searches),
    )


def loop_gain(payload_kg: float, frequencies_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return the loop (4-2) of a printed model with the trial gains."""
    response = frequency_response(nominal_model(payload_kg), frequencies_hz)[:, :, 0]
    inner = TRIAL_GAINS.ksg * response[:, _MIDDLE_STRAIN] + TRIAL_GAINS.kd * response[:, _SPEED]
    loop: NDArray[np.complex128] = TRIAL_GAINS.kp * response[:, _POSITION] / (1.0 + inner)
    return loop


def _table(results: Results) -> Finding:
    printed = thesis_table("table_4_2")
    found = {flipped: results[Call(tuned_pdp, (flipped,))] for flipped in SIGNS}
    thesis = (
        *(f"{printed[name]:.4f}" for name in ("kp", "kd", "ksg")),
        *(f"{printed[name]:.3f}" for name in ("criterion", "error_itae_sum", "strain_itae_sum")),
        f">= {printed['gain_margin_db']:g}",
        f">= {printed['phase_margin_deg']:g}",
        "",
    )
    error_sum, strain_sum = printed["error_itae_sum"], printed["strain_itae_sum"]
    found_cells = [
        (
            *(f"{gain:.4f}" for gain in each.gains),
            f"{each.criterion:.3f}",
            f"{each.error_itae_sum:.3f}",
            f"{each.strain_itae_sum:.3f}",
            f"{min(each.gain_margins_db):.1f}",
            f"{min(each.phase_margins_deg):.1f}",
            "; ".join(each.active),
        )
        for each in found.values()
    ]
    names = columns(prose("table-4-2.columns"))
    rows = tuple((name, *cells) for name, *cells in zip(names, thesis, *found_cells, strict=True))
    heading = ("", "thesis", *(f"ours, {words}" for words in SIGNS.values()))
    return Finding(
        tuning_judgement(found[False], found[True]),
        (SideBySide("Tuned gains, from three starting points", heading, rows),),
        text=(
            prose(
                "table-4-2.text",
                error_sum=error_sum,
                strain_sum=strain_sum,
                total=0.5 * (error_sum + strain_sum),
                criterion=printed["criterion"],
            ),
        ),
    )


def tuning_judgement(printed: Tuned, turned: Tuned) -> Judgement:
    """Judge Table 4-2: one optimum from all starts, and the thesis's gains and sums."""
    values = thesis_table("table_4_2")
    wanted = np.array([values[name] for name in ("kp", "kd", "ksg")])

    def one_optimum(tuned: Tuned) -> bool:
        return bool(np.ptp(tuned.criteria) <= SAME_J * min(tuned.criteria))

    def distance(tuned: Tuned) -> float:
        return float(np.max(np.abs(np.array(tuned.gains) / wanted - 1.0)))

    def sums(tuned: Tuned) -> tuple[float, float]:
        return (
            tuned.error_itae_sum / values["error_itae_sum"],
            tuned.strain_itae_sum / values["strain_itae_sum"],
        )

    same = one_optimum(printed) and one_optimum(turned)
    near = bool(np.all(np.abs(np.array(sums(printed)) - 1.0) <= CLOSE))
    error_sum, strain_sum = sums(turned)
    return judged(
        agrees=same and near and distance(printed) <= CLOSE,
        same_ranking=same and distance(turned) <= CLOSE,
        evidence=f"The three starts {'lead' if same else 'do not lead'} to one J within "
        f"{SAME_J:.1%}. With the sign of y3 turned the gains are within {distance(turned):.0%} "
        f"of the thesis's; {CLOSE:.0%} would agree. With the printed models one of them is off "
        f"by {distance(printed):.0%}: those behind Table 4-2 probably had the other sign. The sums "
        f"of E and Y are {error_sum:.2f} and {strain_sum:.2f} times the thesis's with y3 turned, "
        "{:.2f} and {:.2f} times as printed.".format(*sums(printed)),
        reason="Neither sign of the middle gauge leads to the printed gains.",
    )


def loop_margins() -> tuple[tuple[float, float, float], ...]:
    """Return payload, gain margin and phase margin of the trial gains on each printed model."""
    found = []
    for payload_kg in nominal_payloads_kg():
        each = margins(nominal_model(payload_kg), TRIAL_GAINS)
        found.append((payload_kg, each.gain_margin_db, each.phase_margin_deg))
    return tuple(found)


def _figure(results: Results) -> Finding:
    found = results[Call(loop_margins)]
    rows = tuple(
        (f"{1e3 * payload_kg:.0f} g", f"{gain_db:.1f}", f"{phase_deg:.1f}")
        for payload_kg, gain_db, phase_deg in found
    )
    return Finding(
        loop_judgement(found),
        (SideBySide("Margins", ("payload", "gain margin, dB", "phase margin, deg"), rows),),
        (
            Plot("Gain of the loop (4-2) with the trial gains", _loop_plot(phase=False)),
            Plot("Its phase", _loop_plot(phase=True)),
        ),
        (prose("figure-4-8.text", kp=TRIAL_GAINS.kp, kd=TRIAL_GAINS.kd, ksg=TRIAL_GAINS.ksg),),
    )


def loop_judgement(found: Sequence[tuple[float, float, float]]) -> Judgement:
    """Judge what the thesis reads off Figure 4-8."""
    gains_db = [gain_db for _, gain_db, _ in found]
    phases_deg = [phase_deg for _, _, phase_deg in found]
    both_fall = bool(np.all(np.diff(gains_db) < 0.0) and np.all(np.diff(phases_deg) < 0.0))
    phase_share, gain_share = phases_deg[-1] / phases_deg[0], gains_db[-1] / gains_db[0]
    return judged(
        agrees=both_fall and phase_share < gain_share,
        same_ranking=both_fall,
        evidence=f"From {1e3 * found[0][0]:.0f} to {1e3 * found[-1][0]:.0f} g the gain margin goes "
        f"from {gains_db[0]:.1f} to {gains_db[-1]:.1f} dB ({gain_share:.0%}), the phase margin "
        f"from {phases_deg[0]:.1f} to {phases_deg[-1]:.1f} deg ({phase_share:.0%}). Both "
        f"{'fall' if both_fall else 'do not fall'} with the payload, as the thesis says; that "
        "the phase margin is the more sensitive one "
        + ("holds for their shares." if phase_share < gain_share else "does not hold as a share."),
        reason="The printed models have other margins.",
    )


def _loop_plot(*, phase: bool) -> str:
    with mpl.rc_context(STYLE):
        figure = figure_of(2.2)
        axes = figure.subplots()
        for payload_kg, look in zip(nominal_payloads_kg(), _LOOKS, strict=True):
            loop = loop_gain(payload_kg, _FREQUENCIES_HZ)
            values = np.degrees(np.unwrap(np.angle(loop))) if phase else 20 * np.log10(np.abs(loop))
            axes.plot(_FREQUENCIES_HZ, values, label=f"{1e3 * payload_kg:.0f} g", **look)
        axes.set(xscale="log", xlabel="frequency, Hz", ylabel="phase, deg" if phase else "gain, dB")
        legend_above(axes)
        return inline_svg(figure, f"{'phase' if phase else 'gain'} of the loop over frequency")


PAYLOADS_KG = (0.0, 0.1, 0.2, 0.3, 0.4)
SETPOINT_V = 3.0
BASE = PdpGains()
LOUDER_DB = (0.0, 5.0, 15.0)
"""Increases of Kp: none, half of the margin of 10 dB, and beyond the margin."""
WELL = 0.1
"""A step goes well when it overshoots by less than this share and settles."""


def louder_steps(louder_db: float, seed: int) -> tuple[bool, ...]:
    """Tell of every payload whether its step goes well with Kp raised."""
    gains = PdpGains(BASE.kp * 10.0 ** (louder_db / 20.0), BASE.kd, BASE.ksg)
    trials = [
        step_trial(
            step_to(
                Pdpc(gains, Compensation()),
                SETPOINT_V,
                arm=calm_rig(payload_kg),
                seed=seed,
            )
        )
        for payload_kg in PAYLOADS_KG
    ]
    return tuple(each.overshoot < WELL and each.settling_s < STEP_S for each in trials)


def _claim(results: Results) -> Finding:
    shares = {
        louder_db: [
            sum(results[Call(louder_steps, (louder_db, seed))]) / len(PAYLOADS_KG) for seed in SEEDS
        ]
        for louder_db in LOUDER_DB
    }
    rows = tuple(
        (f"+{louder_db:g} dB", f"{sum(some) / len(some):.0%}") for louder_db, some in shares.items()
    )
    return Finding(
        margin_judgement(shares),
        (
            SideBySide(
                f"Steps of {SETPOINT_V:g} V that go well, 0 to 400 g, {len(SEEDS)} seeds",
                ("Kp", "steps that go well"),
                rows,
            ),
        ),
        text=(prose("claim-4-2.text", well=WELL, step_s=STEP_S),),
    )


def margin_judgement(shares: dict[float, list[float]]) -> Judgement:
    """Judge by the steps that go well with the whole margin, with half of it and with none."""
    whole, half, none = (shares[louder_db] for louder_db in LOUDER_DB)
    means = [sum(some) / len(some) for some in (whole, half, none)]
    p_value = max(sign_test(half, whole), sign_test(none, half))
    return judged(
        agrees=means[0] == 1.0 and p_value < LEVEL,
        same_ranking=means[0] > means[1] > means[2],
        evidence=f"{means[0]:.0%} of the steps go well as tuned, {means[1]:.0%} with Kp half the "
        f"margin higher, {means[2]:.0%} with Kp beyond it (each fewer, {p_text(p_value)}): what "
        "the margin leaves room for is a changed payload.",
        reason="Less margin does not make the steps worse.",
    )


SUBJECTS = (
    subject("table-4-2", tuple(Call(tuned_pdp, (flipped,)) for flipped in SIGNS), _table),
    subject("figure-4-8", (Call(loop_margins),), _figure),
    subject(
        "claim-4-2",
        tuple(Call(louder_steps, (louder_db, seed)) for louder_db in LOUDER_DB for seed in SEEDS),
        _claim,
    ),
)
