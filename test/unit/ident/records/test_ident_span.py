"""Parts of records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_ident import DataError, IoData, Span
from flexarm_ident.records.span import measured, without
from flexarm_ident.records.unknown_inputs import known_parts

ROWS = 3000


def record() -> IoData:
    """Return 30 s at 100 Hz whose values are the numbers of the rows."""
    k = np.arange(float(ROWS))
    return IoData(k, np.column_stack([k, -k]), dt_s=0.01, inputs=("u",), outputs=("a", "b"))


@pytest.mark.parametrize(
    ("span", "first", "stop"),
    [
        (Span(4.0, 12.0), 400, 1200),
        (Span(4.0), 400, ROWS),
        (Span(to_s=12.0), 0, 1200),
        (Span(0.0, 30.0), 0, ROWS),
        # No row stands at this instant: the nearest one.
        (Span(0.123), 12, ROWS),
    ],
)
def test_span___of_a_record___has_the_rows_between(span: Span, first: int, stop: int) -> None:
    part = span.of(replace(record(), source="run"))
    np.testing.assert_array_equal(part.u[:, 0], np.arange(first, stop))
    np.testing.assert_array_equal(part.y[:, 1], -np.arange(float(first), stop))
    assert part.begins_s == pytest.approx(0.01 * first)
    assert part.label.startswith("run, ")


def test_span___of_everything___is_the_record_itself() -> None:
    whole = record()
    assert Span().of(whole) is whole


def test_span___of_a_part___counts_from_its_first_row() -> None:
    part = Span(2.0).of(Span(4.0, 12.0).of(record()))
    assert (part.u[0, 0], part.begins_s, len(part)) == (600.0, 6.0, 600)


@pytest.mark.parametrize(
    ("from_s", "to_s", "message"),
    [
        (12.0, 4.0, r"--to 4 s is not behind --from 12 s: give .*to_s"),
        (4.0, 4.0, "--to 4 s is not behind --from 4 s"),
        (-1.0, None, "--from -1 s is not a time in a record"),
        (0.0, float("nan"), "--to nan s is not a time in a record"),
        (30.0, None, "run: --from 30 s is behind its end at 30 s: give an earlier instant"),
        (0.0, 30.02, "run: --to 30.02 s is behind its end at 30 s: give an earlier instant"),
        (4.0, 4.2, "run: --from 4 s --to 4.2 s leaves 20 samples, at least 50 .* longer part"),
    ],
)
def test_span___that_no_record_has___is_refused_with_option_and_value(
    from_s: float, to_s: float | None, message: str
) -> None:
    with pytest.raises(DataError, match=message) as caught:
        Span(from_s, to_s).of(replace(record(), source="run"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("stretches", "options"),
    [
        ([(0, 500)], "--from 5s"),
        ([(2500, ROWS)], "--to 25s"),
        ([(1000, 1003)], "--from 10.03s"),
        ([(0, 500), (2000, 2100)], "--from 5s --to 20s"),
    ],
)
def test_options___stretches_to_leave_out___keep_the_longest_part(
    stretches: list[tuple[int, int]], options: str
) -> None:
    assert without(record(), stretches) == options


def test_options___stretch_of_a_part___have_the_whole_records_time() -> None:
    assert without(Span(4.0, 12.0).of(record()), [(700, 750)]) == "--from 4s --to 11s"


def test_known_parts___of_a_part___are_named_by_the_whole_records_time() -> None:
    held = np.zeros(ROWS, dtype=np.bool_)
    held[1000:1100] = True
    part = Span(4.0).of(replace(record(), source="run", input_held=held))
    first, second = known_parts(part)
    assert (first.label, second.label) == (
        "run, 4 to 30 s, 4 to 10 s",
        "run, 4 to 30 s, 11 to 30 s",
    )
    assert "the longest of 1 s at 10 s: " in first.notices[-1].text


@pytest.mark.parametrize("late", [[0], [1], [0, 1]])
def test_measured___sensor_that_begins_late___cuts_what_is_before(late: list[int]) -> None:
    y = record().y.copy()
    y[:700, late] = np.nan
    # A hole behind it stays.
    y[2000:2100, 0] = np.nan
    found = measured(replace(record(), y=y, missing=None))
    assert (found.u[0, 0], len(found), found.begins_s) == (700.0, ROWS - 700, 7.0)
    assert found.missing is not None
    assert np.flatnonzero(found.missing[:, 0]).tolist() == list(range(1300, 1400))
    (notice,) = found.notices
    name = record().outputs[late[0]]
    assert (notice.code, notice.channel) == ("partial_record", name)
    assert notice.text.startswith(f"{name} was not measured before 7 s (row 700): ")


def test_measured___record_known_from_its_start___is_itself() -> None:
    assert measured(whole := record()) is whole
    y = record().y.copy()
    y[50:60] = np.nan
    holed = replace(record(), y=y)
    assert measured(holed) is holed
