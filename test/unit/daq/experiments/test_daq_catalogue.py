"""The catalogue against the tables of Appendix A, and against what the file names say."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace

import pytest

from flexarm_core.rig_description import load_rig
from flexarm_daq.experiments.catalogue import (
    CatalogueError,
    Experiment,
    catalogue,
    experiment,
    on_rig,
)
from flexarm_daq.experiments.excitation import EXCITATIONS

# Name: datafile, samples, gains (kp, kd, c), payload in g, reference in V, period or range in s.
CLOSED_LOOP = """
C_dat1 Srl0_pd1 9600 1 2.8 0.8 0 2 8
C_dat2 Srl0_pd2 12000 1 2.8 0.9 0 3 10
C_dat3 Srl0_vc2 12000 1 2.8 0.7 0 3 2.5-5
C_dat4 Srl0_vc1 12000 1 2.8 0.9 0 2 2-4
C_dat5 Srl1_pd1 9600 1 2.8 0.9 200 2 8
C_dat6 Srl1_pd2 12000 1 2.8 0.9 200 3 10
C_dat7 Srl2_pd 12000 0.8 2.8 1.0 300 3 10
C_dat8 Srl2_pd1 12000 0.6 2.8 1.0 300 2 10
C_dat9 Srl2_pd2 12000 1 2.8 1.0 300 4 10
C_dat10 Srl2_pd3 9600 1 2.8 0.8 300 3 8
C_dat11 Srl2_pd4 12000 1 2.8 0.8 300 3 10
C_dat12 Srl2_pd5 9600 1 2.8 0.8 300 2 8
C_dat13 Srl3_pd1 12000 1 2.8 0.9 400 2 10
C_dat14 Srl3_pd2 12000 1 2.8 0.9 400 3 10
"""


def of_kind(kind: str) -> list[Experiment]:
    return [entry for entry in catalogue().values() if entry.kind == kind]


def test_catalogue___has_the_fifty_experiments_in_order() -> None:
    counts = {"O_dat": 14, "B_dat": 12, "C_dat": 14, "R_dat": 10}
    expected = [f"{kind}{n}" for kind, count in counts.items() for n in range(1, count + 1)]
    assert list(catalogue()) == expected


def test_open_loop___file_names_say_what_the_entries_are() -> None:
    waveforms = {"s": "square", "pr": "periodic_random", "pb": "varying_square", "r": "random"}
    for entry in of_kind("open_loop"):
        match = re.fullmatch(r"So_(s|pr|pb|r)([mh])(\d)(L?)", entry.file)
        assert match
        kind, rate, magnitude, long = match.groups()
        assert entry.waveform == waveforms[kind]
        assert entry.rate_hz == {"m": 300, "h": 500}[rate]
        assert entry.magnitude_v == float(magnitude)
        assert entry.length_s == pytest.approx(20.0 if long else 10.0)


def test_bounded___file_names_say_what_the_entries_are() -> None:
    for entry in of_kind("bounded"):
        match = re.fullmatch(r"Sb_([rs])([mh])(\d)", entry.file)
        assert match
        kind, rate, magnitude = match.groups()
        assert entry.waveform == {"r": "bounded_random", "s": "bounded_constant"}[kind]
        assert entry.rate_hz == {"m": 300, "h": 500}[rate]
        assert entry.magnitude_v == float(magnitude)
        assert entry.samples == 12000


@pytest.mark.parametrize("row", CLOSED_LOOP.strip().splitlines())
def test_closed_loop___is_as_in_table_a_3(row: str) -> None:
    name, file, samples, kp, kd, compensation, payload_g, reference, period = row.split()
    entry = experiment(name)

    assert (entry.kind, entry.law, entry.file) == ("closed_loop", "pd", file)
    assert (entry.samples, entry.rate_hz) == (int(samples), 300)
    assert entry.payload_kg == pytest.approx(float(payload_g) / 1000.0)
    assert entry.gains == {"kp": float(kp), "kd": float(kd), "compensation_v": float(compensation)}
    assert entry.profile["amplitude_v"] == float(reference)
    if "-" in period:
        assert entry.reference == "varying_square"
        assert [entry.profile["shortest_s"], entry.profile["longest_s"]] == [
            float(end) for end in period.split("-")
        ]
    else:
        assert (entry.reference, entry.profile["period_s"]) == ("square", float(period))


def test_controller_runs___have_the_laws_and_payloads_of_table_a_4() -> None:
    runs = of_kind("controller")

    assert Counter(run.law for run in runs) == {"pi": 4, "pdpc": 4, "ilqr": 2}
    loads = [(run.payload_kg, run.profile["amplitude_v"]) for run in runs]
    assert loads[4:] == [(0.4, 5), (0.0, 1), (0.2, 3), (0.4, 5), (0.3, 3), (0.3, 5)]
    assert [(run.gains["kp"], run.gains["ki"]) for run in runs[:4]] == [
        (0.3995, 0.0178),
        (0.3998, 0.0178),
        (1.1915, 5e-6),
        (1.2536, 0.0529),
    ]


def test_every_entry___has_either_a_waveform_or_a_law() -> None:
    for entry in catalogue().values():
        assert entry.closed_loop == (entry.waveform == "") == bool(entry.reference)
        assert entry.closed_loop or entry.waveform in EXCITATIONS


@pytest.mark.parametrize("name", ["C_dat3", "c_dat3", " C dat3 "])
def test_name___is_taken_as_people_write_it(name: str) -> None:
    assert experiment(name).name == "C_dat3"


def test_unknown_name___is_refused_with_what_there_is() -> None:
    with pytest.raises(CatalogueError, match=r"'X_dat1'; there are O_dat1 to O_dat14, B_dat1 to"):
        experiment("X_dat1")


def test_experiment___on_another_rig___has_its_rate_and_the_same_length() -> None:
    rig = load_rig("mujoco-two-link")
    entry = on_rig(experiment("B_dat1"), rig)
    assert entry.rate_hz == pytest.approx(500.0)
    assert entry.length_s == pytest.approx(experiment("B_dat1").length_s)
    assert on_rig(experiment("C_dat3"), load_rig("thesis")) is experiment("C_dat3")
    assert entry.input_text_on(rig) == "bounded random of 20 % of the limits"


def test_closed_loop___on_another_rig___asks_for_its_gains_and_distinguishes_joints() -> None:
    two = load_rig("mujoco-two-link")
    one = replace(two, joints=two.joints[:1])
    assert on_rig(experiment("C_dat2"), one).reference == "square"
    # Of several joints it is C_dat3, which has its amplitude and its longest half-period.
    entry = on_rig(experiment("C_dat2"), two)
    assert (entry.reference, entry.profile) == (
        experiment("C_dat3").reference,
        experiment("C_dat3").profile,
    )
    assert (entry.gains, entry.payload_kg) == ({}, 0.0)
    assert entry.length_s == pytest.approx(40.0)
    assert entry.input_text_on(two) == "pd, varying square of 44 % of the travel"


def test_controller_run___on_another_rig___is_its_reference_in_the_loop_of_the_rig() -> None:
    rig = load_rig("mujoco-two-link")
    for run in of_kind("controller"):
        entry = on_rig(run, rig)
        assert (entry.law, entry.gains) == ("pd", {})
        assert entry.profile["amplitude_v"] == run.profile["amplitude_v"]
    assert on_rig(experiment("R_dat8"), rig).input_text_on(rig) == "pd, step of 73 % of the travel"
