"""Record from named columns and back."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_core.errors import DataError
from flexarm_ident import from_columns, to_columns


def a_table() -> dict[str, list[float]]:
    return {
        "t": [0.0, 0.5, 1.0, 1.5],
        "drive_v": [1.0, 2.0, 3.0, 4.0],
        "angle_deg": [0.1, float("nan"), 0.3, 0.4],
        "remark": [0.0, 0.0, 0.0, 0.0],
    }


def test_columns___there_and_back___are_the_same_record() -> None:
    record = from_columns(a_table(), inputs=["drive_v"], outputs=["angle_deg"], time="t")
    assert record.dt_s == pytest.approx(0.5)
    assert (record.inputs, record.outputs) == (("drive_v",), ("angle_deg",))
    columns = to_columns(record)
    assert list(columns) == ["time_s", "drive_v", "angle_deg"]
    for name, given in (("time_s", "t"), ("drive_v", "drive_v"), ("angle_deg", "angle_deg")):
        np.testing.assert_allclose(columns[name], a_table()[given])
    again = from_columns(columns, inputs=record.inputs, outputs=record.outputs)
    np.testing.assert_allclose(again.y_measured, record.y_measured)


def test_columns___time_in_the_unit_of_its_name___is_scaled() -> None:
    table = {**a_table(), "time_ms": [0.0, 5.0, 10.0, 15.0]}
    record = from_columns(table, inputs=["drive_v"], outputs=["remark"], time="time_ms")
    assert record.dt_s == pytest.approx(0.005)


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("t", [0.0, 0.5, 1.2, 1.5], r"column t: .*equal steps.* at row 2 "),
        ("t", [0.0, 0.0, 0.0, 0.0], r"column t: .*equal steps"),
        ("t", [0.0, 0.5, float("nan"), 1.5], r"column t: .*equal steps"),
        ("drive_v", ["a", "b", "c", "d"], r"column drive_v holds something else than numbers"),
    ],
)
def test_columns___without_even_time_or_numbers___are_refused(
    name: str, values: list[object], words: str
) -> None:
    with pytest.raises(DataError, match=words):
        from_columns(
            {**a_table(), name: values}, inputs=["drive_v"], outputs=["angle_deg"], time="t"
        )


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("begin", ["2024-03-01T12:00", None])
def test_columns___dates_and_time_differences___are_taken_in_their_own_unit(
    unit: str, begin: str | None
) -> None:
    steps = np.array([0, 2, 4, 6]).astype("timedelta64[s]").astype(f"timedelta64[{unit}]")
    times = steps if begin is None else np.array(begin, f"datetime64[{unit}]") + steps
    table = {**a_table(), "t": times}
    record = from_columns(table, inputs=["drive_v"], outputs=["angle_deg"], time="t")
    assert record.dt_s == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("drive_v", np.array([1, 2, 3, 4], "datetime64[s]"), "drive_v holds something else than"),
        ("angle_deg", [1.0, 2.0j, 3.0, 4.0], "angle_deg holds something else than numbers"),
        ("drive_v", [1.0, 2.0, 3.0], "column drive_v has 3 rows, t has 4"),
        ("t", [0.0, 0.5, 1.0], "column drive_v has 4 rows, t has 3"),
    ],
)
def test_columns___what_numpy_would_bend_into_numbers___is_refused(
    name: str, values: object, words: str
) -> None:
    with pytest.raises(DataError, match=words):
        from_columns(
            {**a_table(), name: values}, inputs=["drive_v"], outputs=["angle_deg"], time="t"
        )


def test_columns___unknown_name___is_reported_with_those_that_there_are() -> None:
    with pytest.raises(
        DataError, match=r"no column time_s; there are: t, drive_v, angle_deg, remark"
    ):
        from_columns(a_table(), inputs=["drive_v"], outputs=["angle_deg"])
