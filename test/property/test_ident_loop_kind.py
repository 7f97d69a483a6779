from __future__ import annotations

import pytest

from flexarm_daq import RigParameters
from flexarm_daq.catalogue import catalogue, experiment
from flexarm_ident.feedback import is_closed_loop
from flexarm_reproduction.records import run_experiment

# One of each waveform, law and rate; the others take a minute.
FIRST = {
    *("O_dat2", "O_dat6", "O_dat11", "O_dat13", "B_dat4", "B_dat8"),
    *("C_dat3", "C_dat13", "R_dat1", "R_dat8", "R_dat10"),
}


@pytest.mark.parametrize(
    "name",
    [name if name in FIRST else pytest.param(name, marks=pytest.mark.slow) for name in catalogue()],
)
@pytest.mark.parametrize("noise_v", [0.0, 0.02])
def test_is_closed_loop___experiment_of_the_thesis___is_told_by_its_signals(
    name: str, noise_v: float
) -> None:
    entry = experiment(name)
    rig = RigParameters(payload_kg=entry.payload_kg, noise_v=(noise_v,) * 4)
    assert is_closed_loop(run_experiment(entry, rig, seed=1)) is entry.closed_loop
