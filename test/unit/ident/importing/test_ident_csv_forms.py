"""Tests of tables as programs of the world write them: each is the arrays that it was made of."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from flexarm_bags.reader import opened
from flexarm_ident import read_bag
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_columns import TableColumns, named_columns
from flexarm_ident.importing.csv_import import import_csv
from flexarm_ident.importing.csv_record import read_csv
from support.bag_samples import typestore
from support.exhaustive import first_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from flexarm_ident import IoData
    from flexarm_ident.importing.csv_import import ImportSummary

ROWS, RATE_HZ = 240, 200.0
EPOCH_S = 1766147454


def signals() -> np.ndarray:
    """Return u, y1 and y2, (rows, 3), each with few decimals."""
    k = np.arange(ROWS)
    u = np.where(np.random.default_rng(5).integers(0, 2, ROWS // 4).repeat(4) > 0, 1.25, -0.75)
    return np.round(np.column_stack([u, 2.0 * np.sin(0.19 * k), np.cos(0.6 * k)]), 4)


def joined(head: str, separator: str, rows: Sequence[Sequence[str]], foot: str = "") -> str:
    return head + "".join(separator.join(row) + "\n" for row in rows) + foot


def cells(time: Callable[[int], str] | None = None, mark: str = ".") -> list[list[str]]:
    reported = [[f"{x:.4f}".replace(".", mark) for x in row] for row in signals()]
    first = time or (lambda k: f"{k / RATE_HZ:.3f}".replace(".", mark))
    return [[first(k), *row] for k, row in enumerate(reported)]


def day(k: int, date: str = "2024-03-01 ", end: str = "") -> str:
    return f"{date}12:00:{k / RATE_HZ:06.3f}{end}"


def two_topics(stamp: Callable[[float], str]) -> str:
    rows = []
    for k, (u, y1, y2) in enumerate(signals()):
        rows += [[stamp(k / RATE_HZ), f"{u}", "", ""], [stamp(k / RATE_HZ), "", f"{y1}", f"{y2}"]]
    return joined("__time,u,y1,y2\n", ",", rows)


def echo_p() -> str:
    head = "%time,field.header.seq,field.header.frame_id,u,y1,y2\n"
    rows = [
        [f"{EPOCH_S * 10**9 + k * 5_000_000}", f"{k}", "base_link", *row[1:]]
        for k, row in enumerate(cells())
    ]
    return joined(head, ",", rows)


def echo_2() -> str:
    rows = [
        [f"{EPOCH_S + k * 5 // 1000}", f"{k * 5 % 1000 * 10**6}", "base_link", *row[1:]]
        for k, row in enumerate(cells())
    ]
    return joined("", ",", rows)


LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t,\n"
    "***End_of_Header***\t\n\t\nChannels\t3\t\nSamples\t240\t240\t240\nDelta_X\t0,005\t0,005\t0,005\n"
    "X_Dimension\tTime\tTime\tTime\n"
    "***End_of_Header***\t\t\nX_Value\tu\ty1\ty2\tComment\n"
)
QUOTED = [[f'"{cell}"' for cell in row] for row in cells()]
THOUSANDS = [[t, f'"{1000.0 * float(u):,.2f}"', y1, y2] for t, u, y1, y2 in cells()]
FORMS: dict[str, tuple[str, float]] = {
    "hash": (joined("# t,u,y1,y2\n", ",", cells()), 200.0),
    "hash and blanks": (joined("# t u y1 y2\n", " ", cells()), 200.0),
    "percent": (joined("% t;u;y1;y2\n", ";", cells()), 200.0),
    "slashes": (joined("// rig 3\n// t\tu\ty1\ty2\n", "\t", cells()), 200.0),
    "comment below the names": (joined("t,u,y1,y2\n# begun\n", ",", cells()), 200.0),
    "units": (joined("t,u,y1,y2\nms,V,rad,m/s^2\n", ",", cells(lambda k: f"{5 * k}")), 200.0),
    "units in brackets": (joined("t;u;y1;y2\n[s];[A];[deg];[-]\n", ";", cells()), 200.0),
    "units in names": (joined("Time (s),u (V),y1 [rad],y2 [A]\n", ",", cells()), 200.0),
    "time by its unit": (joined("x-axis,u,y1,y2\nsecond,Volt,Volt,Volt\n", ",", cells()), 200.0),
    "semicolons and commas": (joined("t;u;y1;y2\n", ";", cells(mark=",")), 200.0),
    "blanks and commas": (joined("t\tu\ty1\ty2\n", "   ", cells(mark=",")), 200.0),
    "bars": (joined("| t | u | y1 | y2 |\n", " | ", [["", *row, ""] for row in cells()]), 200.0),
    "many blanks": (joined("   t   u   y1  y2\n", "    ", [["", *r] for r in cells()]), 200.0),
    "quotes": (joined('"t","u","y1","y2"\n', ",", QUOTED), 200.0),
    "quotes and blanks": (joined('"t", "u", "y1", "y2"\n', ", ", QUOTED), 200.0),
    "trailing commas": (joined("t,u,y1,y2,\n", ",", [[*row, ""] for row in cells()]), 200.0),
    "trailing commas of rows": (joined("t,u,y1,y2\n", ",", [[*r, ""] for r in cells()]), 200.0),
    "index": (joined(",t,u,y1,y2\n", ",", [[f"{k}", *r] for k, r in enumerate(cells())]), 200.0),
    "index of R": (
        joined('"t" "u" "y1" "y2"\n', " ", [[f'"{k}"', *r] for k, r in enumerate(cells())]),
        200.0,
    ),
    "footer": (joined("t,u,y1,y2\n", ",", cells(), "\nEnd of file\nTotal,,,\n"), 200.0),
    "blank lines": (joined("\n\nt,u,y1,y2\n\n", ",", [*cells()[:9], [], *cells()[9:]]), 200.0),
    "words between": (
        joined("boot\nt,u,y1,y2\n", ",", [*cells()[:9], ["# paused"], *cells()[9:]]),
        200.0,
    ),
    "sep": (joined("sep=;\nt;u;y1;y2\n", ";", cells(mark=",")), 200.0),
    "microseconds": (joined("t_us,u,y1,y2\n", ",", cells(lambda k: f"{k * 5000}")), 200.0),
    "ms since 1970": (
        joined("timestamp,u,y1,y2\n", ",", cells(lambda k: f"{EPOCH_S * 1000 + 5 * k}")),
        200.0,
    ),
    "ns since 1970": (
        joined("time,u,y1,y2\n", ",", cells(lambda k: f"{EPOCH_S * 10**9 + 5 * 10**6 * k}")),
        200.0,
    ),
    "seconds and nanoseconds": (
        joined(
            "header.stamp.sec,header.stamp.nanosec,u,y1,y2\n",
            ",",
            [
                [f"{9 + k // 200}", f"{k % 200 * 5000000}", *row[1:]]
                for k, row in enumerate(cells())
            ],
        ),
        200.0,
    ),
    "two topics": (two_topics(lambda t: f"{EPOCH_S + t:.6f}"), 200.0),
    "two topics in ns": (two_topics(lambda t: f"{EPOCH_S * 10**9 + round(t * 1e9)}"), 200.0),
    "echo -p": (echo_p(), 200.0),
    "date": (joined("time,u,y1,y2\n", ",", cells(day)), 200.0),
    "date of ISO 8601": (
        joined("Zeit,u,y1,y2\n", ",", cells(lambda k: day(k, "2024-03-01T", "+01:00"))),
        200.0,
    ),
    "date with Z": (
        joined("when,u,y1,y2\n", ",", cells(lambda k: day(k, "2024-03-01T", "000Z"))),
        200.0,
    ),
    "date of Germany": (
        joined(
            "time;u;y1;y2\n",
            ";",
            cells(lambda k: "13.03.2024 " + day(k, "").replace(".", ","), ","),
        ),
        200.0,
    ),
    "date of America": (
        joined("time,u,y1,y2\n", ",", cells(lambda k: day(k, "3/13/2024 ", " PM"))),
        200.0,
    ),
    "date and time": (
        joined(
            "Date,Time,u,y1,y2\n", ",", [["2024-03-01", *r] for r in cells(lambda k: day(k, ""))]
        ),
        200.0,
    ),
    "midnight": (
        joined(
            "time,u,y1,y2\n",
            ",",
            cells(
                lambda k: f"23:59:{59 + k / 200:.3f}" if k < 200 else f"00:00:{k / 200 - 1:06.3f}"
            ),
        ),
        200.0,
    ),
    "month by its name": (
        joined("time,u,y1,y2\n", ",", cells(lambda k: day(k, "01-Mar-2024 "))),
        200.0,
    ),
    "year of two digits, ms behind a colon": (
        joined(
            "Zeit;u;y1;y2\n",
            ";",
            cells(lambda k: f"01.03.24 12:00:{k // 200:02d}:{k % 200 * 5:03d}", ","),
        ),
        200.0,
    ),
    "days of a data frame": (
        joined("time,u,y1,y2\n", ",", cells(lambda k: f"3 days 00:00:{k / 200:09.6f}")),
        200.0,
    ),
    "quotes and decimal commas": (
        joined("t,u,y1,y2\n", ",", [[f'"{cell}"' for cell in row] for row in cells(mark=",")]),
        200.0,
    ),
    "counter of 32 bits": (
        joined("micros,u,y1,y2\n", ",", cells(lambda k: f"{(2**32 - 999_000 + 5000 * k) % 2**32}")),
        200.0,
    ),
    "counter of 16 bits": (
        joined("t_ms,u,y1,y2\n", ",", cells(lambda k: f"{(2**16 - 700 + 5 * k) % 2**16}")),
        200.0,
    ),
    "units behind blanks": (
        joined("  t [s]   u [V]  y1 [rad]   y2 [m/s^2]\n", "   ", cells()),
        200.0,
    ),
    "minutes and seconds": (
        joined("time,u,y1,y2\n", ",", cells(lambda k: f"02:{k / RATE_HZ:06.3f}")),
        200.0,
    ),
    "whole ms at 300 Hz": (
        joined("t_ms,u,y1,y2\n", ",", cells(lambda k: f"{round(k / 0.3)}")),
        300.0,
    ),
    "cut ms at 400 Hz": (joined("t_ms,u,y1,y2\n", ",", cells(lambda k: f"{int(k / 0.4)}")), 400.0),
    "hundredths at 60 Hz": (
        joined("time,u,y1,y2\n", ",", cells(lambda k: f"{round(k / 60.0, 2):.2f}")),
        60.0,
    ),
    "date in ms at 300 Hz": (
        joined("time,u,y1,y2\n", ",", cells(lambda k: f"2024-03-01 12:00:{k / 300.0:06.3f}")),
        300.0,
    ),
    "LabVIEW": (joined(LVM, "\t", cells(mark=",")), 200.0),
    "plotter": (
        joined(
            "ready\n",
            " ",
            [[f"t:{t}", f"u:{u}", f"y1:{y1}", f"y2:{y2}"] for t, u, y1, y2 in cells()],
        ),
        200.0,
    ),
    "plotter with commas": (
        joined(
            "", ", ", [[f"t={t}", f"u={u}", f"y1={y1}", f"y2={y2}"] for t, u, y1, y2 in cells()]
        ),
        200.0,
    ),
    "serial monitor with clock": (
        joined(
            "time,u,y1,y2\n",
            " -> ",
            [[day(k, ""), ",".join(row[1:])] for k, row in enumerate(cells())],
        ),
        200.0,
    ),
    "JSON lines": (
        joined(
            "", "", [[f'{{"t": {t}, "u": {u}, "y1": {a}, "y2": {b}}}'] for t, u, a, b in cells()]
        ),
        200.0,
    ),
    "oscilloscope": (
        joined(
            "Interval,5e-3\nX,u,y1,y2,Start,Increment,\nms,Volt,Volt,Volt,0.0,5e-3,\n",
            ",",
            cells(lambda k: f"{5 * k}"),
        ),
        200.0,
    ),
    "Fortran": (
        joined("t u y1 y2\n", " ", cells(lambda k: f"{k / 200.0:.6E}".replace("E", "D"))),
        200.0,
    ),
    "automation": (
        joined(
            "Name;u;y1;y2\nType;REAL64;REAL64;REAL64\nTime [ms];u;y1;y2\n",
            ";",
            cells(lambda k: f"{5 * k}"),
        ),
        200.0,
    ),
    "log of a node": (
        joined(
            "",
            "",
            [
                [f"[INFO] [{k}] [rig]: t={t} u={u} y1={a} y2={b}"]
                for k, (t, u, a, b) in enumerate(cells())
            ],
        ),
        200.0,
    ),
    "durations": (joined("Time,u,y1,y2\n", ",", cells(lambda k: f"{5 * k / 1000:g} sec")), 200.0),
    "minus of print": (joined("t,u,y1,y2\n", ",", cells()).replace("-", "\u2212"), 200.0),
    "name of a run": (
        joined("Time (ms) Run #1,u,y1,y2\n", ",", cells(lambda k: f"{5 * k}")),
        200.0,
    ),
    "types below the names": (
        joined(
            "time,u,y1,y2\nType: double,Type: double,,\nInterp: linear,Interp: zoh,,\ns,V,deg,A\n",
            ",",
            cells(),
        ),
        200.0,
    ),
    "names twice": (
        joined("t,u,y1,y2\n", ",", [*cells()[:200], ["t", "u", "y1", "y2"], *cells()[200:]]),
        200.0,
    ),
    "1500 Hz in whole ms": (
        joined("t_ms,u,y1,y2\n", ",", cells(lambda k: f"{int(k / 1.5)}")),
        1500.0,
    ),
    "hours": (
        joined(
            "t_h,heater,u,y1,y2\n",
            ",",
            [[f"{k / 10.0:.1f}", "1", *row[1:]] for k, row in enumerate(cells())],
        ),
        1.0 / 360.0,
    ),
    "two equal names": (
        joined("t,x,x,u,y1,y2\n", ",", [[r[0], "1", "2", *r[1:]] for r in cells()]),
        200.0,
    ),
}


def imported(
    folder: Path, text: str | bytes, times: Sequence[str] = (), names: str = "u y1 y2"
) -> tuple[ImportSummary, IoData]:
    file = folder / "run.csv"
    file.write_bytes(text.encode() if isinstance(text, str) else text)
    u, *y = names.split()
    columns = TableColumns((u,), tuple(y), tuple(times))
    mapping = named_columns(file, columns)
    made = import_csv(file, mapping, folder / "bag", typestore=typestore())
    record, kept = read_csv(file, mapping), read_bag(folder / "bag")
    # The bag of an import is the same record.
    for name in ("u", "y", "dt_s", "inputs", "outputs", "missing", "input_held", "closed_loop"):
        np.testing.assert_array_equal(getattr(record, name), getattr(kept, name))
    assert made.notes == tuple(each.text for each in record.notices if each.code == "table")
    return made, record


def expect_arrays(record: IoData, rate_hz: float = RATE_HZ, rows: int = ROWS) -> None:
    assert 1.0 / record.dt_s == pytest.approx(rate_hz, rel=1e-9)
    assert len(record) == rows
    np.testing.assert_allclose(record.u[:, 0], signals()[:rows, 0], atol=1e-12)
    np.testing.assert_allclose(record.y, signals()[:rows, 1:], atol=1e-12)


@pytest.mark.parametrize("form", FORMS)
def test_table___as_a_program_writes_it___is_its_arrays(tmp_path: Path, form: str) -> None:
    text, rate_hz = FORMS[form]
    made, record = imported(tmp_path, text)
    expect_arrays(record, rate_hz)
    assert (made.missing_rows, made.missing_cells) == (0, 0)


@pytest.mark.parametrize(
    "encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "latin-1", "cp1252", "utf-8-sig"]
)
def test_table___in_another_encoding___is_its_arrays(tmp_path: Path, encoding: str) -> None:
    text = joined("t,u,Dr\u00fcck,y2\n", ",", cells()).encode(encoding)
    expect_arrays(imported(tmp_path, text, names="u Dr\u00fcck y2")[1])


def test_table___without_names___has_counted_ones_and_its_rate_is_reported(tmp_path: Path) -> None:
    noise = "MOT: Monitor enabled!\nMOT: Init\nMOT: Ready.\n"
    text = joined(noise, "\t", [row[1:] for row in cells()])
    expect_arrays(imported(tmp_path, text, ["200Hz"], "column_1 column_2 column_3")[1])


def test_table___of_a_message_with_a_header___has_its_stamps(tmp_path: Path) -> None:
    expect_arrays(imported(tmp_path, echo_2(), (), "column_4 column_5 column_6")[1])


def test_units___in_a_line_or_in_names___are_those_of_the_channels(tmp_path: Path) -> None:
    text = joined("t,u (V),y1,y2\n(s),,[rad],Nm\n", ",", cells())
    (tmp_path / "run.csv").write_text(text)
    imported(tmp_path, text)
    with opened(tmp_path / "bag") as bag:
        connections = [each for each in bag.reader.connections if "channels" in each.topic]
        _, _, raw = next(bag.reader.messages(connections))
        info: Any = bag.reader.deserialize(raw, "flexarm_msgs/msg/ChannelInfo")
    assert (info.input_units, info.output_units) == (["V"], ["rad", "Nm"])


def test_thousands___in_quotes___are_one_number(tmp_path: Path) -> None:
    _, record = imported(tmp_path, joined("t,u,y1,y2\n", ",", THOUSANDS))
    np.testing.assert_allclose(record.u[:, 0], 1000.0 * signals()[:, 0])


def test_thousands___with_decimal_commas___are_one_number(tmp_path: Path) -> None:
    rows = [[t, f"{1e4 * float(u):,.2f}".translate(str.maketrans(",.", ".,")), y1.replace(".", ","),
             y2.replace(".", ",")] for t, u, y1, y2 in cells(mark=".")]  # fmt: skip
    rows = [[t.replace(".", ","), *rest] for t, *rest in rows]
    _, record = imported(tmp_path, joined("t;u;y1;y2\n", ";", rows))
    np.testing.assert_allclose(record.u[:, 0], 1e4 * signals()[:, 0])
    np.testing.assert_allclose(record.y, signals()[:, 1:])


def test_rounded_times___of_which_a_row_is_missing___have_a_hole(tmp_path: Path) -> None:
    rows = cells(lambda k: f"{round(k / 0.3)}")
    made, record = imported(tmp_path, joined("t_ms,u,y1,y2\n", ",", [*rows[:90], *rows[93:]]))
    assert (made.rate_hz, made.missing_rows) == (300.0, 3)
    np.testing.assert_allclose(record.y[93:], signals()[93:, 1:])


def test_two_topics___of_different_instants_and_rates___are_on_the_outputs_grid(
    tmp_path: Path,
) -> None:
    rows = []
    for k, (u, y1, y2) in enumerate(signals()):
        rows.append((5 * k + 1.3, "", f"{y1}", f"{y2}"))
        if k % 4 == 0:
            rows.append((5.0 * k + 1.3, f"{u}", "", ""))
    rows.sort(key=lambda row: row[0])
    text = joined("time_ms,u,y1,y2\n", ",", [[f"{t:.1f}", *rest] for t, *rest in rows])
    made, record = imported(tmp_path, text)
    expect_arrays(record)
    assert made.notes[0] == "each column has its own rows: put on one grid of 200 Hz"


@pytest.mark.parametrize(
    ("head", "time", "unit"),
    [
        ("t,u,y1,y2", lambda k: f"{k * 312.5:.0f}", "us"),
        ("timestamp,u,y1,y2", lambda k: f"{k * 0.3125}", "ms"),
        ("time,u,y1,y2", lambda k: f"{k * 5000}", "us"),
        ("time,u,y1,y2", lambda k: f"{k * 125}", "us"),
        ("t,u,y1,y2", lambda k: f"{k / 0.3:.3f}", "ms"),
    ],
)
def test_times___that_are_hardly_seconds___are_asked_about(
    tmp_path: Path, head: str, time: Callable[[int], str], unit: str
) -> None:
    name = head.partition(",")[0]
    text = joined(f"{head}\n", ",", cells(time))
    with pytest.raises(CsvImportError, match=rf"--time '{name}:{unit}'|as in time_us"):
        imported(tmp_path, text)
    per_s = {"us": 1e6, "ms": 1e3}[unit]
    made, _ = imported(tmp_path, text, [f"{name}:{unit}"])
    assert made.rate_hz == pytest.approx(per_s / (float(time(200)) / 200), rel=1e-3)


def test_times___of_motors_below_half_a_hertz___are_asked_about(tmp_path: Path) -> None:
    text = joined("t,motor current,angle_deg,y2\n", ",", cells(lambda k: f"{5 * k}"))
    (tmp_path / "run.csv").write_text(text)
    mapping = named_columns(tmp_path / "run.csv", TableColumns(("motor current",), ("angle_deg",)))
    with pytest.raises(CsvImportError, match=r"column t gives 0\.2 Hz .* are they in ms\?"):
        import_csv(tmp_path / "run.csv", mapping, tmp_path / "bag", typestore=typestore())


@pytest.mark.parametrize("step_s", [0.5, 1, 2, 10, 15, 30, 60, 300, 900, 312.5])
def test_times___of_slow_plants___are_taken(tmp_path: Path, step_s: float) -> None:
    head = "t,heater_power,tank_temp,y2\n"
    (tmp_path / "run.csv").write_text(joined(head, ",", cells(lambda k: f"{step_s * k}")))
    mapping = named_columns(tmp_path / "run.csv", TableColumns(("heater_power",), ("tank_temp",)))
    made = import_csv(tmp_path / "run.csv", mapping, tmp_path / "bag", typestore=typestore())
    assert made.rate_hz == pytest.approx(1.0 / step_s)
    assert made.notes == ()


@pytest.mark.parametrize("step_s", [1, 10, 60, 900])
def test_times___at_steps_that_people_choose___are_taken_whatever_the_names(
    tmp_path: Path, step_s: float
) -> None:
    made, _ = imported(tmp_path, joined("t,u,y1,y2\n", ",", cells(lambda k: f"{step_s * k}")))
    assert made.rate_hz == pytest.approx(1.0 / step_s)
    assert all("are they in" in note for note in made.notes)


@pytest.mark.parametrize(
    ("last", "first", "said"),
    [(150, 0, r"line 152: .* make a file of each run"), (100, 99, r"line 102: .* keep one")],
)
def test_times___that_do_not_rise___are_refused_with_their_line(
    tmp_path: Path, last: int, first: int, said: str
) -> None:
    text = joined("t,u,y1,y2\n", ",", [*cells()[:last], *cells()[first:]])
    with pytest.raises(CsvImportError, match=said):
        imported(tmp_path, text)


@pytest.mark.parametrize(
    "cell",
    first_of(
        [
            *("?", "#DIV/0!", "1.#QNAN", "OVF", "<missing>", "-", "Bad", "No Data", "--.--", "*"),
            *("#NV", "#N/V", "#WERT!"),
        ],
        5,
    ),
)
def test_word___that_a_program_writes_for_no_number___is_a_hole(tmp_path: Path, cell: str) -> None:
    rows = cells()
    rows[50][2] = cell
    made, _ = imported(tmp_path, joined("t,u,y1,y2\n", ",", rows))
    assert made.missing_cells == 1
