"""Appendix B as a whole: the margins of the thesis's gains, and the sign of the middle gauge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from flexarm_control.design.margins import margins
from flexarm_control.laws.gains import PdpGains
from flexarm_control.models.nominal_models import nominal_model, nominal_payloads_kg
from reproduction.chapter4.pdp import CLOSE, SIGNS, tuned_pdp
from reproduction.framework.findings import (
    Call,
    Finding,
    SideBySide,
    Subject,
    prose,
    subject,
    thesis_table,
)
from reproduction.framework.verdicts import Beside, exactly, judged

if TYPE_CHECKING:
    from reproduction.framework.findings import Results

CROSSINGS_FROM_HZ = 0.2
"""Below it the printed slow poles, known to four decimals, add crossings without meaning."""
_GAINS = ("kp", "kd", "ksg")
Pairs: TypeAlias = tuple[tuple[float, float], ...]
"""Gain margin in dB and phase margin in degrees, per payload."""


@dataclass(frozen=True)
class Examined:
    """Margins of the thesis's gains on the three models, and the best gains on them.

    Margins are per payload: at the lowest crossings, of the rigid motion, and the least of all.
    """

    slow: Pairs
    least: Pairs
    kp: float
    kd: float
    ksg: float
    criterion: float


def thesis_margins(flipped: bool) -> tuple[Pairs, Pairs]:  # noqa: FBT001 - a call has plain arguments
    """Return the margins of the thesis's gains per payload: of the rigid motion, and the least."""
    gains = PdpGains(**thesis_table("appendix_b")["optimum"])
    found = [
        margins(
            nominal_model(payload_kg, flip_middle_strain=flipped),
            gains,
            lowest_hz=CROSSINGS_FROM_HZ,
        )
        for payload_kg in nominal_payloads_kg()
    ]
    return (
        tuple((each.phase_crossings[0].margin, each.gain_crossings[0].margin) for each in found),
        tuple((each.gain_margin_db, each.phase_margin_deg) for each in found),
    )


def compare(found: tuple[Examined, ...]) -> Finding:
    """Set the thesis's margins and optimum beside those on its models, y3 as printed and turned."""
    values = thesis_table("appendix_b")
    printed, turned = found
    kept = _kept(printed, values)
    distances = [_gains_beside(each, values["optimum"]).distance for each in found]
    return Finding(
        judged(
            figures=(_gains_beside(printed, values["optimum"]),),
            statements=(
                exactly("the thesis's gains keep its margins", holds=kept == len(printed.slow)),
            ),
            evidence=f"On the printed models the gains of Table 4-2 keep the margins of section "
            f"4.2 for {kept} of {len(printed.slow)} payloads, and the best gains are "
            f"{_gains(printed)}.",
            reason=_reason(turned, nearer=distances[1] < distances[0]),
        ),
        tables=(_margin_table(found, values), _gain_table(found, values["optimum"])),
        text=(prose("appendix-b.text"),),
    )


def _gains_beside(found: Examined, optimum: dict[str, float]) -> Beside:
    ours = (found.kp, found.kd, found.ksg)
    return Beside("best gains", tuple(optimum[name] for name in _GAINS), ours, 1.0 + CLOSE)


def _reason(turned: Examined, *, nearer: bool) -> str:
    gain_db, phase_deg = np.min(turned.slow, axis=0)
    least_db, least_deg = np.min(turned.least, axis=0)
    found = f"With the sign of the middle gauge turned, the best gains are {_gains(turned)}"
    if not nearer:
        return f"{found}, no nearer to the thesis's: that sign does not explain it."
    return prose(
        "appendix-b.reason",
        found=found,
        gain_db=gain_db,
        phase_deg=phase_deg,
        least_db=least_db,
        least_deg=least_deg,
    )


def _gains(found: Examined) -> str:
    return f"{found.kp:.2f}, {found.kd:.2f}, {found.ksg:.3f}"


def _kept(found: Examined, values: dict[str, Any]) -> int:
    needed = tuple(values["margins"].values())
    return sum(bool(np.all(np.array(margin) >= needed)) for margin in found.slow)


def _margin_table(found: tuple[Examined, ...], values: dict[str, Any]) -> SideBySide:
    gain_db, phase_deg = values["margins"].values()
    rows = [
        (
            f"{1e3 * payload_kg:.0f} g",
            f"at least {gain_db:g} dB, {phase_deg:g} deg",
            *(
                f"{margin[i][0]:.1f} dB, {margin[i][1]:.1f} deg"
                for each in found
                for margin in (each.slow, each.least)
            ),
        )
        for i, payload_kg in enumerate(nominal_payloads_kg())
    ]
    headings = [f"{sign}, {which}" for sign in SIGNS.values() for which in ("rigid", "least")]
    return SideBySide(
        "Margins of the thesis's gains: at the crossings of the rigid motion, and the least of all",
        ("payload", "thesis", *headings),
        tuple(rows),
    )


def _gain_table(found: tuple[Examined, ...], optimum: dict[str, float]) -> SideBySide:
    rows = [
        (name.capitalize(), f"{value:.4f}", *(f"{getattr(each, name):.3f}" for each in found))
        for name, value in optimum.items()
    ]
    rows.append(("J", "see Table 4-2", *(f"{each.criterion:.2f}" for each in found)))
    return SideBySide("Best gains on the models", ("", "thesis", *SIGNS.values()), tuple(rows))


_MARGINS = {flipped: Call(thesis_margins, (flipped,)) for flipped in SIGNS}
_TUNED = {flipped: Call(tuned_pdp, (flipped,)) for flipped in SIGNS}


def _build(results: Results) -> Finding:
    found = []
    for flipped in SIGNS:
        slow, least = results[_MARGINS[flipped]]
        best = results[_TUNED[flipped]]
        kp, kd, ksg = best.gains
        found.append(Examined(slow, least, kp, kd, ksg, best.criterion))
    return compare(tuple(found))


SUBJECTS: tuple[Subject, ...] = (
    subject("appendix-b", (*_MARGINS.values(), *_TUNED.values()), _build),
)
