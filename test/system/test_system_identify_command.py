from __future__ import annotations

import signal
from dataclasses import fields
from shutil import copytree
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from flexarm_bringup.verbs.offline.identify import identify, report
from flexarm_ident.models.files import load_model
from flexarm_ident.workflow.request import Request
from support.project import BAGS
from support.system_graph import ROOT, eventually

if TYPE_CHECKING:
    from pathlib import Path

    from support.system_graph import Graph, Process

pytestmark = pytest.mark.system

BAG = BAGS / "c_dat3_0g"
OF_CHANNELS = ("inputs", "outputs", "clock", "held", "from_s", "to_s", "times", "wrap")
OF_SEVERAL = ("each", "jobs", "dask", "parquet")


def command(graph: Graph, *arguments: str) -> Process:
    return graph.run([str(ROOT / "flexarm"), "identify", str(BAG), *arguments])


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_command___has_an_option_for_every_field_of_a_request() -> None:
    options = {option.name for option in identify.params}
    of_files = {
        "bags",
        "out",
        "map_file",
        "export",
        "force",
        "output_only",
        *OF_CHANNELS,
        *OF_SEVERAL,
    }
    assert {field.name for field in fields(Request)} == options - of_files
    defaults = {option.name: option.default for option in identify.params}
    for field in fields(Request):
        # What is not given has no default of its own, or an empty one.
        if isinstance(defaults[field.name], (str, int, float)):
            assert defaults[field.name] == field.default


def test_report_command___has_the_options_of_identify() -> None:
    of_identify, of_report = (
        {option.name for option in verb.params} for verb in (identify, report)
    )
    assert of_identify - of_report == {"export", "output_only", *OF_SEVERAL}
    assert of_report - of_identify == {"opens"}


def test_report_command___reduces_and_leaves_one_file(graph: Graph, tmp_path: Path) -> None:
    out = tmp_path / "new" / "arm.html"
    reduced = ("--reduction", "mrm", "--reduced-order", "8", "--update", "b")
    arguments = ("--order", "14", "--block-rows", "20", *reduced, "-o", str(out))
    process = graph.run([str(ROOT / "flexarm"), "report", str(BAG), *arguments])
    assert process.exit_code() == 0, process.printed
    assert process.printed.splitlines()[-1] == f"report in {out}"
    assert names_in(out.parent) == {"arm.html"}
    text = out.read_text("utf-8")
    assert "The model has 8 states, reduced from 14." in text
    assert "largest modal response (MRM); B was refitted" in text


def test_report_command___no_bag___ends_with_one_line(graph: Graph, tmp_path: Path) -> None:
    out = tmp_path / "arm.html"
    process = graph.run([str(ROOT / "flexarm"), "report", str(tmp_path / "none"), "-o", str(out)])
    assert process.exit_code() == 1
    assert process.printed.splitlines()[-1] == f"flexarm: {tmp_path / 'none'}: no such bag"
    assert not out.exists()


def test_command___with_exports___shows_stages_and_writes_the_files(
    graph: Graph, tmp_path: Path
) -> None:
    out = tmp_path / "new" / "out"
    process = command(
        graph,
        *("--order", "8", "--block-rows", "20", "--reduction", "mrm", "--reduced-order", "6"),
        *("--update", "b", "--export", "json,mat,h", "-o", str(out)),
    )
    assert process.exit_code() == 0, process.printed
    stages = ["reading", "Hankel matrices", "reduction", "validation", "writing"]
    places = [process.printed.index(f"  {stage}\n") for stage in stages]
    assert places == sorted(places)
    models = ["model.yaml", "model.json", "model.mat", "model.h"]
    assert names_in(out) == {*models, "report.html"}
    assert [load_model(out / name).nstates for name in models[:3]] == [6, 6, 6]


def test_command___interrupted___leaves_no_folder(graph: Graph, tmp_path: Path) -> None:
    (tmp_path / "place").mkdir()
    # Six records keep it at work for longer than a busy machine keeps this test from looking.
    others = [copytree(BAG, tmp_path / f"run{number}") for number in range(5)]
    process = command(graph, *map(str, others), "-o", str(tmp_path / "place" / "out"))
    eventually(lambda: "Hankel matrices" in process.printed, "the work")
    process.send(signal.SIGINT)
    assert process.exit_code() == 130
    assert process.printed.splitlines()[-1] == "flexarm: interrupted"
    assert names_in(tmp_path / "place") == set()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--export", "json,slx"), "no format 'slx' to export: choose from json, mat, h"),
        (("--method", "guess"), "method must be one of auto, orse"),
    ],
)
def test_command___that_makes_no_sense___ends_with_one_line(
    tmp_path: Path, arguments: tuple[str, ...], complaint: str
) -> None:
    words = ["identify", str(BAG), *arguments, "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 1
    last = done.output.splitlines()[-1]
    assert last.startswith("flexarm: ")
    assert complaint in last
    assert not (tmp_path / "out").exists()
