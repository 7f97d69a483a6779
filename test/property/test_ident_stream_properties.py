"""A bag read as a whole and piece by piece is one record."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flexarm_ident import IdentificationError, identify, read_bag
from flexarm_ident.reading.read import stream_bag
from flexarm_ident.records.preprocess import remove_compensation
from support.bag_samples import START_NS, arm_state, commander_info, write_in_chunks
from support.exhaustive import wide
from support.ident_systems import arm_model, square_wave, step_by_step

if TYPE_CHECKING:
    from flexarm_ident import IoData
    from flexarm_ident.reading.alignment import BagStream
    from support.bag_samples import Sent

SAMPLES = 700


def messages(
    seed: int, rate_hz: float, losses: float, hole: int, jitter: float, *, numbered: bool
) -> list[Sent]:
    """Return a run of the arm with single losses, a hole, late stamps and a channel that fails."""
    rng = np.random.default_rng(seed)
    u = square_wave(SAMPLES, seed % 7)[:, 0] + 0.1 * rng.normal(size=SAMPLES)
    y = step_by_step(arm_model(), u[:, np.newaxis])
    y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
    y[rng.random(SAMPLES) < 0.02, 1] = np.nan
    kept = rng.random(SAMPLES) >= losses
    kept[300 : 300 + hole] = False
    kept[[0, 1, -1]] = True
    off = np.clip(rng.normal(0.0, jitter, SAMPLES), -0.45, 0.45)
    stamps = START_NS + np.rint((np.arange(SAMPLES) + off) / rate_hz * 1e9).astype(int)
    rows = np.flatnonzero(kept)
    return [
        arm_state(
            int(row) if numbered else number,
            int(stamps[row]),
            tuple(y[row].tolist()),
            command_v=float(u[row - 1]) if row else 0.0,
            compensation_v=0.1 * float(np.sign(u[row - 1])) if row else 0.0,
            command_sequence=int(row),
        )
        for number, row in enumerate(rows)
    ]


@settings(
    max_examples=wide(4, 8),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(
    seed=st.integers(0, 2**32),
    rate_hz=st.sampled_from([100.0, 300.0, 500.0]),
    losses=st.sampled_from([0.0, 0.01, 0.1]),
    hole=st.sampled_from([0, 1, 3, 4, 60]),
    jitter=st.sampled_from([0.0, 0.02, 0.3]),
    numbered=st.booleans(),
    declared=st.sampled_from([True, False, None]),
    per_chunk=st.integers(5, 400),
)
def test_bag___whole_and_in_pieces___is_one_record(
    tmp_path_factory: pytest.TempPathFactory,
    *,
    seed: int,
    rate_hz: float,
    losses: float,
    hole: int,
    jitter: float,
    numbered: bool,
    declared: bool | None,
    per_chunk: int,
) -> None:
    uri = tmp_path_factory.mktemp("bag") / "run"
    run = messages(seed, rate_hz, losses, hole, jitter, numbered=numbered)
    if declared is not None:
        run.insert(0, commander_info(START_NS, uses_outputs=declared))
    write_in_chunks(uri, run, per_chunk)
    whole, stream = remove_compensation(read_bag(uri)), stream_bag(uri)
    head = stream.head(SAMPLES)
    np.testing.assert_allclose(head.u, whole.u, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(head.y_measured, whole.y_measured, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(head.y, whole.y, rtol=0.0, atol=1e-9)
    chunks = np.concatenate([y for _, y in stream.chunks(64)])
    np.testing.assert_allclose(chunks, whole.y_usable, rtol=0.0, atol=1e-9)
    assert len(stream) == len(whole)
    for name in ("inputs", "outputs", "closed_loop", "notices", "label"):
        assert getattr(stream, name) == getattr(whole, name), name
    assert stream.dt_s == pytest.approx(whole.dt_s, rel=1e-15)
    assert_same_model(whole, stream)


def assert_same_model(whole: IoData, stream: BagStream) -> None:
    try:
        found = identify(whole, order=5, block_rows=10, method="orse")
    except IdentificationError as error:
        with pytest.raises(IdentificationError, match=re.escape(str(error))):
            identify([stream], order=5, block_rows=10, method="orse")
        return
    other = identify([stream], order=5, block_rows=10, method="orse")
    np.testing.assert_allclose(other.model.A, found.model.A, atol=1e-6)
    np.testing.assert_allclose(other.fit_error, found.fit_error, rtol=1e-6)
