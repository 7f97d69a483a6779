"""Table 4-2, Figure 4-8 and claim 4-2: the PDP law on the models of Appendix B (section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import matplotlib as mpl
import numpy as np

from flexarm_control.design.margins import margins
from flexarm_control.design.tuning import tune_pdp
from flexarm_control.laws.gains import Compensation, PdpGains
from flexarm_control.laws.pdpc import Pdpc
from flexarm_control.models.nominal_models import nominal_model, nominal_payloads_kg
from flexarm_ident.fitting.validation import frequency_response
from reproduction.framework.findings import (
    SEEDS,
    Call,
    Finding,
    Plot,
    SideBySide,
    columns,
    prose,
    subject,
    thesis_table,
)
from reproduction.framework.picture import (
    DASHED,
    DOTTED,
    SOLID,
    STYLE,
    figure_of,
    inline_svg,
    legend_above,
)
from reproduction.framework.rig import STEP_S, step_to, step_trial
from reproduction.framework.study_rig import calm_rig, choices
from reproduction.framework.verdicts import (
    Beside,
    Judgement,
    all_of,
    always,
    exactly,
    judged,
    less,
)

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
    found = tune_pdp(models, starts=starts, duration_s=choices().criterion_s)
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
    model = nominal_model(payload_kg, flip_middle_strain=True)
    response = frequency_response(model, frequencies_hz)[:, :, 0]
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
                length_s=choices().criterion_s,
            ),
        ),
    )


def tuning_judgement(printed: Tuned, turned: Tuned) -> Judgement:
    """Judge Table 4-2: one optimum from all starts, and the thesis's gains and sums.

    The sign of y3 is the one with which the thesis's gains keep its own margins, see Appendix B.
    """
    values = thesis_table("table_4_2")
    names = ("kp", "kd", "ksg")

    def besides(tuned: Tuned) -> tuple[Beside, Beside]:
        sums = ("error_itae_sum", "strain_itae_sum")
        pairs = (names, tuned.gains), (sums, [getattr(tuned, name) for name in sums])
        return tuple(  # type: ignore[return-value]
            Beside(words, tuple(values[name] for name in keys), tuple(ours), 1.0 + CLOSE)
            for words, (keys, ours) in zip(("gains", "sums of E and Y"), pairs, strict=True)
        )

    gains, sums = besides(printed)
    spread_j = float(np.ptp(turned.criteria) / min(turned.criteria))
    return judged(
        figures=besides(turned),
        statements=(exactly("the three starts lead to one optimum", holds=spread_j <= SAME_J),),
        evidence=f"The sign of y3 is turned. As it is printed {gains.text}; {sums.text}.",
        reason=f"The sums are {turned.error_itae_sum / values['error_itae_sum']:.2f} and "
        f"{turned.strain_itae_sum / values['strain_itae_sum']:.2f} times the thesis's.",
    )


class LoopMargins(NamedTuple):
    """Margins of a payload, and the frequency up to which its loop has a gain above one, Hz."""

    payload_kg: float
    gain_db: float
    phase_deg: float
    bandwidth_hz: float


def loop_margins() -> tuple[LoopMargins, ...]:
    """Return the margins of the trial gains on each printed model, y3 turned."""
    found = []
    for payload_kg in nominal_payloads_kg():
        each = margins(nominal_model(payload_kg, flip_middle_strain=True), TRIAL_GAINS)
        bandwidth_hz = each.gain_crossings[-1].frequency_hz
        found.append(
            LoopMargins(payload_kg, each.gain_margin_db, each.phase_margin_deg, bandwidth_hz)
        )
    return tuple(found)


def _figure(results: Results) -> Finding:
    found = results[Call(loop_margins)]
    rows = tuple(
        (
            f"{1e3 * each.payload_kg:.0f} g",
            f"{each.gain_db:.1f}",
            f"{each.phase_deg:.1f}",
            f"{each.bandwidth_hz:.3f}",
        )
        for each in found
    )
    return Finding(
        loop_judgement(found),
        (
            SideBySide(
                "Margins, y3 turned",
                ("payload", "gain margin, dB", "phase margin, deg", "bandwidth, Hz"),
                rows,
            ),
        ),
        (
            Plot("Gain of the loop (4-2) with the trial gains", _loop_plot(phase=False)),
            Plot("Its phase", _loop_plot(phase=True)),
        ),
        (prose("figure-4-8.text", kp=TRIAL_GAINS.kp, kd=TRIAL_GAINS.kd, ksg=TRIAL_GAINS.ksg),),
    )


def loop_judgement(found: Sequence[LoopMargins]) -> Judgement:
    """Judge what the thesis reads off Figure 4-8."""
    gains_db, phases_deg = ([each[k] for each in found] for k in (1, 2))

    def falls(margins_: Sequence[float]) -> bool:
        return bool(np.all(np.diff(margins_) < 0.0))

    phase_share, gain_share = phases_deg[-1] / phases_deg[0], gains_db[-1] / gains_db[0]
    ratio_share = 10.0 ** ((gains_db[-1] - gains_db[0]) / 20.0)
    sensitive = {"gain in dB": gain_share, "gain as a ratio": ratio_share}
    return judged(
        statements=(
            exactly("the gain margin falls with the payload", holds=falls(gains_db)),
            exactly("the phase margin does", holds=falls(phases_deg)),
            all_of(
                "the phase margin is the more sensitive",
                [exactly(words, holds=phase_share < share) for words, share in sensitive.items()],
            ),
            exactly("the bandwidth falls", holds=falls([each.bandwidth_hz for each in found])),
        ),
        evidence=f"From 0 to {1e3 * found[-1].payload_kg:.0f} g the gain margin goes from "
        f"{gains_db[0]:.1f} to {gains_db[-1]:.1f} dB ({gain_share:.1%}; as a ratio "
        f"{ratio_share:.1%}), the phase margin from {phases_deg[0]:.1f} to "
        f"{phases_deg[-1]:.1f} deg ({phase_share:.1%}).",
        reason="The thesis prints no margins, and its models with payload contradict themselves: "
        "see Appendix B.",
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
        text=(
            prose(
                "claim-4-2.text",
                well=WELL,
                step_s=STEP_S,
                half_db=LOUDER_DB[1],
                beyond_db=LOUDER_DB[2],
            ),
        ),
    )


def margin_judgement(shares: dict[float, list[float]]) -> Judgement:
    """Judge by the steps that go well with the whole margin, with half of it and with none."""
    whole, half, none = (shares[louder_db] for louder_db in LOUDER_DB)
    means = [sum(some) / len(some) for some in (whole, half, none)]
    return judged(
        statements=(
            always("with the whole margin every step goes well", [each == 1.0 for each in whole]),
            less("with half of it fewer do", half, whole),
            less("without it fewer still", none, half),
        ),
        evidence=f"{means[0]:.0%} of the steps go well as tuned, {means[1]:.0%} with Kp half the "
        f"margin higher, {means[2]:.0%} with Kp beyond it: what the margin leaves room for is a "
        "changed payload.",
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
