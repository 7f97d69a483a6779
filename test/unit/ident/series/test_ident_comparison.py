from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_core.outputs import OutputError
from flexarm_ident.models.files import save_model
from flexarm_ident.models.model_parameters import ModelFileError
from flexarm_ident.series import comparison
from flexarm_ident.series.comparison import Compared, compare_files, comparison_page
from flexarm_ident.workflow.request import Request
from support.html_page import Page
from support.ident_systems import arm_model, random_model, record

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ("position_v", "base_strain_v", "middle_strain_v", "speed_v")


def on_a_record() -> Compared:
    """Return the arm's model with an own record that it simulates without an error."""
    model = arm_model()
    data = record(model, 600, 1)
    model.input_labels, model.output_labels = list(data.inputs), list(data.outputs)
    return Compared("ours", model, None, "good", data)


def cells(text: str, table: str) -> list[list[str]]:
    part = text.split(f'class="{table}"')[1].split("</tbody>", maxsplit=1)[0]
    rows = part.split("<tbody>")[1].split("</tr>")[:-1]
    return [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row) for row in rows]


def test_comparison_page___exact_halved_and_foreign_model___shows_their_fits() -> None:
    ours = on_a_record()
    halved = ours.model.copy()
    halved.C = 0.5 * halved.C
    half = replace(ours, name="half", model=halved, verdict="", record=None)
    foreign = Compared("foreign", random_model(1), None)
    _, text = comparison_page([ours, half, foreign])
    shown = {row[0]: row[1] for row in cells(text, "trials")}
    assert shown["foreign"] == "-"
    fits = {name: float(shown[name].removesuffix(" %")) for name in ("ours", "half")}
    assert fits["ours"] == pytest.approx(100.0, abs=0.1)
    # Half of the output is missing; the initial state, which is fitted, makes up for some of it.
    assert 49.0 < fits["half"] < 90.0
    first, *_ = (row for row in cells(text, "compared") if row[1] != "-")
    # Halved outputs have the same modes.
    assert first[1] == first[2]
    words = " ".join(Page(text).text.split())
    assert "3 models on 1 record. On ours, ours has the highest fit" in words
    assert "and half the lowest" in words
    assert "2 models of the same channels as ours." in words
    labels = [attributes["aria-label"] for _, attributes in Page(text).tags if "role" in attributes]
    assert "frequency response from command to position" in labels


def test_compare_files___two_model_files___are_one_page(tmp_path: Path) -> None:
    paths = []
    for name in ("before", "after"):
        (tmp_path / name).mkdir()
        file = tmp_path / name / "model.yaml"
        save_model(file, random_model(3), name="arm", provenance={"source": "a bag"})
        paths.append(tmp_path / name)
    lines = compare_files(paths, tmp_path / "out.html", Request())
    assert lines == ["2 models on no record: name a bag to try them on."]
    text = (tmp_path / "out.html").read_text("utf-8")
    assert [row[0] for row in cells(text, "models")] == ["before", "after"]
    rows = cells(text, "compared")
    assert all(row[1] == row[2] for row in rows)
    found_hz = [float(row[1].split()[0]) for row in rows]
    assert found_hz == sorted(found_hz)
    damping = [float(row[1].split("(")[1].rstrip(")")) for row in rows]
    assert np.all(np.array(damping) < 0.5)


def test_compare_files___place_of_somebody_else___is_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(comparison, "run", lambda *_, **__: pytest.fail("worked"))
    (tmp_path / "mine.html").write_text("mine")
    with pytest.raises(OutputError, match=r"mine\.html"):
        compare_files([tmp_path / "a", tmp_path / "b"], tmp_path / "mine.html", Request())


def test_compare_files___damaged_model___names_the_file(tmp_path: Path) -> None:
    (tmp_path / "model.yaml").write_text("nothing: of a model")
    with pytest.raises(ModelFileError, match=r"model\.yaml"):
        compare_files([tmp_path, tmp_path], tmp_path / "out.html", Request())
