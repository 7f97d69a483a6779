"""The same samples on every processor: the kernels of its linear algebra are chosen by hand."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

PROGRAM = """
import hashlib
import numpy as np
from flexarm_control.laws.registry import build_law
from flexarm_control.simulation import simulate
from flexarm_daq import RigParameters, SimulatedRig
from flexarm_daq.rigs.plant import Plant

digest = hashlib.sha256()
for law, gains in (("pd", {"kp": 1.0, "kd": 2.8, "compensation_v": 0.8}), ("ilqr", {})):
    rig = SimulatedRig(RigParameters(payload_kg=0.3), seed=1)
    reference_v = 3.0 * np.sign(np.sin(np.arange(1500) / 200.0))
    run = simulate(rig, build_law(law, gains), reference_v)
    digest.update(run.y.tobytes() + run.command_v.tobytes())
    rig.change_payload(0.1)
    rig.read()
    digest.update(rig.outputs_v().tobytes())
print(digest.hexdigest())
"""


def hash_with_kernels_of(processor: str) -> str:
    environment = os.environ | {"OPENBLAS_CORETYPE": processor}
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout


@pytest.mark.slow
def test_closed_loop___on_other_processors___gives_the_same_samples() -> None:
    assert hash_with_kernels_of("Haswell") == hash_with_kernels_of("Prescott")
