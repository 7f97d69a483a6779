"""Drop-outs of sensors: samples that were not measured are missing, and no others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident import IoData, preprocess
from flexarm_ident.records.preprocess import without_dropouts
from support.ident_systems import DT_S, arm_model, square_wave, step_by_step

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

SAMPLES = 4000
PLACES = range(100, SAMPLES - 100, 97)
"""First rows of the drop-outs, of 1 to 8 samples in turn."""


def measured(digits: int | None = None) -> IoData:
    """Return the arm's outputs with one percent of noise, rounded if asked."""
    rng = np.random.default_rng(5)
    u = square_wave(SAMPLES, 3) + 0.3 * rng.normal(size=(SAMPLES // 8, 1)).repeat(8, axis=0)
    y = step_by_step(arm_model(), u)
    y = 5.0 * y / np.abs(y).max(axis=0)
    y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
    y = y if digits is None else y.round(digits)
    return IoData(u, y, dt_s=DT_S, inputs=("u",), outputs=tuple(f"y{i}" for i in range(y.shape[1])))


def dropped(record: IoData, longest: int, value: Callable[[Array, int], float]) -> IoData:
    """Return a record whose first output has 20 drop-outs of 1 to `longest` samples."""
    y = record.y.copy()
    for number, row in enumerate(PLACES[:20]):
        y[row : row + 1 + number % longest, 0] = value(y[:, 0], row)
    return IoData(record.u, y, dt_s=DT_S, inputs=record.inputs, outputs=record.outputs)


@pytest.mark.parametrize(
    ("longest", "value"),
    [
        (1, lambda _, __: 0.0),
        (8, lambda _, __: 0.0),
        (2, lambda _, __: -1.0),
        (8, lambda y, row: y[row - 1]),
    ],
    ids=["one 0", "0", "-1", "held"],
)
@pytest.mark.parametrize("digits", [None, 4])
def test_without_dropouts___levels_and_held_values___are_missing(
    longest: int, value: Callable[[Array, int], float], digits: int | None
) -> None:
    whole = measured(digits)
    spoilt = dropped(whole, longest, value)

    found = without_dropouts(spoilt)

    assert found.missing is not None
    wrong = np.abs(spoilt.y - whole.y) > 0.1 * whole.y.std(axis=0)
    assert np.count_nonzero(wrong & ~found.missing) <= 0.1 * np.count_nonzero(wrong)
    # Equal neighbours by chance are as good as missing, but few.
    assert np.count_nonzero(found.missing & (spoilt.y == whole.y)) <= 0.01 * SAMPLES
    (notice,) = found.notices
    assert (notice.code, notice.channel) == ("dropouts", "y0")
    assert notice.figures["missing"] == np.count_nonzero(found.missing)
    assert abs(notice.figures["first_row"] - PLACES[0]) <= 2 * (PLACES[1] - PLACES[0])
    np.testing.assert_array_equal(found.y[~found.missing], spoilt.y[~found.missing])


def test_preprocess___drop_outs___are_filled_from_their_neighbours() -> None:
    whole = measured()
    spoilt = dropped(whole, 2, lambda _, __: 0.0)
    error = preprocess(spoilt).y[:, 0] - preprocess(whole).y[:, 0]
    assert error.std() < 0.1 * (spoilt.y - whole.y)[:, 0].std()


def frames(y: Array) -> Array:
    """Return what a camera sends of a few fast moves: each third sample, with its noise."""
    moves = np.cumsum(np.where(np.arange(len(y)) % 1000 < 30, 0.02, 0.0))[:, np.newaxis]
    return np.asarray((moves + 1e-3 * y)[::3].repeat(3, axis=0)[: len(y)])


@pytest.mark.parametrize(
    "change",
    [
        lambda y: y,
        lambda y: y.round(2),
        lambda y: y.round(1),
        lambda y: y.clip(-2.0, 2.0),
        lambda y: y[::2].repeat(2, axis=0),
        frames,
        np.sign,
        lambda y: np.where(np.arange(len(y))[:, np.newaxis] % 800 < 400, 0.0, y),
        lambda y: 0.0 * y,
    ],
    ids=[
        "whole",
        "0.01",
        "0.1",
        "clipped",
        "half rate",
        "frames",
        "two levels",
        "rests",
        "constant",
    ],
)
def test_without_dropouts___coarse_clipped_or_resting_outputs___are_left(
    change: Callable[[Array], Array],
) -> None:
    whole = measured()
    record = IoData(whole.u, change(whole.y), dt_s=DT_S, inputs=("u",), outputs=whole.outputs)
    assert without_dropouts(record) is record


def test_without_dropouts___missing_samples___stay_missing_and_are_not_told() -> None:
    whole = measured()
    y = whole.y.copy()
    y[500:506, 1] = np.nan
    record = IoData(whole.u, y, dt_s=DT_S, inputs=("u",), outputs=whole.outputs)
    assert without_dropouts(record) is record
