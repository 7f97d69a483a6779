"""Peers of the bench on measured records."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import control
import numpy as np
import pytest

from bench.ident.arx import arx
from bench.ident.real import halves, judged
from flexarm_ident import IoData, validate_dmv
from support.benchmarks import run_bench
from support.ident_systems import random_model, record, square_wave

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("direct", [0.0, 0.7])
def test_arx___difference_equation_of_two_outputs___is_found(direct: float) -> None:
    rng = np.random.default_rng(3)
    first = np.array([[1.2, 0.1], [-0.2, 0.9]])
    second = np.array([[-0.5, 0.0], [0.1, -0.3]])
    now, before = np.full((2, 1), direct), np.array([[0.3], [-1.0]])
    u = rng.normal(size=(800, 1))
    y = np.zeros((800, 2))
    for k in range(2, 800):
        y[k] = first @ y[k - 1] + second @ y[k - 2] + now @ u[k] + before @ u[k - 1]
    noisy = y + 1e-6 * rng.normal(size=y.shape)

    data = IoData(u, noisy, dt_s=0.1, inputs=("u",), outputs=("a", "b"))

    assert validate_dmv(arx(data), data).error.max() < 1e-4


def test_halves___record_with_offsets___lose_the_means_of_the_first() -> None:
    data = record(random_model(1, states=4, outputs=2, inputs=1), 600, seed=1)
    shifted = replace(data, u=data.u + 2.0, y=data.y + np.array([3.0, -40.0]))
    for one, other in zip(halves(shifted), halves(data), strict=True):
        np.testing.assert_allclose(one.u, other.u, atol=1e-9)
        np.testing.assert_allclose(one.y, other.y, atol=1e-9)
    assert np.abs(halves(shifted)[0].y.mean(axis=0)).max() < 1e-9


def test_judged___true_model___misses_nothing() -> None:
    model = random_model(1, states=4, outputs=2, inputs=1)
    assert judged(model, record(model, 600, seed=1)) < 1e-6


@pytest.mark.slow
def test_bench_real___folder_of_two_records___has_a_row_for_each(tmp_path: Path) -> None:
    for seed in (1, 2):
        u = square_wave(700, seed)
        y = control.forced_response(random_model(seed, states=2, outputs=1, inputs=1), U=u.T).y[0]
        rows = np.column_stack([np.arange(700) / 100.0, u, y.T + 0.01])
        np.savetxt(tmp_path / f"{seed}.csv", rows, delimiter=",", header="t,u,y", comments="")
    file = tmp_path / "rows.json"

    done = run_bench("ident.real", str(tmp_path), "--json", str(file), XDG_CACHE_HOME=str(tmp_path))

    assert done.returncode == 0, done.stderr
    rows = json.loads(file.read_text("utf-8"))
    assert [row["file"] for row in rows] == ["1", "2"]
    assert all(row["default"] < 0.05 for row in rows)
    assert all(row["peers"]["arx"] < 0.05 for row in rows)
    assert "ahead of the best peer or within 5 %" in done.stdout


@pytest.mark.slow
@pytest.mark.exhaustive
def test_bench_real___empty_folder___is_refused(tmp_path: Path) -> None:
    done = run_bench("ident.real", str(tmp_path))
    assert done.returncode == 1
    assert "no CSV file is there" in done.stderr
