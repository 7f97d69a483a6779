"""Defects of how a bag was recorded reach whoever identifies a model from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident import identify, job, read_bag
from flexarm_ident.job import identify_bags
from flexarm_ident.reading.read import stream_bag
from flexarm_ident.workflow.request import Request
from support.bag_samples import START_NS, io_sample, write_bag
from support.ident_systems import random_model, step_by_step

if TYPE_CHECKING:
    from pathlib import Path

STEP_NS = 10_000_000
SAMPLES = 900
REQUEST = Request(order=4, block_rows=10, method="orse", train_fraction=1.0)


def a_bag(path: Path, *, lost: tuple[int, ...] = (), scatter_ns: float = 0.0) -> Path:
    rng = np.random.default_rng(1)
    u = rng.standard_normal((SAMPLES, 1))
    y = step_by_step(random_model(1, states=4, outputs=2, inputs=1), u)
    y += 0.01 * rng.standard_normal(y.shape)
    off_ns = rng.normal(0.0, scatter_ns, SAMPLES).astype(int).tolist()
    return write_bag(
        path,
        [
            io_sample(k + 1, START_NS + k * STEP_NS + off_ns[k], u[k], y[k])
            for k in range(SAMPLES)
            if k not in lost
        ],
    )


def names(bag: Path) -> dict[str, dict[str, float]]:
    found = identify(read_bag(bag), order=4, block_rows=10, method="orse")
    assert all(str(warning).startswith(f"{bag.name}: ") for warning in found.data_warnings)
    assert {f"{each.grade}: {each}" for each in found.data_warnings} <= set(found.warnings)
    return {warning.code: dict(warning.figures) for warning in found.data_warnings}


def test_identify___clean_bag___has_no_timing_warning(tmp_path: Path) -> None:
    assert names(a_bag(tmp_path / "run")) == {}


def test_identify___bag_with_lost_samples___names_them(tmp_path: Path) -> None:
    found = names(a_bag(tmp_path / "run", lost=(100, 101, 250)))
    assert found == {
        "lost_samples": {
            "lost": 3.0,
            "missing": 3.0,
            "rows": SAMPLES,
            "holes": 2.0,
            "longest": 2.0,
            "left_out": 0.0,
        }
    }


def test_identify___bag_of_a_jittering_clock___names_it(tmp_path: Path) -> None:
    found = names(a_bag(tmp_path / "run", scatter_ns=0.15 * STEP_NS))
    expected_s = 0.15e-9 * STEP_NS
    assert found["sampling"]["deviation_s"] == pytest.approx(expected_s, rel=0.1)


@pytest.mark.parametrize("streamed", [False, True])
@pytest.mark.slow
def test_identify_bags___lost_samples___are_among_the_warnings_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, streamed: bool
) -> None:
    if streamed:
        monkeypatch.setattr(job, "LARGEST_IN_MEMORY", SAMPLES // 2)
    bag = a_bag(tmp_path / "run", lost=(100,))
    outcome = identify_bags([bag], tmp_path / "out", REQUEST).outcome
    said = [
        warning for warning in outcome.warnings if "1 of 900 periods is without a sample" in warning
    ]
    assert len(said) == 1
    (lost,) = (
        warning
        for warning in outcome.identification.data_warnings
        if warning.code == "lost_samples"
    )
    assert lost.figures["missing"] == lost.figures["holes"] == 1.0
    assert lost.figures["rows"] == SAMPLES


def test_stream_bag___lost_samples_and_jitter___same_notices_as_in_memory(tmp_path: Path) -> None:
    bag = a_bag(tmp_path / "run", lost=(100, 500), scatter_ns=0.15 * STEP_NS)
    assert {"lost_samples", "sampling"} <= {notice.code for notice in read_bag(bag).notices}
    assert stream_bag(bag).notices == read_bag(bag).notices
