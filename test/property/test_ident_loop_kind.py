from __future__ import annotations

import pytest

from flexarm_daq import RigParameters
from flexarm_daq.experiments.catalogue import catalogue, experiment
from flexarm_ident.subspace.loop_test import is_closed_loop
from reproduction.framework.rig import run_experiment

# One of each waveform, law and rate.
EACH_KIND = (
    *("O_dat2", "O_dat6", "O_dat11", "O_dat13", "B_dat4", "B_dat8"),
    *("C_dat3", "C_dat13", "R_dat1", "R_dat8", "R_dat10"),
)


def is_judged_right(name: str, noise_v: float) -> bool:
    entry = experiment(name)
    rig = RigParameters(payload_kg=entry.payload_kg, noise_v=(noise_v,) * 4)
    return is_closed_loop(run_experiment(entry, rig, seed=1)) is entry.closed_loop


@pytest.mark.parametrize(
    "name",
    [
        name if name in EACH_KIND else pytest.param(name, marks=pytest.mark.exhaustive)
        for name in catalogue()
    ],
)
def test_is_closed_loop___experiment_of_the_thesis___is_told_by_its_signals(name: str) -> None:
    assert is_judged_right(name, 0.02)


@pytest.mark.parametrize("name", EACH_KIND)
def test_is_closed_loop___converters_alone_as_noise___are_enough(name: str) -> None:
    assert is_judged_right(name, 0.0)
