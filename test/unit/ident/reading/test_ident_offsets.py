"""Offsets between commands and outputs on the clock of receiving."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from flexarm_ident import read_channels, selection
from flexarm_ident.reading.offsets import common_rows, on_their_rows
from flexarm_ident.reading.tracks import Evened, Track, evened
from support.bag_samples import START_NS
from support.foreign_bags import FINE_HZ, float64, float64_arrays, responses, write_topics

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Integers = NDArray[np.int64]

DURATION_S = 16
STATE_DELAY_S, COMMAND_DELAY_S = 8e-4, 2e-4
ROW = FINE_HZ // 200


def received_ns(sent: Integers, mean_delay_s: float, seed: int) -> Integers:
    """Return instants of receiving for instants of the fine grid: delays are exponential."""
    delay_s = np.random.default_rng(seed).exponential(mean_delay_s, len(sent))
    return np.sort(START_NS + np.rint((sent / FINE_HZ + delay_s) * 1e9).astype(np.int64))


def driven(early: int, seed: int) -> tuple[Integers, Array, Integers, Array]:
    """Return the instants and values of commands at 100 Hz and of outputs at 200 Hz.

    Each command acts so many instants before the row of its own.
    """
    rng = np.random.default_rng(seed)
    fine = DURATION_S * FINE_HZ
    sent = np.arange(2 * ROW, fine, 2 * ROW) - early
    levels = np.repeat(rng.uniform(-3.0, 3.0, len(sent)), rng.integers(2, 13, len(sent)))
    commands = levels[: len(sent)]
    force = np.append(0.0, commands)[np.searchsorted(sent, np.arange(fine), side="right")]
    sampled = np.arange(0, fine, ROW)
    y = responses(force)[sampled]
    speed = np.gradient(responses(force), 1.0 / FINE_HZ, axis=0)[sampled, :1]
    y = np.hstack([y, speed])
    return sent, commands, sampled, y + 1e-3 * y.std(axis=0) * rng.normal(size=y.shape)


@pytest.mark.parametrize("seed", range(3))
def test_rows___outputs_delayed_more_than_commands___have_their_own_commands(
    tmp_path: Path, seed: int
) -> None:
    sent, commands, sampled, y = driven(0, seed)
    topics = [
        float64("/command", received_ns(sent, COMMAND_DELAY_S, 10 + seed), commands),
        float64_arrays("/states", received_ns(sampled, STATE_DELAY_S, 20 + seed), y),
    ]
    bag = write_topics(tmp_path / "run", topics, StoragePlugin.MCAP)

    data = read_channels(
        bag, selection(["/command.data"], [f"/states.data[{n}]" for n in range(3)])
    )

    own = np.repeat(commands, 2)
    np.testing.assert_array_equal(data.u[-len(own) + 5 :, 0], own[5:])
    note = next(each for each in data.notices if "early_s" in each.figures)
    assert note.figures["early_s"] == pytest.approx(STATE_DELAY_S - COMMAND_DELAY_S, abs=1e-4)
    assert note.text.startswith("/command.data was received 0.")


def tracks(sent: Integers, commands: Array, sampled: Integers, y: Array) -> tuple[Track, ...]:
    """Return commands and outputs that are received with delays of the same mean."""
    received = received_ns(sampled, STATE_DELAY_S, 1)
    outputs = [Track(f"/y{number}", received, column) for number, column in enumerate(y.T)]
    return Track("/u", received_ns(sent, STATE_DELAY_S, 2), commands), *outputs


@pytest.mark.parametrize("early", [0.12, 0.2, 0.4])
@pytest.mark.parametrize("columns", [2, 3], ids=["without a speed", "with a speed"])
def test_rows___commands_that_act_before_theirs___stay(early: float, columns: int) -> None:
    sent, commands, sampled, y = driven(round(early * ROW), seed=1)
    command, *outputs = map(evened, tracks(sent, commands, sampled, y[:, :columns]))
    found, moved = on_their_rows([command], outputs)
    assert moved == []
    np.testing.assert_allclose(found.acting[0] % 1.0, 1.0 - early, atol=0.04)


def test_rows___loop_that_answers_within_a_row___stays() -> None:
    # A law of the noisy position drives an integrator; its command acts 4.2 ms behind the sample.
    rng = np.random.default_rng(3)
    count = DURATION_S * 200
    y, u = np.zeros((count, 1)), np.zeros(count)
    state, acting = 0.0, 0.0
    for k in range(count):
        y[k] = state + rng.normal(0.0, 0.02)
        u[k] = rng.normal() - 20.0 * y[k, 0]
        state += 4.2e-3 * acting + 0.8e-3 * u[k]
        acting = u[k]
    rows = np.arange(count) * ROW
    command, *outputs = map(evened, tracks(rows + 42, u, rows, y))
    found, moved = on_their_rows([command], outputs)
    assert moved == []
    np.testing.assert_allclose(found.acting[0] % 1.0, 0.84, atol=0.04)


@pytest.mark.parametrize(("late", "expected"), [(0.097, 0.0), (0.103, 0.103)])
def test_rows___commands_whose_distance_wanders_about_the_limit___act_in_one_way(
    late: float, expected: float
) -> None:
    count = 600
    k = np.arange(float(count))
    angle = Track("/y", START_NS + (5_000_000 * k).astype(np.int64), k)
    wander = late + 0.01 * np.sin(k / 50.0)
    command = Track("/u", START_NS + np.rint(5e6 * (k + wander)).astype(np.int64), k)
    found = common_rows([command], [angle])
    # For the part `expected` of a row, the command before acts.
    part = found.rows - found.u[:, 0]
    np.testing.assert_allclose(part, np.where(expected, wander[found.rows], 0.0), atol=1e-6)


def test_rows___exact_instants___are_not_moved() -> None:
    sent, commands, sampled, y = driven(ROW // 5, 1)
    times_ns = [START_NS + each * (10**9 // FINE_HZ) for each in (sent, sampled)]
    outputs = [Evened(Track("/y", times_ns[1], column)) for column in y.T]
    found, moved = on_their_rows([Evened(Track("/u", times_ns[0], commands))], outputs)
    assert moved == []
    np.testing.assert_allclose(found.acting[0] % 1.0, 0.8, atol=1e-6)
