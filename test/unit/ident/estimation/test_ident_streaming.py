from __future__ import annotations

import tracemalloc
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from flexarm_core.errors import BagError
from flexarm_ident import DataError, IdentificationError, IoData, identify, job, read_bag
from flexarm_ident.estimation.pipeline import EXCERPT_SAMPLES, without_bias
from flexarm_ident.provenance import record_hash
from flexarm_ident.reading.read import stream_bag
from flexarm_ident.records.preprocess import ZERO_MEAN_OUTPUTS, remove_compensation
from flexarm_ident.records.source import even_chunks
from flexarm_ident.report.sections.data import record_table
from flexarm_ident.subspace.gram import LagSums
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.bag_samples import (
    START_NS,
    Sent,
    arm_state,
    channel_info,
    commander_info,
    io_sample,
    write_foreign_bag,
    write_in_chunks,
)
from support.exhaustive import first_of
from support.ident_systems import arm_model, random_model, record, square_wave, step_by_step

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
        self.dt_s, self.label, self.notices = data.dt_s, "pieces", data.notices
        self.closed_loop, self.whole_samples = data.closed_loop, len(data)

    def __len__(self) -> int:
        return len(self.data)

    def chunks(self, samples: int) -> Iterator[tuple[Array, Array]]:
        return even_chunks(self._pieces(), samples)

    def head(self, samples: int) -> IoData:
        taken, left = [], min(samples, len(self))
        for u, y in self.chunks(997):
            taken.append((u[:left], y[:left]))
            left -= len(taken[-1][0])
            if not left:
                break
        u, y = (np.concatenate(each) for each in zip(*taken, strict=True))
        return replace(self.data, u=u, y=y, compensation=None, reference=None)

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


@settings(max_examples=25)
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
    np.testing.assert_allclose(sums.sums(), explicit, atol=1e-11 * len(z))
    assert sums.columns == columns
    hankel = np.vstack([z[i : i + columns].T for i in range(lags)])
    np.testing.assert_allclose(sums.gram(), hankel @ hankel.T, atol=1e-11 * len(z))


@settings(max_examples=25)
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


@pytest.mark.parametrize("method", ["auto", "orse", "orse_iv", "pbsid", "orse_thesis"])
@pytest.mark.parametrize("noise", first_of([0.0, 0.05]))
@pytest.mark.parametrize("lengths", [[100_000], [1], [997, 64, 3]])
def test_identify___any_pieces___is_the_model_of_the_whole_record(
    method: str, noise: float, lengths: list[int]
) -> None:
    data = arm_record(9001 if lengths != [1] else 2001, noise)
    whole = identify(data, order=9, block_rows=15, method=method)
    stream = identify([Pieces(data, lengths)], order=9, block_rows=15, method=method)
    for part in "ABC":
        here, there = getattr(stream.model, part), getattr(whole.model, part)
        np.testing.assert_allclose(here, there, atol=1e-10)
    np.testing.assert_allclose(stream.x0[0], whole.x0[0], atol=1e-10)
    np.testing.assert_allclose(stream.fit_error, whole.fit_error, rtol=1e-6, atol=1e-11)
    assert stream.model.input_labels == ["command_v"]


def test_identify___two_records___each_has_its_initial_state() -> None:
    model = random_model(3)
    parts = [record(model, 700, seed=1), record(model, 450, seed=2)]
    found = identify([Pieces(part, [101]) for part in parts], order=5, block_rows=8, method="orse")
    for part, x0 in zip(parts, found.x0, strict=True):
        np.testing.assert_allclose(
            step_by_step(found.model, part.u, x0), part.y, atol=1e-7 * np.abs(part.y).max()
        )


def test_fit_error___noisy_record___is_that_of_the_simulation() -> None:
    data = arm_record(5003, 0.05)
    found = identify(data, order=9, block_rows=15, method="orse")
    missed = data.y - step_by_step(found.model, data.u, found.x0[0])
    expected = np.linalg.norm(missed, axis=0) / np.linalg.norm(data.y, axis=0)
    np.testing.assert_allclose(found.fit_error, expected, rtol=1e-6)


def test_identify___no_record_or_other_method___raises() -> None:
    with pytest.raises(DataError, match="no record given"):
        identify([], order=3, method="orse")
    data = record(random_model(1), 300, seed=1)
    with pytest.raises(IdentificationError, match=r"method must be one of auto, .*'guess'"):
        identify([data], order=3, method="guess")


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


def rows(uri: Path, samples: int = 16) -> tuple[Array, Array]:
    chunks = list(stream_bag(uri).chunks(samples))
    return np.concatenate([u for u, _ in chunks]), np.concatenate([y for _, y in chunks])


@pytest.mark.parametrize("per_chunk", first_of([1, 7, 50, 1000]))
@pytest.mark.parametrize(
    "sequences",
    [
        list(range(120)),
        [*range(30), *range(33, 100), *range(105, 120)],
        [*range(50, 70), *range(40)],
    ],
)
@pytest.mark.slow
def test_stream_bag___own_rig___equals_the_whole_bag(
    tmp_path: Path, sequences: list[int], per_chunk: int
) -> None:
    uri = write_in_chunks(tmp_path / "run", arm_messages(sequences), per_chunk)
    whole, stream = remove_compensation(read_bag(uri)), stream_bag(uri)
    u, y = rows(uri)
    np.testing.assert_allclose(u, whole.u, rtol=1e-12)
    np.testing.assert_allclose(y, whole.y_usable, rtol=1e-12)
    assert len(stream) == len(whole)
    assert (stream.inputs, stream.outputs) == (whole.inputs, whole.outputs)
    assert stream.dt_s == pytest.approx(whole.dt_s, rel=1e-12)
    assert stream.closed_loop == whole.closed_loop
    gaps = int(np.sum(np.diff(sequences) != 1))
    assert bool(stream.notices) == (gaps > 0)
    assert stream.notices == whole.notices


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
    assert stream_bag(uri).closed_loop is whole.closed_loop is not None


def test_stream_bag___declared_commander___closed_the_loop(tmp_path: Path) -> None:
    messages = [*arm_messages(range(120)), commander_info(START_NS, uses_outputs=True)]
    uri = write_in_chunks(tmp_path / "run", messages, 50)
    assert read_bag(uri).closed_loop is True
    assert stream_bag(uri).closed_loop is True
    assert identify([stream_bag(uri)], order=2, block_rows=4, method="auto").method == "pbsid"


def test_stream_bag___value_is_not_finite___names_channel_and_row(tmp_path: Path) -> None:
    messages = arm_messages(range(50))
    messages[23] = arm_state(23, START_NS + 23 * STEP_NS, (0.0, np.inf, 0.0, 0.0))
    uri = write_in_chunks(tmp_path / "run", messages, 10)
    with pytest.raises(BagError, match="base_strain_v is not finite in row 23"):
        stream_bag(uri)


def test_stream_bag___two_samples___are_too_few(tmp_path: Path) -> None:
    uri = write_in_chunks(tmp_path / "run", arm_messages(range(2)), 10)
    with pytest.raises(BagError, match="only 2 samples follow each other"):
        stream_bag(uri)


def test_stream_bag___sqlite___raises_with_a_remedy(tmp_path: Path) -> None:
    uri = write_foreign_bag(
        tmp_path / "run", arm_messages(range(9)), StoragePlugin.SQLITE3, CompressionMode.NONE
    )
    with pytest.raises(BagError, match="only a plain MCAP bag can be read piece by piece"):
        stream_bag(uri)


def test_run___record_in_pieces___is_the_outcome_of_the_whole_record() -> None:
    data = arm_record(6001, 0.05)
    shifted = replace(data, y=data.y + np.array([0.0, 0.3, -0.2, 0.0]))
    # A record in pieces is not refined.
    request = Request(
        method="orse_iv", block_rows=15, reduction="mrm", reduced_order=7, friction=False
    )
    whole, stream = run(shifted, request), run([Pieces(shifted, [977, 64])], request)
    assert (stream.samples, stream.fitted) == (whole.samples, whole.fitted) == ((6001,), (6001,))
    np.testing.assert_allclose(stream.model.A, whole.model.A, atol=1e-9)
    np.testing.assert_allclose(stream.records[0].y, whole.records[0].y, atol=1e-12)
    # The initial state of a stream is that of the fit, of a whole record that of the whole.
    np.testing.assert_allclose(stream.dmv_errors, whole.dmv_errors, rtol=0.02)
    assert any("fitted in pieces" in warning for warning in stream.warnings)


@pytest.mark.slow
def test_run___record_longer_than_the_excerpt___errors_are_of_the_whole() -> None:
    data = arm_record(EXCERPT_SAMPLES + 5000, 0.02)
    y = data.y.copy()
    y[EXCERPT_SAMPLES:] += 1.0
    odd = replace(data, y=y)
    request = Request(order=9, block_rows=15, train_fraction=0.3)
    outcome = run([Pieces(odd, [4096])], request)
    (record,), (dmv,) = outcome.records, outcome.dmv
    assert len(record) == len(dmv.y) == EXCERPT_SAMPLES
    mean = y.mean(axis=0) * np.isin(odd.outputs, ZERO_MEAN_OUTPUTS)
    simulated = step_by_step(outcome.model, odd.u, dmv.x0)
    missed = np.linalg.norm(y - mean - simulated, axis=0) / np.linalg.norm(
        y - y.mean(axis=0), axis=0
    )
    np.testing.assert_allclose(outcome.dmv_errors, missed, rtol=1e-6)
    assert outcome.identification.mode_uncertainty
    assert record_table(outcome).rows[0][1] == "70536"


@pytest.mark.slow
def test_identify_bags___more_samples_than_memory_is_given___reads_in_pieces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uri = write_in_chunks(tmp_path / "run", arm_messages(range(900)), 100)
    request = Request(order=4, block_rows=10, method="orse")
    whole = job.identify_bags([uri], tmp_path / "whole", request)
    monkeypatch.setattr(job, "LARGEST_IN_MEMORY", 899)
    stream = job.identify_bags([uri], tmp_path / "stream", request)
    assert any("fitted in pieces" in warning for warning in stream.outcome.warnings)
    np.testing.assert_allclose(stream.outcome.model.A, whole.outcome.model.A, atol=1e-6)
    hashes = [each.parameters["models.run.source_sha256"] for each in (stream, whole)]
    assert hashes[0] == [record_hash(stream_bag(uri))]
    assert hashes[1] == [record_hash(read_bag(uri))]


def test_record_hash___in_pieces___is_that_of_the_whole() -> None:
    data = record(random_model(1), 300, seed=1)
    assert record_hash(Pieces(data, [7, 50])) == record_hash(data)


@pytest.mark.parametrize("method", first_of(["auto", "orse", "orse_iv", "pbsid", "orse_thesis"], 2))
def test_identify___ten_times_the_samples___takes_no_more_memory(method: str) -> None:
    base = arm_record(5000, 0.05)
    identify([Repeated(base, 2)], order=9, block_rows=15, method=method)
    peaks = []
    for times in (20, 200):
        tracemalloc.start()
        identify([Repeated(base, times)], order=9, block_rows=15, method=method)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0]
    assert peaks[1] < 40e6


def test_without_bias___offset_beyond_all_signal___is_removed_and_reported() -> None:
    data = record(random_model(1), 500, seed=1)
    far = replace(data, y=data.y + 1e6)
    part = without_bias(Pieces(far, [97]))
    (_, y), *_ = part.chunks(500)
    np.testing.assert_allclose(y, data.y - data.y.mean(axis=0), atol=1e-6)
    assert [each.channel for each in part.notices] == list(data.outputs)


class Repeated(Pieces):
    """A record that comes again and again: as long as wanted, without the memory."""

    def __init__(self, data: IoData, times: int) -> None:
        super().__init__(data, [len(data)])
        self._times = times

    def __len__(self) -> int:
        return self._times * len(self.data)

    def _pieces(self) -> Iterator[tuple[Array, Array]]:
        for _ in range(self._times):
            yield self.data.u, self.data.y
