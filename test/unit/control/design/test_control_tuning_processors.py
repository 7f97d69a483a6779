"""The same gains on every processor: the kernels of its linear algebra are chosen by hand."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

PROGRAM = """
import json
from flexarm_control import nominal_model, tune_pdp, tune_pi

models = [nominal_model(payload_kg) for payload_kg in (0.0, 0.2, 0.4)]
tuned = [tune_pi(model).gains for model in models]
print(json.dumps([*(list(vars(gains).values()) for gains in (*tuned, tune_pdp(models).gains))]))
"""
FAR_BELOW_SHOWN = 1e-7
"""Gains are shown with four decimals at most."""


def gains_with_kernels_of(processor: str) -> list[list[float]]:
    environment = os.environ | {"OPENBLAS_CORETYPE": processor}
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    found: list[list[float]] = json.loads(done.stdout)
    return found


@pytest.mark.slow
@pytest.mark.exhaustive
def test_tuned_gains___on_other_processors___are_the_same_far_below_the_digits_shown() -> None:
    one, other = map(gains_with_kernels_of, ("Haswell", "Prescott"))
    for ours, theirs in zip(one, other, strict=True):
        assert np.allclose(ours, theirs, rtol=0.0, atol=FAR_BELOW_SHOWN)
