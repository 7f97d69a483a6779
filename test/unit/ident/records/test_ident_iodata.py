from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from flexarm_ident import DataError, IoData
from flexarm_ident.records.iodata import as_records

Y = np.arange(40.0).reshape(10, 4)
U = np.linspace(-1.0, 1.0, 10)


def arm(**changes: Any) -> IoData:  # noqa: ANN401
    fields: dict[str, Any] = {"u": U, "y": Y, "dt_s": 0.01} | changes
    return IoData(fields.pop("u"), fields.pop("y"), **fields)


def test_iodata___one_dimensional_arrays___become_one_channel() -> None:
    data = arm(compensation=0.5 * U, reference=U)
    assert data.u.shape == (10, 1)
    assert data.compensation is not None
    assert data.compensation.shape == (10, 1)
    assert data.reference is not None
    assert data.reference.shape == (10,)
    np.testing.assert_array_equal(data.effort[:, 0], 0.5 * U)


def test_iodata___after_construction___is_independent_and_read_only() -> None:
    y = Y.copy()
    data = arm(y=y)
    y[0, 0] = 99.0
    assert data.y[0, 0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        data.y[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        data.dt_s = 1.0  # type: ignore[misc]


def test_iodata___value_not_finite___names_channel_and_first_bad_row() -> None:
    y = Y.copy()
    y[7, 2], y[8, 0] = -np.inf, np.inf
    with pytest.raises(DataError, match=r"run 3: middle_strain_v is -inf in row 7"):
        arm(y=y, source="run 3")
    with pytest.raises(DataError, match=r"command_v is inf in row 4"):
        arm(u=np.where(np.arange(10) == 4, np.inf, 0.0))
    with pytest.raises(DataError, match=r"compensation of command_v is nan in row 0"):
        arm(compensation=np.full(10, np.nan))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dt_s": 0.0}, "dt_s must be a positive"),
        ({"dt_s": float("nan")}, "dt_s must be a positive"),
        ({"y": Y[:, :3]}, "y has 3 channels, but 4 names: position_v, base_strain_v, middle_"),
        ({"u": np.ones((1, 10))}, r"u has 10 channels \(transposed\?\), but 1 name: comm"),
        ({"u": U * 1j}, "u must be an array of real numbers"),
        ({"u": U.astype("datetime64[s]")}, "u must be an array of real numbers"),
        ({"y": [[1.0, 2.0], [3.0]]}, "y must be an array of real numbers"),
        (
            {"outputs": ("a", "b", "a.1", "a_1")},
            "a_1 is named twice in y: give each channel a name",
        ),
        ({"u": U[:9]}, "u has 9 samples, y has 10"),
        ({"compensation": U[:9]}, "compensation has 9 samples, u has 10"),
        ({"reference": U[:9]}, "reference has 9 samples, u has 10"),
        ({"u": np.zeros((0, 1))}, "u must be"),
        ({"y": np.zeros((10, 2, 2))}, "y must be"),
    ],
)
def test_iodata___malformed_record___raises_one_clear_line(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(DataError, match=message) as caught:
        arm(**changes)
    assert "\n" not in str(caught.value)


def test_split___fraction___parts_make_up_the_record() -> None:
    data = arm(compensation=U, reference=U)
    first, second = data.split(0.6)
    assert (len(first), len(second)) == (6, 4)
    np.testing.assert_array_equal(np.vstack([first.y, second.y]), Y)
    assert second.reference is not None
    np.testing.assert_array_equal(second.reference, U[6:])
    np.testing.assert_array_equal(data.head(6).y, first.y)
    assert len(data.head(99)) == 10


@pytest.mark.parametrize("fraction", [0.0, 1.0, -0.5, float("nan"), 0.01])
def test_split___fraction_leaves_a_part_empty___raises(fraction: float) -> None:
    with pytest.raises(DataError, match="fraction must lie between 0 and 1"):
        arm().split(fraction)


def test_as_records___records_of_other_rigs___raise() -> None:
    with pytest.raises(DataError, match="no record"):
        as_records([])
    with pytest.raises(DataError, match=r"b: outputs .* differ from .* of a"):
        as_records([arm(source="a"), arm(source="b", y=U, outputs=("position_v",))])
    with pytest.raises(DataError, match=r"b: dt_s 0.02 differs from 0.01 of a"):
        as_records([arm(source="a"), arm(source="b", dt_s=0.02)])


def test_as_records___periods_that_differ_by_what_few_stamps_say___are_of_one_rig() -> None:
    records = (arm(source="a", dt_s=1.0 / 200.0), arm(source="b", dt_s=1.0 / 200.1))
    assert as_records(records) == records
