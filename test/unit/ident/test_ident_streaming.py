from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from bag_samples import (
    START_NS,
    Sent,
    arm_state,
    channel_info,
    io_sample,
    recorded_topics,
    write_foreign_bag,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from ident_systems import arm_model, random_model, record, square_wave, step_by_step
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from flexarm_daq.recording import BagWriter
from flexarm_ident import DataError, IdentificationError, IoData, identify, read_bag
from flexarm_ident.bags import BagError, stream_bag
from flexarm_ident.gram import LagSums
from flexarm_ident.preprocess import remove_compensation
from flexarm_ident.source import even_chunks
from flexarm_ident.streaming import identify_stream

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

STEP_NS = 4_000_000


class Pieces:
    """A record that arrives in pieces of the given lengths, over and over."""

    def __init__(self, data: IoData, lengths: Sequence[int]) -> None:
        self.data, self.lengths = data, lengths
        self.inputs, self.outputs = data.inputs, data.outputs
        self.dt_s, self.label = data.dt_s, "pieces"

    def __len__(self) -> int:
        return len(self.data)

    def chunks(self, samples: int) -> Iterator[tuple[Array, Array]]:
        return even_chunks(self._pieces(), samples)

    def _pieces(self) -> Iterator[tuple[Array, Array]]:
        first, turn = 0, 0
        while first < len(self):
            last = first + self.lengths[turn % len(self.lengths)]
            yield self.data.u[first:last], self.data.y[first:last]
            first, turn = last, turn + 1


def arm_record(samples: int, noise: float) -> IoData:
    model, u = arm_model(), square_wave(samples, 1)
    y = step_by_step(model, u)
    y += noise * y.std(axis=0) * np.random.default_rng(2).normal(size=y.shape)
    return IoData(u, y, dt_s=float(model.dt))


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.integers(1, 70), min_size=1, max_size=5),
    st.integers(1, 40),
    st.sampled_from([1, 2, 7, 9, 20, 41]),
)
def test_lag_sums___record_in_any_pieces___are_the_explicit_sums(
    lengths: list[int], more: int, lags: int
) -> None:
    z = np.random.default_rng(more).normal(size=(lags + 10 * more, 3))
    sums, first = LagSums(3, lags), 0
    while first < len(z):
        for length in lengths:
            sums.add(z[first : first + length, :2], z[first : first + length, 2:])
            first += length
    columns = len(z) - lags + 1
    explicit = [z[:columns].T @ z[j : columns + j] for j in range(lags)]
    assert sums.columns == columns
    np.testing.assert_allclose(sums.sums(), explicit, atol=1e-11 * len(z))
    hankel = np.vstack([z[i : i + columns].T for i in range(lags)])
    np.testing.assert_allclose(sums.gram(), hankel @ hankel.T, atol=1e-11 * len(z))


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 50), min_size=1, max_size=5), st.integers(1, 90))
def test_even_chunks___any_pieces___every_row_once_in_order(lengths: list[int], size: int) -> None:
    edges = np.cumsum([0, *lengths])
    rows = np.arange(edges[-1], dtype=np.float64)[:, np.newaxis]
    pieces = [(rows[a:b], -rows[a:b]) for a, b in pairwise(edges)]
    chunks = list(even_chunks(pieces, size))
    np.testing.assert_array_equal(np.concatenate([u for u, _ in chunks]), rows)
    np.testing.assert_array_equal(np.concatenate([y for _, y in chunks]), -rows)
    assert [len(u) for u, _ in chunks[:-1]] == [size] * (len(chunks) - 1)
    assert 0 < len(chunks[-1][0]) <= size


@pytest.mark.parametrize("method", ["orse", "orse_iv"])
@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("lengths", [[100_000], [1], [997, 64, 3]])
def test_identify_stream___any_pieces___is_the_model_of_the_whole_record(
    method: str, noise: float, lengths: list[int]
) -> None:
    data = arm_record(9001 if lengths != [1] else 2001, noise)
    whole = identify(data, order=9, block_rows=15, method=method)
    stream = identify_stream([Pieces(data, lengths)], order=9, block_rows=15, method=method)
    for part in "ABC":
        here, there = getattr(stream.model, part), getattr(whole.model, part)
        np.testing.assert_allclose(here, there, atol=1e-10)
    np.testing.assert_allclose(stream.x0[0], whole.x0[0], atol=1e-10)
    np.testing.assert_allclose(stream.fit_error, whole.fit_error, rtol=1e-6, atol=1e-11)
    assert stream.model.input_labels == ["command_v"]


def test_identify_stream___two_records___each_has_its_initial_state() -> None:
    model = random_model(3)
    parts = [record(model, 700, seed=1), record(model, 450, seed=2)]
    found = identify_stream([Pieces(part, [101]) for part in parts], order=5, block_rows=8)
    for part, x0 in zip(parts, found.x0, strict=True):
        np.testing.assert_allclose(
            step_by_step(found.model, part.u, x0), part.y, atol=1e-7 * np.abs(part.y).max()
        )


def test_fit_error___noisy_record___is_that_of_the_simulation() -> None:
    data = arm_record(5003, 0.05)
    found = identify(data, order=9, block_rows=15)
    missed = data.y - step_by_step(found.model, data.u, found.x0[0])
    expected = np.linalg.norm(missed, axis=0) / np.linalg.norm(data.y, axis=0)
    np.testing.assert_allclose(found.fit_error, expected, rtol=1e-6)


def test_identify_stream___no_record_or_other_method___raises() -> None:
    with pytest.raises(DataError, match="no record given"):
        identify_stream([], order=3)
    data = record(random_model(1), 300, seed=1)
    with pytest.raises(IdentificationError, match=r"must be orse or orse_iv .*'orse_thesis'"):
        identify_stream([data], order=3, method="orse_thesis")


def arm_messages(sequences: Sequence[int]) -> list[Sent]:
    rng = np.random.default_rng(5)
    return [
        arm_state(
            k,
            START_NS + k * STEP_NS,
            tuple(rng.normal(size=4)),
            command_v=float(rng.normal()),
            compensation_v=float(rng.normal()),
        )
        for k in sequences
    ]


def write_in_chunks(path: Path, messages: list[Sent], per_chunk: int) -> Path:
    with BagWriter(path, recorded_topics(messages), flush_period_s=1e6) as bag:
        for number, message in enumerate(messages, start=1):
            bag.write(message.topic, message.raw, message.time_ns, message.time_ns)
            if number % per_chunk == 0:
                bag.flush()
    return path


def rows(uri: Path, samples: int = 16) -> tuple[Array, Array]:
    chunks = list(stream_bag(uri).chunks(samples))
    return np.concatenate([u for u, _ in chunks]), np.concatenate([y for _, y in chunks])


@pytest.mark.parametrize("per_chunk", [1, 7, 50, 1000])
@pytest.mark.parametrize(
    "sequences",
    [
        list(range(120)),
        [*range(30), *range(33, 100), *range(105, 120)],
        [*range(50, 70), *range(40)],
    ],
)
def test_stream_bag___own_rig___equals_the_whole_bag(
    tmp_path: Path, sequences: list[int], per_chunk: int
) -> None:
    uri = write_in_chunks(tmp_path / "run", arm_messages(sequences), per_chunk)
    whole, stream = remove_compensation(read_bag(uri)), stream_bag(uri)
    u, y = rows(uri)
    np.testing.assert_array_equal(u, whole.u)
    np.testing.assert_array_equal(y, whole.y)
    assert len(stream) == len(whole)
    assert (stream.inputs, stream.outputs) == (whole.inputs, whole.outputs)
    assert stream.dt_s == pytest.approx(whole.dt_s, rel=1e-12)
    gaps = int(np.sum(np.diff(sequences) != 1))
    assert (f"at {gaps} places" in " ".join(stream.warnings)) == (gaps > 0)


def test_stream_bag___other_rig___takes_names_from_its_channel_info(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    samples = [
        io_sample(k, START_NS + k * STEP_NS, list(rng.normal(size=2)), list(rng.normal(size=3)))
        for k in range(40)
    ]
    info = channel_info(START_NS, ["a", "b"], ["c", "d", "e"], 250.0)
    uri = write_in_chunks(tmp_path / "run", [info, *samples], 9)
    whole = read_bag(uri)
    u, y = rows(uri)
    np.testing.assert_array_equal(u, whole.u)
    np.testing.assert_array_equal(y, whole.y)
    assert stream_bag(uri).outputs == ("c", "d", "e")


def test_stream_bag___value_is_not_finite___names_channel_and_row(tmp_path: Path) -> None:
    messages = arm_messages(range(50))
    messages[23] = arm_state(23, START_NS + 23 * STEP_NS, (0.0, np.nan, 0.0, 0.0))
    uri = write_in_chunks(tmp_path / "run", messages, 10)
    with pytest.raises(BagError, match="base_strain_v is not finite in row 23"):
        stream_bag(uri)


def test_stream_bag___two_samples___are_too_few(tmp_path: Path) -> None:
    uri = write_in_chunks(tmp_path / "run", arm_messages(range(2)), 10)
    with pytest.raises(BagError, match="only 1 samples follow each other"):
        stream_bag(uri)


def test_stream_bag___sqlite___says_to_read_it_whole(tmp_path: Path) -> None:
    uri = write_foreign_bag(
        tmp_path / "run", arm_messages(range(9)), StoragePlugin.SQLITE3, CompressionMode.NONE
    )
    with pytest.raises(BagError, match="only a plain MCAP bag can be read piece by piece"):
        stream_bag(uri)
