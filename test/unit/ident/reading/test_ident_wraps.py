"""Tests of encoders that wrap: turns are counted, and what only looks so stays."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident.reading.wraps import found_wraps, unwrapped, wrap_notices

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray

ROWS = 4000
K = np.arange(ROWS)


def swing(period: float, turns: float = 2.3) -> FloatArray:
    """Return an angle that swings and wanders over some turns, none of them at even intervals."""
    motion = np.sin(2e-3 * K) + 0.4 * np.sin(1.1e-2 * K) + 1e-5 * K
    return np.asarray(period * turns * motion)


def wrapped(angle: FloatArray, period: float, lowest: float) -> FloatArray:
    return np.asarray(np.mod(angle - lowest, period) + lowest)


def undone(y: FloatArray, u: FloatArray | None = None, turn: float | None = None) -> FloatArray:
    rows = [(np.zeros((len(y), 1)) if u is None else u[:, np.newaxis], y[:, np.newaxis])]
    return next(unwrapped(rows, found_wraps(rows, turn)))[1][:, 0]


def expect_angle(found: FloatArray, angle: FloatArray, period: float) -> None:
    """The same up to whole turns before the record, in every measured sample."""
    known = ~np.isnan(found)
    turns = (found - angle)[known] / period
    assert np.ptp(turns) < 1e-6 + 1.01 / period
    assert turns[0] == pytest.approx(round(turns[0]), abs=1e-6 + 1.01 / period)


@pytest.mark.parametrize("turns", [0.02, 0.3, 2.3, 25.0])
@pytest.mark.parametrize(
    ("period", "lowest"),
    [
        *((360.0, 0.0), (360.0, -180.0), (2.0 * math.pi, 0.0), (2.0 * math.pi, -math.pi)),
        *((3600.0, 0.0), (36000.0, 0.0), (400.0, 0.0), (180.0, 0.0), (math.pi, -0.5 * math.pi)),
    ],
)
def test_angle___that_wraps___has_its_turns_counted(
    period: float, lowest: float, turns: float
) -> None:
    angle = swing(period, turns) + lowest
    y = wrapped(angle, period, lowest)
    assert np.abs(np.diff(y)).max() > 0.7 * period
    expect_angle(undone(y), angle, period)


@pytest.mark.parametrize("period", [360.0, 2.0 * math.pi, 4096.0, 65536.0])
def test_angle___that_vibrates_fast_where_it_wraps___has_its_turns_counted(period: float) -> None:
    # An eighth of a turn a sample, and its steps change by a tenth of one at the jumps.
    angle = period * (3.0 * np.sin(2.1e-3 * K) + 0.2 * np.sin(0.6 * K) + 1e-5 * K)
    assert np.abs(np.diff(angle)).max() > 0.12 * period
    expect_angle(undone(wrapped(angle, period, 0.0)), angle, period)


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16, 24, 32])
@pytest.mark.parametrize("signed", [False, True])
def test_counter___of_some_bits___has_its_turns_counted(bits: int, *, signed: bool) -> None:
    period = 2.0**bits
    angle = swing(period, 3.0)
    y = wrapped(np.floor(angle), period, -period / 2 if signed else 0.0)
    expect_angle(undone(y), np.floor(angle), period)


def test_angle___that_wraps___with_noise_and_samples_missing_there_is_counted() -> None:
    rng = np.random.default_rng(3)
    angle = swing(360.0) + 0.5 * rng.standard_normal(ROWS)
    y = wrapped(angle, 360.0, 0.0)
    jumps = np.flatnonzero(np.abs(np.diff(y)) > 300.0)
    y[jumps[::2]] = np.nan
    y[jumps[1::2] + 1] = np.nan
    y[1000:1003] = np.nan
    expect_angle(undone(y), angle, 360.0)


def test_angle___in_pieces___goes_on_from_piece_to_piece() -> None:
    angle = swing(360.0)
    y = wrapped(angle, 360.0, 0.0)[:, np.newaxis]
    pieces = [(np.zeros((len(part), 1)), part) for part in np.split(y, [7, 900, 901, 2500])]
    found = np.concatenate([part for _, part in unwrapped(pieces, found_wraps(pieces))])[:, 0]
    expect_angle(found, angle, 360.0)


def test_motor___that_turns_one_way_at_changing_speed___has_its_turns_counted() -> None:
    angle = np.cumsum(4.0 + 2.0 * np.sin(5e-3 * K))
    expect_angle(undone(wrapped(angle, 360.0, 0.0)), angle, 360.0)


NOISE = np.random.default_rng(8).standard_normal(ROWS)


@pytest.mark.parametrize(
    "y",
    [
        np.mod(0.9 * K, 360.0),
        np.mod(0.013 * K, 5.0),
        np.mod(0.9 * K, 90.0),
        np.sign(np.sin(0.01 * K + 0.1)) * 180.0,
        180.0 + 179.9 * np.sign(np.sin(0.01 * K + 0.1)) + 0.01 * NOISE,
        NOISE,
        np.cumsum(NOISE),
        180.0 * np.sin(0.05 * K),
        180.0 * np.sin(2.5 * K),
        np.where(K == 2000, 360.0, 0.0) + 0.1 * NOISE,
        np.full(ROWS, 7.0),
        np.full(ROWS, np.nan),
        np.where(K % 700 == 0, 9e307, 0.0),
        np.where(K % 700 == 0, -1.7e308, 1.7e308),
        np.where(K % 700 == 0, 1e-300, 0.0),
    ],
    ids=[
        *("even sawtooth", "sawtooth of 5 V", "sawtooth of 90", "square", "noisy square", "noise"),
        *(
            "drift",
            "sine",
            "fast sine",
            "outlier",
            "constant",
            "unmeasured",
            "large",
            "largest",
            "least",
        ),
    ],
)
def test_signal___that_is_no_angle___stays(y: FloatArray) -> None:
    np.testing.assert_array_equal(undone(y), y)


def test_sawtooth___that_follows_the_input___stays() -> None:
    u = np.mod(np.cumsum(1.0 + 0.5 * np.sin(3e-3 * K)), 360.0)
    y = np.concatenate([u[:1], u[:-1]])
    np.testing.assert_array_equal(undone(y, u), y)
    assert not np.array_equal(undone(y), y)


def test_period___that_is_given___is_taken() -> None:
    angle = swing(1440.0)
    y = wrapped(angle, 1440.0, 0.0)
    np.testing.assert_array_equal(undone(y), y)
    expect_angle(undone(y, turn=1440.0), angle, 1440.0)
    degrees = wrapped(angle / 4.0, 360.0, 0.0)
    np.testing.assert_array_equal(undone(degrees, turn=0.0), degrees)


def test_notice___names_output_period_and_remedy() -> None:
    y = wrapped(swing(360.0), 360.0, 0.0)[:, np.newaxis]
    wraps = found_wraps([(np.zeros((ROWS, 1)), y)])
    (notice,) = wrap_notices(["angle_deg"], wraps)
    jumps = int(np.count_nonzero(np.abs(np.diff(y[:, 0])) > 180.0))
    assert notice.text.startswith(f"angle_deg wraps at 360, {jumps} times: its turns are counted")
    assert notice.text.endswith("say --wrap 0")


@pytest.mark.parametrize("period", [360.0, 2.0 * math.pi, 4096.0])
def test_angle___that_turns_by_a_third_of_its_period_a_sample___is_in_doubt(period: float) -> None:
    motion = 0.3 * period * (K + 60.0 * np.sin(0.01 * K))
    y = wrapped(motion, period, 0.0)
    (found,) = found_wraps([(np.zeros((ROWS, 1)), y[:, np.newaxis])])
    assert (found.period, found.doubt) == (0.0, period)
    (notice,) = wrap_notices(["angle"], [found])
    assert notice.grade == "caution"
    assert f"--wrap {period:.6g}" in notice.text


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["uniform", "normal", "fast sine"])
def test_signal___of_a_fast_vibration_that_fills_a_period___is_in_no_doubt(
    seed: int, kind: str
) -> None:
    rng = np.random.default_rng(seed)
    y = {
        "uniform": rng.uniform(0.0, 1.0, ROWS),
        "normal": rng.normal(size=ROWS),
        "fast sine": np.sin((1.1 + 0.6 * seed) * K) + 0.1 * rng.normal(size=ROWS),
    }[kind]
    y = 359.9 * (y - y.min()) / np.ptp(y)
    assert found_wraps([(np.zeros((ROWS, 1)), y[:, np.newaxis])])[0].doubt == 0.0
