from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexarm_ident import DataError, IoData
from flexarm_ident.records.holes import filled, filled_pieces, unusable_rows


def test_filled___short_holes_in_a_cubic___are_exact() -> None:
    t = np.arange(40.0)
    y = np.stack([1.0 + t - 0.1 * t**2 + 2e-3 * t**3, t], axis=1)
    missing = np.zeros(y.shape, dtype=bool)
    missing[[10, 14, 15, 20, 21, 22], 0] = True
    damaged = np.where(missing, 99.0, y)
    np.testing.assert_allclose(filled(damaged, missing), y, rtol=1e-10)


def test_filled___long_hole_and_edges___line_and_nearest_value() -> None:
    y = np.arange(20.0)[:, np.newaxis] ** 2
    missing = np.zeros((20, 1), dtype=bool)
    missing[[0, 1, *range(8, 13), 19]] = True
    whole = filled(y, missing)[:, 0]
    assert whole[:2].tolist() == pytest.approx([4.0, 4.0])
    assert whole[19] == pytest.approx(18.0**2)
    np.testing.assert_allclose(whole[7:14], np.linspace(49.0, 169.0, 7))


def test_unusable_rows___runs_of_any_channel___only_long_ones_and_edges() -> None:
    missing = np.zeros((30, 2), dtype=bool)
    missing[5:8, 0] = missing[12:16, 1] = missing[28:, 0] = True
    assert np.flatnonzero(unusable_rows(missing)).tolist() == [12, 13, 14, 15, 28, 29]


@settings(max_examples=60)
@given(st.integers(0, 2**32), st.floats(0.0, 0.5), st.lists(st.integers(1, 40), min_size=1))
@pytest.mark.slow
def test_filled_pieces___any_pieces___are_those_of_the_whole(
    seed: int, share: float, lengths: list[int]
) -> None:
    rng = np.random.default_rng(seed)
    y, u = rng.normal(size=(300, 2)), rng.normal(size=(300, 1))
    y[rng.random(y.shape) < share] = np.nan
    y[120 : 120 + int(rng.integers(0, 40))] = np.nan
    y[0, :] = 0.0
    edges = np.cumsum([0, *lengths * 300])
    pieces = [(u[a:b], y[a:b]) for a, b in pairwise(edges) if a < 300]
    found = list(filled_pieces(pieces))
    record = IoData(u, y, dt_s=0.1, outputs=("a", "b"))
    np.testing.assert_array_equal(np.concatenate([each for each, _ in found]), u)
    np.testing.assert_allclose(
        np.concatenate([each for _, each in found]), record.y_usable, rtol=1e-12
    )


def test_iodata___nan_in_outputs___is_missing_and_filled() -> None:
    y = np.stack([np.arange(10.0), np.zeros(10)], axis=1)
    y[4, 0] = np.nan
    record = IoData(np.ones(10), y, dt_s=0.1, outputs=("a", "b"))
    assert record.missing is not None
    assert np.argwhere(record.missing).tolist() == [[4, 0]]
    np.testing.assert_allclose(record.y[:, 0], np.arange(10.0), rtol=1e-12)
    assert np.isnan(record.y_measured[4, 0])
    assert record.usable.all()
    assert record.head(3).missing is None


def test_iodata___channel_that_was_never_measured___raises() -> None:
    y = np.stack([np.arange(10.0), np.full(10, np.nan)], axis=1)
    with pytest.raises(DataError, match="run 1: b was never measured"):
        IoData(np.ones(10), y, dt_s=0.1, outputs=("a", "b"), source="run 1")


def test_iodata___missing_of_another_shape___raises() -> None:
    with pytest.raises(DataError, match=r"missing must be \(10, 1\) as y: \(9, 1\)"):
        IoData(
            np.ones(10),
            np.zeros((10, 1)),
            dt_s=0.1,
            outputs=("a",),
            missing=np.zeros((9, 1), dtype=bool),
        )
