from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_control.models.nominal_models import nominal_model, nominal_payloads_kg
from flexarm_core.channels import POSITION_V_PER_RAD, SPEED_V_S_PER_RAD
from flexarm_daq.experiments.catalogue import catalogue
from reproduction.appendices import experiments, nominal_models, strain_sign
from reproduction.appendices.experiments import (
    RecordFacts,
    compare,
    controlled,
    excited,
    implemented,
)
from reproduction.appendices.nominal_models import FREQUENCIES_HZ, IdentifiedModel
from reproduction.appendices.strain_sign import Examined
from reproduction.chapter2 import excitation
from reproduction.chapter2.excitation import Signal
from reproduction.framework.findings import Finding, thesis_table
from reproduction.framework.verdicts import Verdict
from support.exhaustive import first_of

SUBJECTS = tuple(
    subject
    for module in (excitation, experiments, nominal_models, strain_sign)
    for subject in module.SUBJECTS
)
CHECKS = {
    1: ("open_loop", excited("open_loop")),
    2: ("bounded", excited("bounded")),
    3: ("closed_loop", controlled),
    4: ("controller", implemented),
}


def perfect_facts(kind: str) -> tuple[RecordFacts, ...]:
    """Facts of records that are what the catalogue says."""
    return tuple(
        RecordFacts(
            name=name,
            samples=entry.samples,
            rate_hz=entry.rate_hz,
            command_v=entry.magnitude_v,
            position_deg=30.0,
            reference_v=entry.profile.get("amplitude_v", 0.0),
            compensation_v=entry.gains.get("compensation_v", 0.0),
            kp=entry.gains.get("kp", 0.0),
            kd=entry.gains.get("kd", 0.0),
        )
        for name, entry in catalogue().items()
        if entry.kind == kind
    )


def catalogue_finding(number: int, **changed: float) -> Finding:
    """Set a table beside perfect facts, the first of which is changed."""
    kind, check = CHECKS[number]
    first, *others = perfect_facts(kind)
    return compare(number, (replace(first, **changed), *others), check, "")  # type: ignore[arg-type]


def test_thesis_values___tables_of_appendix_a___are_as_long_and_say_what_it_prints() -> None:
    tables = [thesis_table(f"table_a_{n}") for n in range(1, 5)]
    assert [len(table) for table in tables] == [14, 12, 14, 10]
    assert tables[0]["O_dat8"] == {
        "file": "So prh2",
        "length": 5000,
        "rate_hz": 500,
        "waveform": "periodic random",
        "magnitude_v": 2.0,
    }
    assert tables[1]["B_dat6"]["magnitude_v"] == 4.0
    assert tables[2]["C_dat8"]["kp"] == 0.6
    assert tables[2]["C_dat4"]["period_s"] == "2-4"
    assert tables[3]["R_dat10"]["purpose"] == "300g/5v controller performance"


@pytest.mark.parametrize("number", CHECKS)
def test_catalogue_table___records_as_the_thesis_lists_them___agree(number: int) -> None:
    finding = catalogue_finding(number)
    assert finding.judgement.verdict is Verdict.BY_CONSTRUCTION
    assert len(finding.tables[0].rows) == len(thesis_table(f"table_a_{number}"))


@pytest.mark.parametrize(
    ("number", "changed", "words"),
    [
        (1, {"samples": 2999}, "O_dat1, length: 3000 and 2999"),
        (1, {"command_v": 0.95}, "O_dat1, largest command, V: 1 and 0.95"),
        (2, {"rate_hz": 500.0}, "B_dat1, rate, Hz: 300 and 500"),
        (3, {"kd": 2.7}, "C_dat1, Kd: 2.8 and 2.7"),
        (3, {"compensation_v": 0.0}, "C_dat1, compensation, V: 0.8 and 0"),
    ],
)
def test_catalogue_table___other_record___differs_and_says_where(
    number: int, changed: dict[str, float], words: str
) -> None:
    judgement = catalogue_finding(number, **changed).judgement
    assert judgement.verdict is Verdict.DIFFERS
    assert words in judgement.because


def test_catalogue_table___arm_at_its_stops___is_said() -> None:
    assert "O_dat1 come to the end stops" in catalogue_finding(1, position_deg=80.5).text[0]


COMMANDS_V = np.array(excitation._COMMANDS_V)


@pytest.mark.parametrize(
    ("current_a", "verdict"),
    [
        (0.5 * np.clip(COMMANDS_V, -10.0, 10.0), Verdict.BY_CONSTRUCTION),
        (np.sign(COMMANDS_V) * np.abs(COMMANDS_V) ** 1.3, Verdict.DIFFERS),
        (0.5 * np.clip(COMMANDS_V, -6.0, 6.0), Verdict.DIFFERS),
    ],
)
def test_drive___line_curve_or_early_limit___is_reported(
    current_a: np.ndarray, verdict: Verdict
) -> None:
    finding = excitation.compare_drive(current_a.tolist())
    assert finding.judgement.verdict is verdict


def test_drive_characteristic___simulated_rig___is_linear_up_to_ten_volts() -> None:
    current_a = np.array(excitation.drive_characteristic())
    expected = 0.5 * np.clip(COMMANDS_V, -10.0, 10.0)
    np.testing.assert_allclose(current_a, expected, atol=0.02)


TIME_S = np.arange(3000) / 300.0
RANDOM = np.random.default_rng(1).uniform(0.1, 1.0, len(TIME_S))


def turning(hz: float, magnitude: np.ndarray | float = 1.0) -> Signal:
    sign = np.where((TIME_S * hz + 0.25) % 1.0 < 0.5, 1.0, -1.0)
    return Signal(TIME_S, 2.0 * magnitude * sign, np.zeros(len(TIME_S)))


def waveforms(
    square_hz: float = 0.5, varying_hz: float = 1.5, periodic: np.ndarray | float = RANDOM
) -> Finding:
    noise = Signal(TIME_S, np.random.default_rng(2).uniform(-2.0, 2.0, len(TIME_S)), TIME_S)
    signals = [turning(square_hz), turning(0.5, periodic), turning(varying_hz), noise]
    return excitation.compare_waveforms(signals)


def test_waveforms___as_section_2_4_1_says___agree() -> None:
    finding = waveforms()
    assert finding.judgement.verdict is Verdict.BY_CONSTRUCTION
    assert len(finding.plots) == 4


@pytest.mark.parametrize(
    ("changed", "words"),
    first_of(
        [
            ({"square_hz": 0.6}, "a: square"),
            ({"periodic": 1.0}, "b: periodic random"),
            ({"varying_hz": 4.0}, "c: varying square"),
        ]
    ),
)
def test_waveforms___one_of_another_kind___differs_and_is_named(
    changed: dict[str, float], words: str
) -> None:
    finding = waveforms(**changed)
    assert finding.judgement.verdict is Verdict.DIFFERS
    assert f"Not so: {words}." in finding.judgement.because


def bounded(turns_at_v: float, magnitude: np.ndarray | float) -> Signal:
    """Let the position go back and forth at 3 V per second, the command ahead of it."""
    period = 4.0 * turns_at_v / 3.0
    phase = (TIME_S + 1e-9) % period / period
    position = turns_at_v * (1.0 - np.abs(((phase + 0.25) % 1.0) * 4.0 - 2.0))
    outward = np.where((phase < 0.25) | (phase >= 0.75), 1.0, -1.0)
    return Signal(TIME_S, outward * magnitude, 1.0001 * position)


def test_bounded___turns_at_three_volts___agree() -> None:
    signals = [bounded(3.0, 3.0), bounded(3.0, RANDOM)]
    finding = excitation.compare_bounded(signals)
    assert finding.judgement.verdict is Verdict.BY_CONSTRUCTION, finding.judgement.because


@pytest.mark.parametrize(
    ("constant", "random"),
    [
        (bounded(2.5, 3.0), bounded(3.0, RANDOM)),
        (bounded(3.0, 3.0), bounded(3.5, RANDOM)),
        (bounded(3.0, RANDOM), bounded(3.0, RANDOM)),
    ],
)
def test_bounded___turns_elsewhere_or_other_magnitude___differs(
    constant: Signal, random: Signal
) -> None:
    finding = excitation.compare_bounded([constant, random])
    assert finding.judgement.verdict is Verdict.DIFFERS


def test_nominal_model___beside_itself___agrees() -> None:
    same = nominal_models.described(nominal_model(0.0))
    finding = nominal_models.compare(0.0, (same, same))
    assert finding.judgement.verdict is Verdict.AGREES
    assert len(finding.plots) == 4


@pytest.mark.parametrize("payload_kg", first_of(nominal_payloads_kg()[1:]))
def test_nominal_model___with_modes_that_a_mass_would_raise___is_not_comparable(
    payload_kg: float,
) -> None:
    same = nominal_models.described(nominal_model(payload_kg))
    judgement = nominal_models.compare(payload_kg, (same,)).judgement
    assert judgement.verdict is Verdict.NOT_COMPARABLE
    assert "a mass can only lower a frequency" in judgement.because


def changed(gain: float, mode: float = 1.0) -> IdentifiedModel:
    """Return the printed model without payload with all gains and its modes times a factor."""
    printed = nominal_models.described(nominal_model(0.0))
    modes = tuple((mode * frequency_hz, damping) for frequency_hz, damping in printed.modes)
    return IdentifiedModel(gain * printed.response, modes)


@pytest.mark.parametrize(
    ("ours", "verdict"),
    first_of(
        [
            (changed(1.35), Verdict.AGREES),
            (changed(1.5), Verdict.PARTLY),
            (changed(1.5, mode=1.2), Verdict.DIFFERS),
        ]
    ),
)
def test_nominal_model___beside_a_changed_one___is_reported(
    ours: IdentifiedModel, verdict: Verdict
) -> None:
    assert nominal_models.compare(0.0, (ours,)).judgement.verdict is verdict


def test_nominal_model___other_order_of_the_channels___does_not_agree() -> None:
    printed = changed(1.0)
    ours = IdentifiedModel(printed.response[:, ::-1], printed.modes)
    assert nominal_models.compare(0.0, (ours,)).judgement.verdict is Verdict.PARTLY


@pytest.mark.parametrize("off_db", [0.0, 4.0, -4.0])
def test_contradiction___speed_off_the_derivative___is_measured(off_db: float) -> None:
    position = 1.0 / (2j * np.pi * FREQUENCIES_HZ)
    factor = 10.0 ** (off_db / 20.0) * SPEED_V_S_PER_RAD / POSITION_V_PER_RAD
    response = np.stack([position, position, position, factor * np.ones_like(position)], axis=1)
    found = nominal_models.contradiction_db(IdentifiedModel(response, ()))
    np.testing.assert_allclose(found, abs(off_db), atol=1e-9)


GOOD = Examined(((11.0, 60.0),) * 3, ((11.0, 60.0),) * 3, 0.59, 4.3, 0.25, 3.4)


@pytest.mark.parametrize(
    ("printed", "turned", "verdict", "words"),
    [
        (GOOD, replace(GOOD, kp=0.1), Verdict.AGREES, "3 of 3"),
        (replace(GOOD, ksg=0.1), GOOD, Verdict.SAME_CONCLUSIONS, "3 of 3"),
        (replace(GOOD, ksg=0.1, slow=((9.0, 60.0),) * 3), GOOD, Verdict.DIFFERS, "other sign"),
        (
            replace(GOOD, slow=((11.0, 50.0),) * 3),
            replace(GOOD, kp=0.1),
            Verdict.DIFFERS,
            "does not explain",
        ),
    ],
)
def test_strain_sign___margins_and_gains___make_the_verdict(
    printed: Examined, turned: Examined, verdict: Verdict, words: str
) -> None:
    judgement = strain_sign.compare((printed, turned)).judgement
    assert judgement.verdict is verdict
    assert words in judgement.because


def test_subjects___appendices___are_those_of_the_issue() -> None:
    assert {each.key for each in SUBJECTS} == {
        "figure-2-2",
        "figure-2-5",
        "figure-2-10",
        *(f"table-a-{n}" for n in range(1, 5)),
        "appendix-b",
        *(f"appendix-b-{n}" for n in range(1, 4)),
    }
