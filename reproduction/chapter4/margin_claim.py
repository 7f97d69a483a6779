"""The claim that ample margins make the loop robust (section 4.5, item 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_control.laws.gains import Compensation, PdpGains
from flexarm_control.laws.pdpc import Pdpc
from flexarm_daq import RigParameters
from reproduction.framework.evidence import LEVEL, SEEDS, p_text, sign_test
from reproduction.framework.findings import Finding, Judgement, SideBySide, judged
from reproduction.framework.law_runs import STEP_S, step_to, step_trial
from reproduction.framework.subjects import Call, Subject

if TYPE_CHECKING:
    from reproduction.framework.subjects import Results

PAYLOADS_KG = (0.0, 0.1, 0.2, 0.3, 0.4)
SETPOINT_V = 3.0
BASE = PdpGains()
LOUDER_DB = (0.0, 5.0, 15.0)
"""How much Kp is raised: not, by half of the margin of 10 dB, and beyond it."""
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
                arm=RigParameters(payload_kg=payload_kg),
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
                f"Steps of {SETPOINT_V:g} V that go well, 0 to 400 g, 20 seeds",
                ("Kp", "steps that go well"),
                rows,
            ),
        ),
        text=(
            (
                "PDPC with the gains of Table 4-2, whose margins are 7 to 10 dB on the printed "
                "models, with all payloads. Then the margin is used up: Kp is raised. Friction "
                "brings the arm to rest even beyond the margin, after many swings: so a step goes "
                "well when it overshoots by less than 10 % and settles within 10 s."
            ),
        ),
    )


def margin_judgement(shares: dict[float, list[float]]) -> Judgement:
    """Judge by the steps that go well with the whole margin, with half of it and with none."""
    whole, half, none = (shares[louder_db] for louder_db in LOUDER_DB)
    means = [sum(some) / len(some) for some in (whole, half, none)]
    p_value = max(sign_test(half, whole), sign_test(none, half))
    return judged(
        agrees=means[0] == 1.0 and p_value < LEVEL,
        same_ranking=means[0] > means[1] > means[2],
        evidence=(
            f"{means[0]:.0%} of the steps go well as tuned, {means[1]:.0%} with Kp half the margin "
            f"higher, {means[2]:.0%} with Kp beyond it (each fewer, {p_text(p_value)}): what the "
            "margin leaves room for is a changed payload."
        ),
        reason="Less margin does not make the steps worse.",
    )


SUBJECTS = (
    Subject(
        "claim-4-2",
        "Ample gain and phase margins make the loop robust",
        tuple(Call(louder_steps, (louder_db, seed)) for louder_db in LOUDER_DB for seed in SEEDS),
        _claim,
    ),
)
