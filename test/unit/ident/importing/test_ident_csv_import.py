from __future__ import annotations

from hashlib import sha256
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

from flexarm_bags.writer import RecordingError
from flexarm_core.errors import SettingError
from flexarm_core.yaml_sections import SectionError
from flexarm_ident import identify
from flexarm_ident.importing.csv_cells import CsvImportError
from flexarm_ident.importing.csv_import import import_csv
from flexarm_ident.importing.csv_map import CsvChannel, CsvMap, load_csv_map
from flexarm_ident.reading.read import read_bag, stream_bag
from support.bag_samples import typestore
from support.exhaustive import wide
from support.hostile_texts import doubled
from support.project import PROJECT, SHARED

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

QUANSER_CSV = SHARED / "data" / "quanser_2dsfl_fsf.csv"
QUANSER_MAP = PROJECT / "src" / "flexarm_bringup" / "config" / "quanser_2dsfl.yaml"
ONE_IN_ONE_OUT = CsvMap(
    inputs=(CsvChannel("i", "current_a", "A"),),
    outputs=(CsvChannel("q", "angle_deg", "deg"),),
    time="t",
    closed_loop=True,
    description="test rig",
)


def csv_file(folder: Path, lines: Sequence[str]) -> Path:
    file = folder / "data.csv"
    file.write_text("\n".join(lines) + "\n")
    return file


def map_file(folder: Path, text: str) -> Path:
    file = folder / "map.yaml"
    file.write_text(text)
    return file


def test_import___column_with_a_dot___is_identified_under_a_name_with_an_underscore(
    tmp_path: Path,
) -> None:
    u, y = np.random.default_rng(1).standard_normal(400), np.zeros(400)
    for k in range(399):
        y[k + 1] = 0.8 * y[k] + u[k]
    rows = [f"{i!r},{q!r}" for i, q in zip(u.tolist(), y.tolist(), strict=True)]
    file = csv_file(tmp_path, ["Motor.I,Link.Angle", *rows])
    columns = CsvMap(
        (CsvChannel("Motor.I", "Motor.I"),), (CsvChannel("Link.Angle", "q.1"),), rate_hz=100.0
    )
    import_csv(file, columns, tmp_path / "bag", typestore=typestore())

    for source in (read_bag(tmp_path / "bag"), stream_bag(tmp_path / "bag")):
        model = identify([source], order=1, block_rows=5, method="orse").model
        assert (model.input_labels, model.output_labels) == (["Motor_I"], ["q_1"])
        np.testing.assert_allclose(model.A, 0.8, rtol=1e-6)


def test_import___small_file___writes_samples_names_and_source(tmp_path: Path) -> None:
    file = csv_file(tmp_path, ["t,unused,q,i", "5.0,x,10,1", "5.1,,11,2", "5.2,y,12,-3"])

    summary = import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())
    with AnyReader([tmp_path / "bag"]) as reader:
        found = [
            (connection.topic, time_ns, reader.deserialize(raw, connection.msgtype))
            for connection, time_ns, raw in reader.messages()
        ]

    digest = sha256(file.read_bytes()).hexdigest()
    assert (summary.samples, summary.rate_hz, summary.sha256) == (3, 10.0, digest)
    assert summary.duration_s == pytest.approx(0.2)
    (topic, time_ns, info), *samples = found
    assert (topic, time_ns) == ("/flexarm/io_channels", 0)
    assert vars(info) | {"header": None} == {
        "__msgtype__": "flexarm_msgs/msg/ChannelInfo",
        "header": None,
        "sampling_rate_hz": 10.0,
        "input_names": ["current_a"],
        "input_units": ["A"],
        "output_names": ["angle_deg"],
        "output_units": ["deg"],
        "source": f"test rig; data.csv sha256:{digest}",
        "closed_loop": True,
    }
    assert [(topic, time_ns) for topic, time_ns, _ in samples] == [
        ("/flexarm/io", 0),
        ("/flexarm/io", 100_000_000),
        ("/flexarm/io", 200_000_000),
    ]
    fields = [vars(sample) for *_, sample in samples]
    assert [entry["sequence"] for entry in fields] == [1, 2, 3]
    assert [entry["inputs"].tolist() for entry in fields] == [[1.0], [2.0], [-3.0]]
    assert [entry["outputs"].tolist() for entry in fields] == [[10.0], [11.0], [12.0]]
    assert [entry["header"].stamp.nanosec for entry in fields] == [0, 100_000_000, 200_000_000]


def test_import___rate_instead_of_time___uses_the_rate(tmp_path: Path) -> None:
    file = csv_file(tmp_path, ["i,q", "1,2", "3,4"])
    mapping = CsvMap(ONE_IN_ONE_OUT.inputs, ONE_IN_ONE_OUT.outputs, rate_hz=12.5)

    summary = import_csv(file, mapping, tmp_path / "bag", typestore=typestore())

    assert summary.rate_hz == pytest.approx(12.5)
    assert read_bag(tmp_path / "bag").dt_s == pytest.approx(0.08)


def test_import___column_names_with_commas___stand_between_tabs(tmp_path: Path) -> None:
    file = csv_file(tmp_path, ["time, s\tcurrent, A\tangle", "0\t1\t2", "1\t3\t4"])
    mapping = CsvMap((CsvChannel("current, A", "i"),), (CsvChannel("angle", "q"),), time="time, s")
    import_csv(file, mapping, tmp_path / "bag", typestore=typestore())
    assert read_bag(tmp_path / "bag").u.tolist() == [[1.0], [3.0]]


def test_import___byte_order_mark_and_empty_lines___are_no_problem(tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text("t, i ,q\r\n0,1,2\r\n\r\n1,3,4\r\n", encoding="utf-8-sig")

    summary = import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())

    assert summary.samples == 2
    assert read_bag(tmp_path / "bag").u.tolist() == [[1.0], [3.0]]


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        (["t,i,angle", "0,1,2", "1,1,2"], "no column q; there are: t, i, angle"),
        (["t,i,q,q", "0,1,2,3", "1,1,2,3"], "more than one column q"),
        (["t,i,q", "0,1,2", "1,1,oops"], ", line 3, column q: 'oops' is not a number: correct it"),
        (["t,i,q", "0,1,2", "1,,2"], ", line 3, column i: empty cell; an input must be known"),
        (["t,i,q", "0,1,2", ",1,2"], ", line 3, column t: empty cell; a row needs its time: fill"),
        (
            ["t,i,q", "0,nan,2", "1,2,3"],
            ", line 2, column i: nan is not a number; an input must be",
        ),
        (["t,i,q", "0,1,2", "1,2,-inf"], ", line 3, column q: -inf is not finite; empty the cell"),
        (
            ["t,i,q", '0,1,"2', "1,2,3"],
            "column q: '2\\n1,2,3' is not a number: close its quotation",
        ),
        (["t,i,q", "0,1,", "1,2,NA"], "column q has no number: leave it out"),
        (["time,i,p", "0,1,2"], "no columns t, q; there are: time, i, p"),
        (["t,i,q,q", "0,1,2,2"], "more than one column q; there are: t, i, q#1, q#2"),
        (["0,1.5,2", "1,2,3"], "numbers alone: put a line with the names of the col"),
        (["t,i,q", "0,1,2"], "data rows: 1; at least 2 are needed"),
        (["t,i,q"], "data rows: 0"),
        ([], "the first line is empty: it has the names of the columns"),
        (
            ["t,i,q", "0,1,1", "1,1,1", "2,1,1", "3.5,1,1", "4.5,1,1"],
            ", line 5: column t has an irregular step, 1.5",
        ),
        (
            ["t,i,q", "", "0,1,1", "1,1,1", "2,1,1", "4.5,1,1"],
            ", line 6: column t has an irregular step, 2.5 s, usually 1 s: resample",
        ),
        (
            ["t,i,q", "0,1,1", "1,1,1", "2,1,1", "1e9,1,1"],
            ", line 5: column t jumps by 1e+09 s, and more rows are missing in all than there are",
        ),
        (["t,i,q", "0,1,1", "0,1,1", "0,1,1"], ", line 3: column t does not increase: sort"),
        (["t,i,q", "2,1,1", "1,1,1", "0,1,1"], ", line 3: column t does not increase: sort"),
        (
            ["t,i,q", "0,1,1", "1e9,1,1", "2e9,1,1", "3e9,1,1"],
            "a rate of 1e-09 Hz is outside 0.001 to 1e+06 Hz: times are in seconds",
        ),
        (
            ["t,i,q", "0,1,1", "1e-12,1,1", "2e-12,1,1"],
            "a rate of 1e+12 Hz is outside 0.001 to 1e+06 Hz",
        ),
        (["t,i,q", "0,1," + "2" * 2**20, "1,3,4"], "a line has 1048576 characters or more"),
        (["t,i,q", "0,1," + "x" * 100_000, "1,3,4"], "line 2, column q: 'xxx"),
        (
            [",".join(f"c{k}" for k in range(100_000)), "0"],
            "no columns t, i, q; there are: c0, c1, c2",
        ),
    ],
)
def test_import___bad_file___names_the_place(
    tmp_path: Path, lines: list[str], complaint: str
) -> None:
    file = csv_file(tmp_path, lines)

    with pytest.raises(CsvImportError) as caught:
        import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())

    assert str(caught.value).startswith((f"{file}: ", f"{file}, line "))
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "bag").exists()


def test_import___missing_file___says_so(tmp_path: Path) -> None:
    with pytest.raises(
        CsvImportError, match=r"none\.csv: cannot be read as CSV: No such file or directory$"
    ):
        import_csv(tmp_path / "none.csv", ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (bytes(range(256)), "is a binary file and no text: export it as CSV"),
        (
            "t,i,\u03b2\u00b0\n".encode("cp1253"),
            "no column q; .* not in UTF-8: .*: t, i, ",
        ),
        (b"PK\x03\x04" + bytes(99), "is an Excel or OpenDocument workbook or zip file: save its"),
        (b"PAR1" + bytes(99), "is a Parquet file: write it as CSV"),
        (b"\x89HDF\r\n\x1a\n" + bytes(99), "is an HDF5 or MATLAB 7.3 file: write its arrays by"),
        (
            b"MATLAB 5.0 MAT-file",
            "is a MATLAB file: write its signals as CSV by MATLAB's writetable",
        ),
        (b"TDSm" + bytes(9), "is a LabVIEW TDMS file: export it as text"),
    ],
)
def test_import___file_of_another_kind___says_what_it_is(
    tmp_path: Path, content: bytes, said: str
) -> None:
    file = tmp_path / "data.csv"
    file.write_bytes(content)

    with pytest.raises(CsvImportError, match=rf"data\.csv: {said}"):
        import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())


def test_import___existing_bag___is_not_overwritten(tmp_path: Path) -> None:
    file = csv_file(tmp_path, ["t,i,q", "0,1,2", "1,3,4"])
    (tmp_path / "bag").mkdir()

    with pytest.raises(RecordingError, match="is not overwritten"):
        import_csv(file, ONE_IN_ONE_OUT, tmp_path / "bag", typestore=typestore())


@settings(max_examples=wide(12, 25), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    values=st.lists(
        st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 2), min_size=2, max_size=20
    ),
    rate_hz=st.integers(1, 2000),
)
@pytest.mark.slow
def test_import___any_numbers___come_back_exactly(
    tmp_path_factory: pytest.TempPathFactory,
    values: list[tuple[float, float]],
    rate_hz: int,
) -> None:
    folder = tmp_path_factory.mktemp("import")
    rows = [f"{k / rate_hz!r},{i!r},{q!r}" for k, (i, q) in enumerate(values)]
    file = csv_file(folder, ["t,i,q", *rows])

    import_csv(file, ONE_IN_ONE_OUT, folder / "bag", typestore=typestore())
    data = read_bag(folder / "bag")

    assert data.u[:, 0].tolist() == [i for i, _ in values]
    assert data.y[:, 0].tolist() == [q for _, q in values]
    assert data.dt_s == 1 / rate_hz


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[1, 2]", "1: the file must be a mapping"),
        ("# nothing", "1: is empty: name inputs, outputs, and time or rate_hz"),
        ("time: [", "2: no YAML"),
        ("inputs: []", "1: give time (a column), rate_hz, or both to resample"),
        ("time: 3\ninputs: [{column: i}]\noutputs: [{column: q}]", "1: time = 3 must be a text"),
        ("rate_hz: 0\ninputs: [{column: i}]\noutputs: [{column: q}]", "= 0 must lie from 0.001 to"),
        (
            "inputs: [{column: i}]\noutputs: [{column: q}]\nrate_hz: yes",
            "3: rate_hz = True must be",
        ),
        (
            "rate_hz: 1.0e-9\ninputs: [{column: i}]\noutputs: [{column: q}]",
            "1: rate_hz = 1e-09 must lie from 0.001 to 1e+06",
        ),
        ("rate_hz: .nan\ninputs: [{column: i}]\noutputs: [{column: q}]", "must be a finite number"),
        (
            "time: t\ninputs: [{column: i}]\noutputs: [{column: i, name: q}]",
            "1: column i is named twice: it is one of time, input and output",
        ),
        (
            "time: t\ninputs: [{column: t}]\noutputs: [{column: q}]",
            "1: column t is named twice",
        ),
        (
            f"rate_hz: {doubled(10)}\ninputs: [{{column: i}}]\noutputs: [{{column: q}}]",
            "1: rate_hz = [['x', 'x'], [[...",
        ),
        ("rate_hz: " + "9" * 5000, "a number has 5000 characters"),
        ("rate_hz: " + "[" * 5000, "is nested deeper than 64 levels"),
        ("time: t\noutputs: [{column: q}]", "inputs is missing"),
        (
            "time: t\ninputs: [{column: i}]\noutputs: q",
            "3: outputs must be a list of mappings, at least one",
        ),
        ("time: t\ninputs: [i]\noutputs: [{column: q}]", "2: inputs[0] must be a mapping"),
        (
            "time: t\ninputs:\n- column: i\n  Unit: A",
            "4: inputs[0].Unit is not known",
        ),
        ("time: t\ninput: [{column: i}]", "inputs is missing (nearest: input"),
        (
            "time: t\nx: 1\ninputs: [{column: i}]\noutputs: [{column: q}]",
            "2: x is not known",
        ),
        (
            "time: t\ninputs: [{column: i, name: a}, {column: j, name: a}]\noutputs: []",
            "2: inputs: a is named twice: give each channel a name of its own",
        ),
        (
            "time: t\nclosed_loop: maybe\ninputs: [{column: i}]\noutputs: [{column: q}]",
            "2: closed_loop = 'maybe' must be true or false",
        ),
        (
            "rate_hz: 5\ntime_unit: us\ninputs: [{column: i}]\noutputs: [{column: q}]",
            "2: time_unit is that of a column: give time, too",
        ),
    ],
)
def test_map___bad_file___names_file_and_key(tmp_path: Path, text: str, complaint: str) -> None:
    file = map_file(tmp_path, text)

    with pytest.raises(SectionError) as caught:
        load_csv_map(file)

    assert str(caught.value).startswith(f"{file}:")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_map___missing_file___says_so(tmp_path: Path) -> None:
    with pytest.raises(
        SettingError, match=r"none\.yaml: cannot be read: No such file or directory$"
    ):
        load_csv_map(tmp_path / "none.yaml")


def test_map___name_and_unit_left_out___take_the_column_and_none(tmp_path: Path) -> None:
    file = map_file(tmp_path, "rate_hz: 5\ninputs: [{column: i}]\noutputs: [{column: q}]")

    assert load_csv_map(file) == CsvMap(
        inputs=(CsvChannel("i", "i"),), outputs=(CsvChannel("q", "q"),), rate_hz=5.0
    )


@pytest.mark.skipif(not QUANSER_CSV.exists(), reason="the Quanser measurements are not here")
def test_import___quanser_measurements___are_a_500_hz_closed_loop_record(tmp_path: Path) -> None:
    table = np.genfromtxt(QUANSER_CSV, delimiter=",", names=True)

    summary = import_csv(
        QUANSER_CSV, load_csv_map(QUANSER_MAP), tmp_path / "bag", typestore=typestore()
    )
    data = read_bag(tmp_path / "bag")

    assert (summary.samples, summary.rate_hz) == (len(table), 500.0)
    assert (data.dt_s, data.closed_loop) == (0.002, True)
    assert summary.sha256 in data.source
    assert data.inputs == ("current1_a", "current2_a")
    assert data.outputs == ("hub1_deg", "deflection1_deg", "hub2_deg", "deflection2_deg")
    np.testing.assert_array_equal(data.u[:, 1], table["current2_meas_a"])
    for column, name in enumerate(data.outputs):
        np.testing.assert_array_equal(data.y[:, column], table[name])
