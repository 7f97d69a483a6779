"""Tests of tables of instruments and programs: times of their own, rates in heads, odd cells."""

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
RANDOM = np.random.default_rng(149)
U = np.round(RANDOM.normal(size=ROWS), 3)
Y = np.round(np.sin(0.19 * np.arange(ROWS)) + 0.1 * RANDOM.normal(size=ROWS), 3)
T = np.arange(ROWS) / RATE_HZ


def text(row: Callable[[int], str], head: str = "t,u,y\n") -> str:
    return head + "".join(f"{row(k)}\n" for k in range(ROWS))


def plain(k: int) -> str:
    return f"{T[k]:.3f},{U[k]:.3f},{Y[k]:.3f}"


def read(
    folder: Path, content: str, *, u: str = "u", y: str = "y", time: str = "", name: str = "run.csv"
) -> IoData:
    file = folder / name
    file.write_bytes(content.encode())
    return read_csv(file, TableColumns((u,), (y,), (time,) if time else ()))


def beside(key: str, value: str, number: int, k: int) -> str:
    """Return the cells of a channel as oscilloscopes of Tektronix have them."""
    signal = (U, Y)[number][k]
    keys = {0: (key, value), 1: ("Source", f"CH{number + 1}"), 2: ("Vertical Units", "V")}
    return f"{','.join(keys.get(k, ('', '')))},,{T[k]:013.9f},{signal:12.6f},"


PAIRS = {
    "Simulink": ("time,u,time,y\n", "{t:.3f},{u:.3f},{t:.3f},{y:.3f}"),
    "LabVIEW": (
        "X_Columns\tMulti\n***End_of_Header***\t\nX_Value\tu\tX_Value\ty\tComment\n",
        "{t:.3f}\t{u:.3f}\t{t:.3f}\t{y:.3f}",
    ),
}


@pytest.mark.parametrize("form", PAIRS)
def test_columns_with_times_of_their_own___that_agree___are_rows(tmp_path: Path, form: str) -> None:
    head, row = PAIRS[form]
    record = read(tmp_path, text(lambda k: row.format(t=T[k], u=U[k], y=Y[k]), head))

    assert 1.0 / record.dt_s == pytest.approx(RATE_HZ)
    np.testing.assert_array_equal(record.u[:, 0], U)
    np.testing.assert_array_equal(record.y[:, 0], Y)


@pytest.mark.parametrize("time", ["", "time#1"])
def test_columns_with_times_of_their_own___that_differ___are_put_on_one_grid(
    tmp_path: Path, time: str
) -> None:
    def row(k: int) -> str:
        slow = f"{T[2 * k]:.3f},{Y[2 * k]:.3f}" if 2 * k < ROWS else ","
        return f"{T[k]:.3f},{U[k]:.3f},{slow}"

    record = read(tmp_path, text(row, "time,u,time,y\n"), time=time)

    assert 1.0 / record.dt_s == pytest.approx(0.5 * RATE_HZ)
    np.testing.assert_allclose(record.y[:, 0], Y[::2], atol=1e-9)


def test_channels_of_tektronix___are_named_by_the_words_beside_them(tmp_path: Path) -> None:
    content = text(
        lambda k: "".join(beside("Record Length", "300", number, k) for number in (0, 1)), ""
    )
    record = read(tmp_path, content, u="CH1", y="CH2")

    assert 1.0 / record.dt_s == pytest.approx(RATE_HZ)
    np.testing.assert_array_equal(record.u[:, 0], U)
    np.testing.assert_array_equal(record.y[:, 0], Y)


CELLS = {
    "floats of NumPy": text(lambda k: f"np.float64({T[k]}),np.float64({U[k]}),np.float64({Y[k]})"),
    "list of floats of NumPy": text(lambda k: f"[{T[k]}, np.float64({U[k]}), np.float64({Y[k]})]"),
    "tensors": text(lambda k: f"{T[k]},tensor({U[k]}),tensor([{Y[k]}])"),
    "lists of one": text(lambda k: f"{T[k]},[{U[k]}],[{Y[k]}]"),
    "bytes": text(lambda k: f"b'{plain(k)}\\r\\n'"),
    "rows of MATLAB": text(lambda k: f"{plain(k)};"),
    "braces": text(lambda k: f"{{{plain(k)}}},"),
    "long dash": text(plain).replace("-", "\u2013"),
    "minus behind": re.sub(r"-([\d.]+)", r"\1-", text(plain)),
    "French": text(lambda k: plain(k).replace(",", ";").replace(".", ","), "Temps (s);u;y\n"),
    "LeCroy": text(plain, "LECROY,1,Wave\nSegments,1,Size,300\n#1,1,0\nTime,u,y\n"),
}


@pytest.mark.parametrize("form", CELLS)
def test_cells___as_programs_print_them___are_their_numbers(tmp_path: Path, form: str) -> None:
    record = read(tmp_path, CELLS[form])

    assert 1.0 / record.dt_s == pytest.approx(RATE_HZ)
    np.testing.assert_array_equal(record.u[:, 0], U)
    np.testing.assert_array_equal(record.y[:, 0], Y)


def test_names_with_places___are_no_numbers(tmp_path: Path) -> None:
    record = read(tmp_path, text(plain, "t,u(1),y(1)\n"), u="u(1)", y="y(1)")

    np.testing.assert_array_equal(record.u[:, 0], U)


@pytest.mark.parametrize(
    "head",
    [
        "X,u,y,Start,Increment,\nSequence,Volt,Volt,-1.0e+00,5.000000e-03\n",
        "u,y,t0 = -1.0s, tInc = 0.005000,\n",
        "#Sample rate: 200Hz\n\nu,y\n",
        "Sample Interval,0.005,0.005\nu,y\n",
        "SampleTime[ms];5\n\nu,y\n",
    ],
)
def test_rate_in_the_head___is_in_the_remedy(tmp_path: Path, head: str) -> None:
    row = "{k},{u},{y},," if head.startswith("X") else "{u},{y}"
    content = text(lambda k: row.format(k=k, u=U[k], y=Y[k]), head)

    with pytest.raises(CsvImportError, match=r"no column is called a time.* --time 200Hz, as its"):
        read(tmp_path, content)


@pytest.mark.parametrize(
    ("column", "u"), [("X", "u"), ("sample", "u"), ("time", "torque"), ("time", "current_a")]
)
def test_counts_of_rows___in_the_place_of_a_motor_s_time___are_refused(
    tmp_path: Path, column: str, u: str
) -> None:
    content = text(lambda k: f"{k},{U[k]},{Y[k]}", f"{column},{u},y\n")

    with pytest.raises(CsvImportError, match=f"{column} counts the rows.* --time '{column}:s'"):
        read(tmp_path, content, u=u, time=column)
    assert read(tmp_path, content, u=u, time=f"{column}:s").dt_s == pytest.approx(1.0)


def test_spectrum___is_called_one(tmp_path: Path) -> None:
    content = text(lambda k: f"{k + 1},{U[k]},{Y[k]}", "Frequency (Hz),u,y\n")

    with pytest.raises(CsvImportError, match=r"Frequency \(Hz\) is a frequency and not a time"):
        read(tmp_path, content)


def test_cell_of_several_numbers___is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(CsvImportError, match="give each of its numbers a column"):
        read(tmp_path, text(lambda k: f'{T[k]},{U[k]},"[{Y[k]}, {Y[k]}]"'))


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("run.npy", b"\x93NUMPY\x01\0v\0{}", "is an array of NumPy"),
        ("run.npz", b"PK\x03\x04" + bytes(26) + b"u.npy\x93NUMPY", "has arrays of NumPy"),
        ("run.pkl", b"\x80\x04\x95" + bytes(50), "has pickled objects of Python"),
        ("run.wav", b"RIFF\x24\0\0\0WAVEfmt ", "is a recording of sound"),
        ("run.ulg", b"ULog\x01\x12\x35\x01" + bytes(50), "is a log of PX4"),
        ("run.rrd", b"RRF2" + bytes(50), "is a recording of Rerun"),
        ("run.arrow", b"ARROW1\0\0" + bytes(50), "is an Arrow or Feather file"),
        ("run.csv", b"BZh91AY&SY" + bytes(50), "is packed by bzip2"),
        ("run.csv", b"\xfd7zXZ\0" + bytes(50), "is packed by xz"),
        ("run.csv", b"\x28\xb5\x2f\xfd" + bytes(50), "is packed by Zstandard"),
    ],
)
def test_file___of_another_kind___is_called_so(
    tmp_path: Path, name: str, content: bytes, said: str
) -> None:
    file = tmp_path / name
    file.write_bytes(content)

    with pytest.raises(CsvImportError, match=said):
        read_csv(file, TableColumns(("u",), ("y",)))
