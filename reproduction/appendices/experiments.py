"""Tables A-1 to A-4: the thesis's experiments beside the records of the simulated rig."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm_core.channels import POSITION_V_PER_RAD, TRAVEL_DEG
from flexarm_daq.experiments.catalogue import catalogue, experiment
from flexarm_ident.fitting.validation import recover_gains
from reproduction.framework.findings import (
    Call,
    Finding,
    SideBySide,
    Subject,
    prose,
    subject,
    thesis_table,
)
from reproduction.framework.rig import simulated_record
from reproduction.framework.verdicts import exactly, judged

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from flexarm_daq.experiments.catalogue import Experiment
    from reproduction.framework.findings import Results

    Check = Callable[[Mapping[str, Any], Experiment, "RecordFacts"], dict[str, tuple[str, str]]]


@dataclass(frozen=True)
class RecordFacts:
    """Facts measured in one record: largest magnitudes, and gains; zero without a law."""

    name: str
    samples: int
    rate_hz: float
    command_v: float
    position_deg: float
    reference_v: float = 0.0
    compensation_v: float = 0.0
    kp: float = 0.0
    kd: float = 0.0


def record_facts(kind: str, seed: int) -> tuple[RecordFacts, ...]:
    """Simulate every experiment of a kind of the catalogue and measure the records."""
    return tuple(_facts(name, seed) for name, entry in catalogue().items() if entry.kind == kind)


def _facts(name: str, seed: int) -> RecordFacts:
    record = simulated_record(name, seed, calm=True)
    effort = record.effort[:, 0]
    gains = recover_gains(record)
    return RecordFacts(
        name=name,
        samples=len(record),
        rate_hz=1.0 / record.dt_s,
        command_v=float(np.abs(effort).max()),
        position_deg=float(np.degrees(np.abs(record.y[:, 0]).max() / POSITION_V_PER_RAD)),
        reference_v=_largest(record.reference),
        compensation_v=_largest(record.compensation),
        kp=gains.kp if gains else 0.0,
        kd=gains.kd if gains else 0.0,
    )


def _largest(values: np.ndarray | None) -> float:
    return 0.0 if values is None else float(np.abs(values).max())


SEED = 1
TOLERANCE = 0.01
"""Commands and gains agree within this: a random command comes near its bound, hardly upon it."""
_PURPOSE = re.compile(r"(\d+)g/(\d+)v")
_LAWS = {"PI with optimal gains": "pi", "PDPC with optimal gains": "pdpc", "ILQR control": "ilqr"}
_SETTINGS = f"The record is one of the simulated rig, seed {SEED}; what it shows is measured in it."


def excited(kind: str) -> Check:
    """Return the check of Tables A-1 and A-2, of which the second names the magnitude only."""
    prefix = "bounded_" if kind == "bounded" else ""

    def check(
        thesis: Mapping[str, Any], entry: Experiment, facts: RecordFacts
    ) -> dict[str, tuple[str, str]]:
        return {
            "length": (f"{thesis['length']}", f"{facts.samples}"),
            "rate, Hz": (f"{thesis['rate_hz']}", f"{facts.rate_hz:.0f}"),
            "waveform": (thesis["waveform"], entry.waveform.removeprefix(prefix).replace("_", " ")),
            "largest command, V": _near(thesis["magnitude_v"], facts.command_v),
        }

    return check


def controlled(
    thesis: Mapping[str, Any], entry: Experiment, facts: RecordFacts
) -> dict[str, tuple[str, str]]:
    """Check a row of Table A-3."""
    profile = entry.profile
    period = (
        f"{profile['period_s']:g}"
        if "period_s" in profile
        else f"{profile['shortest_s']:g}-{profile['longest_s']:g}"
    )
    return {
        "Kp": _near(thesis["kp"], facts.kp),
        "Kd": _near(thesis["kd"], facts.kd),
        "payload, g": (f"{thesis['payload_g']}", f"{1e3 * entry.payload_kg:.0f}"),
        "length": (f"{thesis['length']}", f"{facts.samples}"),
        "reference, V": _near(thesis["reference_v"], facts.reference_v),
        "period, s": (f"{thesis['period_s']}", period),
        "compensation, V": _near(thesis["compensation_v"], facts.compensation_v),
    }


def implemented(
    thesis: Mapping[str, Any], entry: Experiment, facts: RecordFacts
) -> dict[str, tuple[str, str]]:
    """Check a row of Table A-4, as far as it says something."""
    pairs = {"law": (_LAWS[thesis["controller"]], entry.law)}
    found = _PURPOSE.search(thesis["purpose"])
    if found:
        pairs["payload, g"] = (found[1], f"{1e3 * entry.payload_kg:.0f}")
        pairs["reference, V"] = _near(float(found[2]), facts.reference_v)
    for gain in ("kp", "ki"):
        if gain in thesis:
            pairs[gain.capitalize()] = _near(thesis[gain], entry.gains[gain])
    return pairs


def compare(number: int, facts: tuple[RecordFacts, ...], check: Check, note: str) -> Finding:
    """Set a table beside the records; `check` gives the thesis's text and ours of each quantity."""
    table = thesis_table(f"table_a_{number}")
    by_name = {each.name: each for each in facts}
    checked = {name: check(row, experiment(name), by_name[name]) for name, row in table.items()}
    headings = tuple(dict.fromkeys(what for pairs in checked.values() for what in pairs))
    wrong = [
        f"{name}, {what}: {thesis} and {ours}"
        for name, pairs in checked.items()
        for what, (thesis, ours) in pairs.items()
        if thesis != ours
    ]
    rows = tuple(
        (
            name,
            table[name]["file"],
            *(_cell(pairs.get(what)) for what in headings),
            f"{by_name[name].position_deg:.0f}",
        )
        for name, pairs in checked.items()
    )
    far = [each.name for each in facts if each.position_deg >= TRAVEL_DEG]
    stops = f" {', '.join(far)} come to the end stops at {TRAVEL_DEG:g} degrees." if far else ""
    compared = sum(map(len, checked.values()))
    return Finding(
        judged(
            statements=(exactly("every entry is that of the thesis", holds=not wrong),),
            evidence=f"{compared - len(wrong)} of {compared} entries are those of the thesis.",
            reason="Other are: " + "; ".join(wrong) + ".",
            by_construction=True,
        ),
        tables=(
            SideBySide(
                "Where ours differs, a cell has the thesis's value first and ours after an arrow",
                ("experiment", "file", *headings, "farthest, deg"),
                rows,
            ),
        ),
        text=(f"{_SETTINGS} {note}{stops}",),
    )


def _near(thesis: float, ours: float) -> tuple[str, str]:
    """Return both as text, the same one when they agree."""
    is_near = abs(ours - thesis) <= TOLERANCE * abs(thesis)
    return f"{thesis:g}", f"{thesis:g}" if is_near else f"{ours:.4g}"


def _cell(pair: tuple[str, str] | None) -> str:
    if pair is None:
        return ""
    thesis, ours = pair
    return thesis if thesis == ours else f"{thesis} -> {ours}"


def _subject(number: int, kind: str, check: Check) -> Subject:
    call = Call(record_facts, (kind, SEED))

    def build(results: Results) -> Finding:
        note = prose(f"table-a-{number}.note", tolerance=TOLERANCE)
        return compare(number, results[call], check, note)

    return subject(f"table-a-{number}", (call,), build)


SUBJECTS = (
    _subject(1, "open_loop", excited("open_loop")),
    _subject(2, "bounded", excited("bounded")),
    _subject(3, "closed_loop", controlled),
    _subject(4, "controller", implemented),
)
