"""The example bags are what the manifest says."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np
import pytest

from flexarm_daq.rigs.beam import natural_frequencies_hz
from flexarm_daq.rigs.rig_parameters import RigParameters
from flexarm_ident import read_bag_report
from support.project import BAGS

ENTRIES = json.loads((BAGS / "manifest.json").read_text())


def test_manifest___names_every_bag_and_no_other() -> None:
    assert {entry["bag"] for entry in ENTRIES} == {
        path.name for path in BAGS.iterdir() if path.is_dir()
    }


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry["bag"])
def test_bag___files___have_the_recorded_hash(entry: dict[str, Any]) -> None:
    folder = BAGS / entry["bag"]
    found = {f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in folder.iterdir()}
    assert found == entry["files"]


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry["bag"])
def test_bag___samples_and_rate___are_as_stated(entry: dict[str, Any]) -> None:
    reading = read_bag_report(BAGS / entry["bag"])
    assert (reading.samples, reading.lost) == (entry["samples"], 0)
    assert reading.data.dt_s == pytest.approx(1.0 / entry["rate_hz"], rel=1e-9)


@pytest.mark.parametrize(
    "entry", [e for e in ENTRIES if "true_modes_hz" in e], ids=lambda entry: entry["bag"]
)
def test_bag___true_modes___belong_to_its_payload(entry: dict[str, Any]) -> None:
    modes_hz = natural_frequencies_hz(RigParameters(payload_kg=entry["payload_kg"]))
    np.testing.assert_allclose(entry["true_modes_hz"], modes_hz, rtol=1e-3)
