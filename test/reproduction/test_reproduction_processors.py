"""The same figures on every processor: the kernels of its linear algebra are chosen by hand.

The whole of `reproduce all` takes minutes; these computations came out in two ways.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest

PROGRAM = """
import json
from reproduction.chapter3.trial import reduction_trial
from reproduction.chapter4.pi import pi_case

trials = [reduction_trial(code, "low", 2) for code in ("Ac11_18c", "Ao2_19")]
cases = [pi_case("Ac3r_10", 10), pi_case("Ac3r_10c", 12)]
ranks = [[(mode.mrm_rank, mode.msv_rank) for mode in trial.modes] for trial in trials]
kept = [{name: stage.kept for name, stage in trial.stages.items()} for trial in trials]
print(json.dumps([ranks, kept, [(case.kp, case.ki) for case in cases]]))
"""


def figures_with_kernels_of(processor: str) -> Any:  # noqa: ANN401 - whatever JSON has
    environment = os.environ | {"OPENBLAS_CORETYPE": processor}
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_ranks_and_gains___on_other_processors___are_the_same() -> None:
    assert figures_with_kernels_of("Haswell") == figures_with_kernels_of("Prescott")
