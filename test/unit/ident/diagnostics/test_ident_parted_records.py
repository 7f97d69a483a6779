"""Defects of records that are parted at holes, or whose drive was held."""

from __future__ import annotations

import warnings as python_warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import IoData
from flexarm_ident.diagnostics.quality import assess
from flexarm_ident.records.unknown_inputs import known_parts
from flexarm_ident.subspace.gram import block_gram
from support.ident_systems import random_model, record

DT_S = 0.01


def wandering(offset: float) -> IoData:
    """Return a hub that wanders slowly through its travel, with holes every 3 s."""
    rng = np.random.default_rng(2)
    u = rng.choice([-1.0, 1.0], 3000).astype(float)
    y = offset + 3.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 3000)) + 0.02 * rng.normal(size=3000)
    y += signal.lfilter([0.0, 0.05], [1.0, -0.8], u)
    held = np.zeros(3000, dtype=np.bool_)
    for first in range(295, 3000, 300):
        held[first : first + 5] = True
    y[held] = np.nan
    return IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=("y",), source="run", input_held=held)


@pytest.mark.parametrize(("offset", "named"), [(0.0, 0), (100.0, 1)])
def test_assess___signal_that_wanders___offset_is_that_of_the_whole_record(
    offset: float, named: int
) -> None:
    parts = known_parts(wandering(offset))
    assert len(parts) > 5
    found = [each for each in assess(parts, block_gram(parts, 10)) if each.code == "offset"]
    assert [each.record for each in found] == ["run"] * named
    for each in found:
        assert each.figures["mean"] == pytest.approx(offset, abs=0.3)


def test_assess___records_of_their_own___each_is_judged_for_its_offset() -> None:
    first, second = wandering(0.0), replace(wandering(100.0), source="other")
    found = assess([first, second], block_gram([first, second], 10))
    assert [each.record for each in found if each.code == "offset"] == ["other"]


def test_assess___drive_held_but_in_a_short_stretch___is_reported_without_a_warning_of_numpy() -> (
    None
):
    data = record(random_model(7, inputs=1), 1000, seed=4, noise=0.01)
    u, y = data.u.copy(), data.y.copy()
    u[15:] = 0.0
    y[15:20] = np.nan
    held = replace(data, u=u, y=y)
    with python_warnings.catch_warnings():
        python_warnings.simplefilter("error")
        found = {each.code: each for each in assess([held], block_gram([held], 20))}
    assert found["excitation"].figures["condition"] == np.inf
