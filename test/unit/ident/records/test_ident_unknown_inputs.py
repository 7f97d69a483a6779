"""Parts of a record between holes with an unknown input."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from scipy import signal

from flexarm_ident import DataError, IoData, validate_dmv
from flexarm_ident.records.unknown_inputs import known_parts
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run

if TYPE_CHECKING:
    from collections.abc import Sequence

DT_S = 0.01


def record(holes: Sequence[tuple[int, int]], samples: int = 3000, seed: int = 1) -> IoData:
    """Return a record of a free mass, an integrator behind a lag, with lost samples."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], samples // 20), 20).astype(float)
    speed = signal.lfilter([0.0, 0.05], [1.0, -0.95], u)
    place = signal.lfilter([0.0, DT_S], [1.0, -1.0], speed)
    y = np.column_stack([place, speed])
    y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
    held = np.zeros(samples, dtype=np.bool_)
    for first, last in holes:
        held[first:last] = True
        u[first:last], y[first:last] = u[first - 1], np.nan
    return IoData(
        u, y, dt_s=DT_S, inputs=("u",), outputs=("place", "speed"), source="run", input_held=held
    )


def lengths(holes: Sequence[tuple[int, int]], samples: int = 3000) -> list[int]:
    """Return the lengths of the parts of a record with these holes."""
    return [len(part) for part in known_parts(record(holes, samples))]


def test_known_parts___long_hole___parts_the_record_there() -> None:
    whole = record([(1000, 1050)])
    first, second = known_parts(whole)
    assert [first.source, second.source] == ["run, 0 to 10 s", "run, 10.5 to 30 s"]
    np.testing.assert_array_equal(second.y, whole.y[1050:])
    (reported,) = first.notices
    assert (reported.code, reported.figures) == ("lost_samples", {"holes": 1.0, "longest_s": 0.5})
    assert not second.notices


@pytest.mark.parametrize(
    ("holes", "expected"),
    [
        ([], [3000]),
        ([(1000, 1003)], [3000]),
        ([(1000, 1004)], [1000, 1996]),
        # A part of 199 samples would be too short.
        ([(199, 260)], [3000]),
        ([(200, 260)], [200, 2740]),
        ([(2801, 2860)], [3000]),
        # The longer one of two that are too close to each other.
        ([(1000, 1010), (1100, 1200)], [1100, 1800]),
    ],
)
def test_known_parts___holes___part_where_both_sides_are_long_enough(
    holes: list[tuple[int, int]], expected: list[int]
) -> None:
    assert lengths(holes) == expected


def test_known_parts___many_holes___are_ten_parts_at_most() -> None:
    holes = [(first, first + 10) for first in range(400, 9000, 400)]
    assert len(lengths(holes, 10_000)) == 10


def test_known_parts___input_known_throughout___is_the_record_itself() -> None:
    whole = record([])
    (same,) = known_parts(whole)
    assert same is whole


def test_io_data___input_held_of_another_length___is_refused() -> None:
    with pytest.raises(DataError, match="input_held has 2 samples, u has 3"):
        IoData(
            np.arange(3.0),
            np.ones((3, 1)),
            dt_s=1.0,
            outputs=("y",),
            input_held=np.array([False, True]),
        )


def test_run___free_mass_and_a_hole_with_an_unknown_input___is_as_good_as_without() -> None:
    fresh = record([], seed=2)
    for holes in ([], [(1000, 1100)]):
        outcome = run(record(holes), Request())
        assert validate_dmv(outcome.model, fresh).mean < 0.02
        assert outcome.verdict.error < 0.02
