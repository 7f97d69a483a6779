from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from flexarm_ident import DataError, IoData
from flexarm_ident.subspace.gram import LagSums, block_gram
from support.ident_systems import random_model, record

Array = NDArray[np.float64]


def hankel(z: Array, block_rows: int) -> Array:
    """Return (2-19) of all channels, formed explicitly."""
    columns = len(z) - block_rows + 1
    return np.vstack([z[i : i + columns].T for i in range(block_rows)])


@pytest.mark.parametrize("samples", [7, 8, 30, 61, 256, 1001])
@pytest.mark.parametrize("block_rows", [1, 2, 7])
def test_block_gram___one_record___equals_explicit_hankel_product(
    samples: int, block_rows: int
) -> None:
    data = record(random_model(3), samples, seed=samples)
    explicit = hankel(np.hstack([data.y, data.u]), block_rows)
    gram = block_gram([data], block_rows)
    scale = np.abs(explicit @ explicit.T).max()
    np.testing.assert_allclose(gram.matrix, explicit @ explicit.T, atol=1e-12 * scale)
    assert gram.columns == explicit.shape[1]


def test_block_gram___record_longer_than_a_chunk___equals_explicit_hankel_product() -> None:
    data = record(random_model(4, inputs=1), 9001, seed=1)
    explicit = hankel(np.hstack([data.y, data.u]), 21)
    gram = block_gram([data], 21).matrix
    np.testing.assert_allclose(gram, explicit @ explicit.T, rtol=0, atol=1e-12 * np.abs(gram).max())


def test_block_gram___several_records___products_add_up() -> None:
    model = random_model(5)
    records = [record(model, 200, seed=1), record(model, 133, seed=2)]
    together, apart = block_gram(records, 9), [block_gram([r], 9) for r in records]
    np.testing.assert_allclose(together.matrix, apart[0].matrix + apart[1].matrix, rtol=1e-14)
    assert together.columns == apart[0].columns + apart[1].columns


def test_block_gram___rows_of_inputs_and_outputs___pick_the_channels() -> None:
    data = record(random_model(6), 100, seed=3)
    gram = block_gram([data], 4)
    rows = gram.output_rows(1, 3)
    outputs = hankel(data.y, 4)[3:9]
    np.testing.assert_allclose(gram.matrix[np.ix_(rows, rows)], outputs @ outputs.T)
    rows = gram.input_rows(0, 4)
    inputs = hankel(data.u, 4)
    np.testing.assert_allclose(gram.matrix[np.ix_(rows, rows)], inputs @ inputs.T)


def test_lag_sums___constant_signal___counts_the_columns() -> None:
    sums = LagSums(1, 5)
    sums.add(np.ones((100, 1)))
    np.testing.assert_allclose(sums.sums()[:, 0, 0], 96.0)


def test_block_gram___record_shorter_than_block_rows___raises() -> None:
    data = IoData(np.zeros(5), np.zeros((5, 4)), dt_s=0.01, source="short")
    with pytest.raises(DataError, match="short: 5 samples are fewer than the 6 block rows"):
        block_gram([data], 6)


def test_block_gram___holes___sums_the_columns_without_one() -> None:
    data = record(random_model(7), 900, seed=4)
    y = data.y.copy()
    # One long hole on a chunk's own, one that leaves a part shorter than the block rows.
    y[300:310] = y[315:340] = np.nan
    damaged = replace(data, y=y)
    whole = hankel(np.hstack([data.y, data.u]), 9)
    kept = np.array([not np.any(~damaged.usable[k : k + 9]) for k in range(whole.shape[1])])
    explicit = whole[:, kept]
    gram = block_gram([damaged], 9)
    assert gram.columns == kept.sum()
    scale = np.abs(explicit @ explicit.T).max()
    np.testing.assert_allclose(gram.matrix, explicit @ explicit.T, atol=1e-12 * scale)


def test_block_gram___no_part_as_long_as_the_block_rows___raises() -> None:
    y = np.random.default_rng(1).normal(size=(200, 2))
    y[np.arange(200) % 10 < 5] = np.nan
    data = IoData(np.ones(200), y, dt_s=0.01, outputs=("a", "b"), source="torn")
    with pytest.raises(DataError, match="torn: no 9 samples, the block rows, follow each other"):
        block_gram([data], 9)


def test_block_gram___input_that_rests_after_its_start___leaves_no_power_of_rounding() -> None:
    data = record(random_model(7, inputs=1), 3000, seed=4)
    u = data.u.copy()
    u[9:] = 0.0
    gram = block_gram([replace(data, u=u)], 20)
    power = np.diag(gram.matrix)[gram.input_rows(0, 20)]
    # Shift i holds the samples from i on.
    np.testing.assert_allclose(power[:9], np.cumsum(u[8::-1, 0] ** 2)[::-1], rtol=1e-10)
    np.testing.assert_array_equal(power[9:], 0.0)
