"""Wrong inputs on the command line: one line each, with what was wrong and the way out."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from flexarm_core.errors import FlexarmError
from support.project import BAGS

if TYPE_CHECKING:
    from pathlib import Path

BAG = BAGS / "c_dat3_0g"
FILES = {
    "text.txt": "hello",
    "semi.csv": "t;u;y\n0;1;2\n1;2;3,5\n2;2;4.5\n",
    "bare.csv": "0.0,1,2\n0.1,2,3\n",
    "two.csv": "t,u,y\n0,1,2\n1,2,3\n",
    "sheet.xlsx": "PK",
    "latin.yaml": "\u00e9",
    "short.csv": "t,u,y\n" + "".join(f"{k},{k % 3},{k % 5}\n" for k in range(12)),
    "space.dat": "t u y\n0 1 2\n",
    "notes.md": "hello",
    "comma.csv": "t,u,y\n0,1,2\n",
    "broken.yaml": "law: [",
    "maps.yaml": "time: t\ninputs: [{column: u}]\noutputs: [{column: y}]",
    "folder/other.txt": "",
    "nothing/metadata.yaml": "",
    "empty.mcap": "",
    "model/model.yaml": "",
}
# Command line, and words of its answer: what is wrong, and what to do instead.
WRONG = {
    "demmo": ("'demmo'", "Did you mean demo?"),
    "identify": ("Missing argument 'BAGS...'",),
    "identify nowhere": ("nowhere: no such bag",),
    "identify notes.md": ("notes.md: no bag", "expected a rosbag2 folder or a .mcap or .db3 file"),
    "identify text.txt": ("text.txt: the first line names one column, 'hello'", "with commas"),
    "identify folder": ("folder: no bag: the folder has no metadata.yaml",),
    "identify semi.csv --input u --output y": (
        "semi.csv, line 4, column y: '4.5', and the file has commas and points",
        "write all with one of them",
    ),
    "identify bare.csv --input u --output y": (
        "bare.csv: no column is called a time",
        "it has numbers alone: put a line with the names of the columns above it",
    ),
    "identify bare.csv": ("bare.csv is a CSV file", "columns: column_1, column_2, column_3"),
    "identify comma.csv --input v --output z": ("no columns v, z; there are: t, u, y",),
    "identify space.dat": ("space.dat: the first line names one column, 't u y'",),
    "identify comma.csv": ("comma.csv is a CSV file", "--map FILE", "columns: t, u, y"),
    "identify comma.csv --input u": ("needs --input COLUMN and --output COLUMN",),
    "identify comma.csv --input u --output z": ("no column z; there are: t, u, y",),
    "identify short.csv --input u --output y": ("flexarm: short.csv: 12 samples are too few",),
    "identify gone.csv --map maps.yaml": ("gone.csv: cannot be read as CSV: No such file",),
    "identify short.csv short.csv --input u --output y": ("short.csv is named twice", "once"),
    "identify two.csv --input u --output y": ("flexarm: two.csv: 2 samples are too few",),
    "identify two.csv --input u --output ''": ("no column ''; there are: t, u, y",),
    "identify sheet.xlsx --input u --output y": ("sheet.xlsx is a spreadsheet: save it as CSV",),
    "identify two.csv --map latin.yaml": ("latin.yaml: cannot be read: it is not text in UTF-8",),
    "identify loop": ("loop: no such bag",),
    "identify nothing": (
        "nothing: metadata.yaml: cannot be read: it has no rosbag2_bagfile_information",
    ),
    "identify empty.mcap": ("seems to be empty; ", "try `flexarm bag repair empty.mcap -o NEW`"),
    "identify model": ("model is a model: name the bag or the CSV file of a record",),
    "identify model/model.yaml": ("model.yaml is a model: name the bag or the CSV file",),
    "tune model": ("model: is the folder of a model: name model/model.yaml",),
    "identify BAG OTHER": ("inputs current1_a, current2_a differ from command_v of",),
    "identify OTHER --input drive --output y": (
        "'drive' is not a TOPIC.FIELD",
        " (flexarm_msgs/msg/IoSample): ",
        "without --input and --output it is read as current1_a, current2_a -> ",
    ),
    "identify BAG BAG": ("is named twice, and would count twice: name it once",),
    "report short.csv --map maps.yaml": ("flexarm: short.csv: 12 samples are too few",),
    "identify BAG --order 0": ("'--order': 0", "range x>=1"),
    "identify BAG --order 5000": ("order must lie between 1 and 998", "lower the order"),
    "identify BAG --method magic": ("'magic'", "one of auto, orse"),
    "identify BAG --reduce-to 3": ("No such option '--reduce-to'", "'--reduced-order'"),
    "identify BAG --input nope.data": ("no output was named", "a record needs"),
    "identify BAG --input u --output y": ("'u' is not a TOPIC.FIELD", "such as"),
    "identify BAG --train-fraction 2": ("2.0 is not in the range 0.0<x<=1.0",),
    "identify BAG -o /proc/x": ("/proc/x/model.yaml: cannot be written",),
    "report model": ("model is a model: name a bag beside it, to try it on",),
    "report nowhere": ("nowhere: no such bag",),
    "import nowhere.csv out": ("'nowhere.csv' does not exist",),
    "bag check nowhere": ("nowhere: no such bag",),
    "bag repair folder": ("Missing option '-o' / '--output'",),
    "tune nowhere.yaml": ("nowhere.yaml: no such file", "a bag, or nominal:KG"),
    "tune broken.yaml": ("broken.yaml: no YAML",),
    "tune --law magic nominal:0": ("'magic'", "one of 'pdp', 'pi'"),
    "learn": ("Missing option '--reference'",),
    "learn --reference nowhere.csv": ("nowhere.csv: cannot be read: No such file",),
    "learn --reference semi.csv": ("semi.csv: no column time_s", "with commas between them"),
    "learn --reference semi.csv --law pd": ("'pd' is not one of 'planned', 'pdpc'",),
    "experiment": ("Missing argument 'NAMES...'",),
    "experiment C_dat3 -o /proc/x": ("/proc/x: cannot be written in /proc", "folder with -o"),
    "experiment C_dat3 -o /dev/full": (
        "/dev/full: cannot be written: it is not a folder",
        "with -o",
    ),
    "experiment C_dat3 --params-file broken.yaml -o out": ("broken.yaml: no YAML: line ",),
    "experiment C_dat3 --params-file maps.yaml -o out": (
        "maps.yaml: has parameters of no node",
        "/**/daq: {ros__parameters: {rate_hz: 300.0}}",
    ),
    "up --bag /proc/foo": ("/proc: cannot be written: ", "name another folder with --bag"),
    "experiment NOPE": ("no experiment 'NOPE'", "C_dat1 to C_dat14"),
    "experiment C_dat3 --payload -5": ("-5 kg is not in the range 0 to 1 kg",),
    "experiment C_dat3 --payload 200lb": ("'200lb' has a unit", "use kg, g"),
    "experiment C_dat3 --payload heavy": ("'heavy' is not a number", "write one in kg"),
    "up --rate 0": ("0 Hz is not in the range 10 to 2000 Hz",),
    "reference": ("Missing argument 'SET_POINT'",),
    "set payload_kg=0.2": ("the node of payload_kg=0.2 is missing", "flexarm set daq"),
    "set daq": ("what to set of daq is missing", "flexarm set daq payload_kg=0.2"),
    "set daq payload_kg": ("'payload_kg': write NAME=VALUE",),
    "activate ''": ("'' has no lifecycle", "daq, controller, experiment have one"),
    "activate recorder": ("recorder has no lifecycle", "daq, controller, experiment have one"),
    "run no_package x": ("no package no_package",),
    "replay nowhere": ("nowhere: no such bag",),
    "design --law nope": ("'nope'", "one of 'ilqr', 'lqg', 'pdp'"),
    "demo --seed x": ("'x' is not a valid integer",),
    "completion tcsh": ("'tcsh' is not one of 'bash', 'zsh', 'fish'",),
}


@pytest.mark.parametrize("line", WRONG)
def test_wrong_input___is_reported_in_one_line(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="latin-1")
    (tmp_path / "loop").symlink_to("loop")
    bags = {"BAG": str(BAG), "OTHER": str(BAGS / "quanser_2dsfl")}
    arguments = [bags.get(each, each) for each in shlex.split(line)]
    done = CliRunner().invoke(main, arguments, prog_name="flexarm")
    assert done.exit_code in {1, 2}
    if isinstance(done.exception, FlexarmError):
        reported = [f"flexarm: {done.exception}"]  # the command prints it so
    else:
        reported = [
            text for text in done.output.splitlines() if text.startswith(("Error: ", "flex"))
        ]
    assert len(reported) == 1
    assert "\n" not in reported[0]
    assert [words for words in WRONG[line] if words not in reported[0]] == []
