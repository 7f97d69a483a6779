"""Tests of tables as laboratories write them: read as their arrays, or refused with what to do."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_columns import TableColumns
from flexarm_ident.importing.csv_record import read_csv

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from flexarm_ident import IoData

ROWS, RATE_HZ = 300, 200.0
RANDOM = np.random.default_rng(49)
U = np.round(RANDOM.normal(size=ROWS), 3)
Y = np.round(np.sin(0.19 * np.arange(ROWS)) + 0.1 * RANDOM.normal(size=ROWS), 3)
LOST = frozenset({40, 41, 42, 90, 150, 151})


def text(
    time: Callable[[int], str] = lambda k: f"{k / RATE_HZ:.3f}",
    u: Callable[[int], str] = lambda k: f"{U[k]:.3f}",
    y: Callable[[int], str] = lambda k: f"{Y[k]:.3f}",
    head: str = "t,u,y\n",
    mark: str = ",",
) -> str:
    return head + "".join(mark.join([time(k), u(k), y(k)]) + "\n" for k in range(ROWS))


def read(folder: Path, content: str, *, u: str = "u", y: str = "y", time: str = "") -> IoData:
    file = folder / "run.csv"
    file.write_bytes(content.encode())
    return read_csv(file, TableColumns((u,), (y,), (time,) if time else ()))


def notes(record: IoData) -> str:
    return "\n".join(each.text for each in record.notices)


def log(before: Callable[[int], str], head: str = "", names: tuple[str, str] = ("", "")) -> str:
    """Return a log with words before each row."""
    u, y = names
    return head + "".join(f"{before(k)}{u}{U[k]:.3f}, {y}{Y[k]:.3f}\n" for k in range(ROWS))


def clock(k: int, mark: str = ".") -> str:
    return f"13:05:{k // 200:02d}{mark}{k % 200 * 5:03d}"


NAMED = ("u: ", "y: ")
FORMS = {
    "clock in brackets": log(lambda k: f"[{clock(k)}] ", names=NAMED),
    "clock and level": log(lambda k: f"27/11/2026, {clock(k, ',')} [INFO] arm - ", names=NAMED),
    "clock of a system log": log(lambda k: f"Nov 27 {clock(k)} host arm[12]: ", names=("u=", "y=")),
    "seconds in brackets": log(lambda k: f"[{312 + k / RATE_HZ:11.6f}] arm: ", names=NAMED),
    "milliseconds behind a level": log(lambda k: f"I ({312 + 5 * k}) arm: ", names=NAMED),
    "clock before cells": log(lambda k: f"[{clock(k)}] ", "u,y\n"),
    "clock and words before cells": log(lambda k: f"2026-11-27 {clock(k, ',')} RX: ", "u,y\n"),
    "units": text(lambda k: f"{5 * k} ms", lambda k: f"{U[k]:.3f} V", lambda k: f"{Y[k]:.3f}mm"),
    "apostrophes": text(u=lambda k: f"'{U[k]:.3f}", y=lambda k: f"'{Y[k]:.3f}"),
    "accounting": text(u=lambda k: f"({-U[k]:.3f})" if U[k] < 0.0 else f"{U[k]:.3f}"),
    "checksums": text(y=lambda k: f"{Y[k]:.3f}*{k % 256:02X}"),
    "stamps in brackets": text(lambda k: f"({1796000000 + k / RATE_HZ:.3f})"),
    "names in two lines": text(head='"t\n[s]","u\n[V]","y\n[mm]"\n'),
    "rates below units": text(
        head="Catman\n\nt\tu\ty\ns\tV\tmm\n200 Hz\t200 Hz\t200 Hz\n\n", mark="\t"
    ),
    "keys above names": text(head="Offset,0,Offset\nt,u,y\nMask,0xFF,Mask\n"),
    "lists": "t,u,y\n" + re.sub("(?m)^(.+)$", r"[\1],", text(head="")),
    "zero bytes between": text().replace("\n0.5", "\n" + "\0" * 99 + "0.5", 1),
    "words below": text() + "Max,1.2,3.4\nMin,-1.2,-3.4\n",
    "basic form of ISO 8601": text(lambda k: f"20261127T1305{k // 200:02d}.{k % 200 * 5:03d}Z"),
    "ms behind a semicolon": text(lambda k: f"13:05:{k // 200:02d};{k % 200 * 5:03d}"),
    "counter of 24 bits": text(
        lambda k: f"{(2**24 - 300_000 + 5000 * k) % 2**24}", head="t_us,u,y\n"
    ),
    "signed counter": text(
        lambda k: f"{(5000 * k - 300_000) % 2**32 - 2**31}", head="micros,u,y\n"
    ),
    "part of a second": text(lambda k: f"{(k + 37) % 50 * 20}", head="ms,u,y\n"),
}
RATES_HZ = {"part of a second": 50.0}


@pytest.mark.parametrize("form", FORMS)
def test_table___as_a_laboratory_writes_it___is_its_arrays(tmp_path: Path, form: str) -> None:
    broken = form == "names in two lines"
    record = read(
        tmp_path, FORMS[form], u="u [V]" if broken else "u", y="y [mm]" if broken else "y"
    )

    assert 1.0 / record.dt_s == pytest.approx(RATES_HZ.get(form, RATE_HZ), rel=1e-9)
    np.testing.assert_allclose(record.u[:, 0], U, atol=1e-9)
    np.testing.assert_allclose(record.y[:, 0], Y, atol=1e-9)


def test_units_of_cells___that_differ___are_refused(tmp_path: Path) -> None:
    content = text(y=lambda k: f"{Y[k]:.3f} V" if k != 70 else "980 mV")

    with pytest.raises(CsvImportError, match="line 72, column y: '980 mV' is not a number"):
        read(tmp_path, content)


@pytest.mark.parametrize("states", [("OFF", "ON"), ("false", "true"), ("0x00", "0x01")])
def test_states_and_hexadecimals___are_numbers(tmp_path: Path, states: tuple[str, str]) -> None:
    record = read(tmp_path, text(u=lambda k: states[int(U[k] > 0.0)]))

    np.testing.assert_array_equal(record.u[:, 0], U > 0.0)


@pytest.mark.parametrize(
    "cell", ["OVER", "1.#INF", "\u221e", "(null)", "n.d.", "I/O Timeout", "inf", "-99999", "1E+30"]
)
def test_what_stands_for_no_number___in_an_output___is_a_hole_with_a_note(
    tmp_path: Path, cell: str
) -> None:
    record = read(tmp_path, text(y=lambda k: cell if k in LOST else f"{Y[k]:.3f}"))

    assert record.missing is not None
    assert set(np.flatnonzero(record.missing[:, 0])) == LOST
    assert "in 6 rows" in notes(record)
    assert "taken as not measured" in notes(record)


def test_number_that_stands_for_none___in_an_input___is_refused(tmp_path: Path) -> None:
    content = text(u=lambda k: "-99999" if k in LOST else f"{U[k]:.3f}")

    with pytest.raises(CsvImportError, match=r"u is -99999 in 6 rows, far off all .* fill it"):
        read(tmp_path, content)


def test_extreme___that_comes_once_or_among_others___stays(tmp_path: Path) -> None:
    once = read(tmp_path, text(y=lambda k: "99" if k == 70 else f"{Y[k]:.3f}"))
    clipped = read(tmp_path, text(y=lambda k: f"{min(Y[k], 0.5):.3f}"))

    assert once.y[70, 0] == 99.0
    assert clipped.missing is None


def test_counts_without_their_sign___have_it_again(tmp_path: Path) -> None:
    counts = np.rint(100.0 * U).astype(int)
    record = read(tmp_path, text(u=lambda k: f"{counts[k] % 2**16}"))

    np.testing.assert_array_equal(record.u[:, 0], counts)
    assert "16 bits without their sign" in notes(record)


def test_runs_of_one_second___are_no_clock(tmp_path: Path) -> None:
    with pytest.raises(CsvImportError, match="begins anew: make a file of each run"):
        read(tmp_path, text(lambda k: f"{k % 50 * 20}", head="ms,u,y\n"))


@pytest.mark.parametrize(
    ("time", "reported"),
    [
        (lambda k: f"{(k // 10) * 0.05:.3f}", r"line 3: .* packets .* their rate \(2\d\d Hz"),
        (lambda k: f"{(ROWS - k) / 200:.3f}", "line 3: .* sort the rows .* backwards"),
        (
            lambda k: f"{(k + 1000) / 200 - 0.4321 * (k > 99):.4f}",
            "line 102: .* goes back by 0.427",
        ),
        (lambda k: f"{(k + 1000) / 200 * (k > 0):.3f}", "line 2: .* first row .* take it out"),
        (lambda k: f"{k / 200 if k else 9.0:.3f}", "line 2: .* first row .* take it out"),
    ],
)
def test_times___that_do_not_rise___are_refused_with_what_to_do(
    tmp_path: Path, time: Callable[[int], str], reported: str
) -> None:
    with pytest.raises(CsvImportError, match=reported):
        read(tmp_path, text(time))


@pytest.mark.parametrize(
    ("content", "reported"),
    [
        (b"\0\0\0\0\x90\x01\0\0\1\0\0\0\0\0\0\0\2\0\0\0u\0" + bytes(99), "is a MATLAB file"),
        (b"MDF     4.10    " + bytes(99), "is an ASAM MDF file"),
        (b"#BEGINGLOBALHEADER\n1,DIAdem Header\n", "is the header of a DIAdem file"),
        (b"    -1\n    58\narm\n 1.0 2.0\n", "is a universal file"),
        (b'[{"t": 0.0, "u": 1.0}, {"t": 0.1, "u": 2.0}]', "is a JSON document"),
        (b"date Fri Nov 27 2026\nbase hex  timestamps absolute\n", "is a log of CAN frames"),
        (
            b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nRCOU, 1, 1.5, 0\n",
            "is a log of ArduPilot",
        ),
        (
            b"".join(b"%s,13:05:01,%d,1,%d\n" % (b"uy"[k % 2 :][:1], k, k) for k in range(20)),
            "has one value a row",
        ),
    ],
)
def test_file___that_is_no_table___says_what_it_is(
    tmp_path: Path, content: bytes, reported: str
) -> None:
    file = tmp_path / "run.dat"
    file.write_bytes(content)

    with pytest.raises(CsvImportError, match=rf"run\.dat: {reported}"):
        read_csv(file, TableColumns(("u",), ("y",)))


def test_columns_of_labview_without_times___ask_for_the_rate(tmp_path: Path) -> None:
    head = (
        "X_Columns\tNo\n***End_of_Header***\t\nChannels\t2\t\nSamples\t300\t300\n"
        "Delta_X\t0.005\t0.005\n***End_of_Header***\t\t\nX_Value\tu\ty\tComment\n"
    )
    content = text(lambda _: "", head=head, mark="\t")

    with pytest.raises(
        CsvImportError, match="X_Value has no number: give the rate as --time 200Hz"
    ):
        read(tmp_path, content)
    np.testing.assert_allclose(read(tmp_path, content, time="200Hz").u[:, 0], U)


def test_period_of_an_encoder_of_lines___is_found(tmp_path: Path) -> None:
    turns = 0.6 * np.sin(0.05 * np.arange(ROWS))
    record = read(tmp_path, text(y=lambda k: f"{int(10000 * turns[k]) % 10000}"))

    assert "y wraps at 10000" in notes(record)
    np.testing.assert_allclose(np.diff(record.y[:, 0]), np.diff(10000 * turns), atol=1.0)
