from __future__ import annotations

import base64
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident import IoData
from flexarm_ident.models.files import load_model
from flexarm_ident.models.model_parameters import model_parameters
from flexarm_ident.provenance import model_provenance, record_hash
from flexarm_ident.report import sections as registry
from flexarm_ident.report.content.blocks import Subject
from flexarm_ident.report.page import render_report
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.html_page import Page
from support.ident_systems import DT_S, arm_model, random_model, record, square_wave
from support.renamed_outcome import renamed

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.workflow.outcome import Outcome
KNOWN_HZ = (9.4, 24.1, 45.6)
HOSTILE = '<script>alert("1")</script> & </main> $x_1$'


def closed_loop(source: str = "arm_bag", samples: int = 3000) -> IoData:
    """Return a record in which a PD law follows a square wave."""
    model, reference = arm_model(), square_wave(samples, 3, (150, 300))[:, 0]
    x, u, y = np.zeros(model.nstates), np.empty((samples, 1)), np.empty((samples, 4))
    noise = 0.002 * np.random.default_rng(4).normal(size=(samples, 4))
    for k in range(samples):
        y[k] = model.C @ x + noise[k]
        u[k] = 0.4 * (reference[k] - y[k, 0]) - 0.8 * y[k, 3]
        x = model.A @ x + model.B @ u[k]
    return IoData(u, y, dt_s=DT_S, reference=reference, closed_loop=True, source=source)


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    request = Request(
        method="orse",
        order=14,
        block_rows=20,
        reduction="mrmc",
        reduced_order=9,
        known_modes_hz=KNOWN_HZ,
        update="b",
    )
    return run(closed_loop(), request)


@pytest.fixture(scope="module")
def text(outcome: Outcome) -> str:
    return rendered(outcome)


def subject_of(outcome: Outcome, files: Sequence[str] = ()) -> Subject:
    provenance = model_provenance(outcome, outcome.records)
    parameters = model_parameters("arm", outcome.model, provenance=provenance)
    return Subject(outcome, "arm", parameters, files)


def rendered(outcome: Outcome, title: str = "An arm", files: Sequence[str] = ()) -> str:
    return render_report(subject_of(outcome, files), title=title)


@pytest.fixture(scope="module")
def many_channels() -> Outcome:
    model = random_model(3, states=5, outputs=3, inputs=2)
    records = [record(model, 600, seed, noise=0.01, source=f"bag {seed}") for seed in range(4)]
    return run(records, Request(method="orse", order=5, block_rows=8))


@pytest.fixture(scope="module")
def small() -> Outcome:
    data = record(random_model(2, states=5, outputs=1), 600, 1, noise=0.01)
    request = Request(method="orse", order=5, block_rows=8, reduction="mrm", reduced_order=5)
    return run(data, request)


@pytest.fixture(scope="module")
def small_text(small: Outcome) -> str:
    return rendered(small)


@pytest.mark.slow
def test_render_report___outcome___is_one_file_that_loads_nothing(text: str) -> None:
    page = Page(text)
    assert text.startswith("<!DOCTYPE html>")
    assert {"img", "iframe", "object"}.isdisjoint(tag for tag, _ in page.tags)
    for tag, attributes in page.tags:
        for name, value in attributes.items():
            assert not name.startswith("on"), tag
            if name in ("src", "href", "xlink:href"):
                inside = ("#", "data:") if tag in ("a", "link") else ("#",)
                assert (value or "").startswith(inside), tag
    assert re.findall(r"url\((?!#)", text) == []
    assert "@import" not in text
    addresses = re.findall(r"(\S*?)https?://", text)
    assert {address.split("=")[0] for address in addresses} <= {"xmlns", "xmlns:xlink"}


def test_render_report___outcome___begins_with_a_card(outcome: Outcome, text: str) -> None:
    card = text.split('<div class="card ')[1].split("<section", maxsplit=1)[0]
    assert card.startswith(f'{outcome.verdict.level}">')
    words = " ".join(unescape(re.sub("<[^>]*>", " ", card)).split())
    assert f"The model is {outcome.verdict.level}" in words
    assert f"{100.0 * (1.0 - outcome.verdict.error):.1f} %" in words
    assert outcome.verdict.next_step[1:] in words
    assert "flexible arm" in words
    assert "9 states" in words


def test_render_report___outcome___is_small(text: str) -> None:
    assert len(text.encode()) < 0.8e6


@pytest.mark.slow
def test_render_report___twice___is_the_same_text(small: Outcome, small_text: str) -> None:
    assert rendered(small) == small_text


def test_render_report___outcome___has_no_name_twice(text: str) -> None:
    names = [attributes["id"] for _, attributes in Page(text).tags if "id" in attributes]
    used = re.findall(r'(?:url\(|href=")#([^")]+)', text)
    assert len(set(names)) == len(names)
    assert set(used) == set(names)


def test_render_report___outcome___has_a_plot_per_output_and_kind(
    outcome: Outcome, text: str
) -> None:
    # The card's, an input, two each for order and poles, one for the reduction; one for each mode
    # that oscillates; for each output its poles and zeros, one gain, a step response, two
    # correlations, and twice the whole record with a part of it.
    shapes = sum(mode.kept and mode.is_pair for mode in outcome.modes)
    assert shapes > 0
    assert views_of(text) == 1 + 1 + 2 + shapes + 2 + 1 + 4 * (1 + 1 + 1 + 2 + 2 * 2)
    galleries = ["Residuals", "Simulation", "Closed-loop simulation", "Frequency response"]
    for words in (*galleries, "Mode shapes", "Poles", "Step response"):
        assert f"<h2>{words}</h2>" in text


def test_render_report___outcome___lists_every_mode(outcome: Outcome, text: str) -> None:
    table = text.split("<h2>Modes</h2>")[1].split("</table>", maxsplit=1)[0]
    rows = re.findall(r'<tr( class="marked")?><th scope="row">(.*?)</th>(.*)</tr>', table)
    assert len(rows) == len(outcome.modes)
    for mode, (marked, label, cells) in zip(outcome.modes, rows, strict=True):
        frequency, damping, msv, mrm, kept = re.findall("<td>(.*?)</td>", cells)
        assert label == mode.label
        # Nothing says that the errors are noise, so that a scatter would not be all of the error.
        assert "\u00b1" not in frequency + damping
        if mode.frequency_hz:
            assert float(frequency) == pytest.approx(mode.frequency_hz, abs=1e-3)
        assert float(damping) == pytest.approx(mode.damping_ratio, abs=1e-3)
        assert msv.endswith(f" ({mode.msv_rank})")
        assert mrm.endswith(f" ({mode.mrm_rank})")
        assert (kept == "yes") == bool(marked) == mode.kept


def test_render_report___outcome___lists_every_error(outcome: Outcome, text: str) -> None:
    assert outcome.sfv is not None
    table = text.split("<h2>Fit and errors</h2>")[1].split("</table>", maxsplit=1)[0]
    rows = [re.findall("<td>(.*?)</td>", row) for row in table.split("</tr>")][1:-1]
    found = np.array(rows, dtype=float)
    measured = outcome.records[0].y
    assert outcome.cross_validation is not None
    deltas = [
        np.sqrt(((measured - simulated) ** 2).mean(axis=0) / measured.var(axis=0))
        for simulated in (outcome.full_dmv[0].y, outcome.dmv[0].y, outcome.sfv.y)
    ]
    deltas.insert(1, outcome.cross_validation.error)
    columns = [[*delta, delta.mean()] for delta in deltas]
    np.testing.assert_allclose(found[:, 1:], np.transpose(columns), atol=5.1e-5)
    missed = ((measured - outcome.dmv[0].y) ** 2).sum(axis=0)
    fit = 100.0 * (1.0 - np.sqrt(missed / (len(measured) * measured.var(axis=0))))
    np.testing.assert_allclose(found[:, 0], [*fit, fit.mean()], atol=0.051)


def test_render_report___outcome___says_data_order_and_origin(outcome: Outcome, text: str) -> None:
    words = " ".join(Page(text).text.split())
    assert f"The model has {outcome.model.nstates} states, reduced from 14." in words
    assert "It is estimated from 1 record, 10.0 s in total." in words
    assert "The full model has order 14, as asked for." in words
    table = text.split("<h2>Data</h2>")[1].split("</table>", maxsplit=1)[0]
    cells = re.findall(r"<td>(.*?)</td>", table)
    assert cells[:5] == ["3000", "300", "10.0", "10.0", "closed"]
    assert "base strain" in words
    assert record_hash(outcome.records[0]) in words
    for asked in ("block_rows 20, order 14,", "reduction mrmc, reduced_order 9"):
        assert asked in words
    assert "kp = 0.400, kd = 0.800, ksg = 0.000" in words
    for warning in outcome.warnings:
        assert warning.removeprefix("information: ") in words


@pytest.mark.slow
def test_render_report___hostile_names___are_text(outcome: Outcome) -> None:
    outputs = (HOSTILE, "base_strain_v", "middle_strain_v", "speed_v")
    records = tuple(replace(each, source=HOSTILE, outputs=outputs) for each in outcome.records)
    hostile = renamed(outcome, records, outputs)
    text = rendered(replace(hostile, warnings=(HOSTILE,)), HOSTILE, files=[HOSTILE])
    page = Page(text)
    assert (page.count("script"), text.count("</main>")) == (1, 1)
    assert page.text.count(HOSTILE) >= 4


@pytest.mark.slow
def test_render_report___several_inputs_outputs_and_records___shows_three_records(
    many_channels: Outcome,
) -> None:
    text = rendered(many_channels)
    page = Page(text)
    assert views_of(text) == 1 + 2 + 2 + 2 + 2 + 2 * 3 + 2 * 3 * 3 + 2 * 3 + 2 * 3 + 2 * 3
    assert len(text.encode()) < 0.8e6
    assert "The first 3 of 4 records are shown." in page.text
    assert "bag 3" in page.text
    assert "From u0 to each output." in page.text
    assert "From u1 to each output." in page.text
    assert "The model was not reduced." in page.text
    assert "Closed-loop simulation" not in re.findall("<h2>(.*?)</h2>", text)
    assert 'class="marked"' not in text.split("<h2>Modes</h2>")[1].split("</table>", maxsplit=1)[0]


@pytest.mark.slow
def test_render_report___simulation_that_runs_away___is_still_drawn(small: Outcome) -> None:
    wild = np.full_like(small.dmv[0].y, np.nan)
    wild[:100], wild[100:200], wild[200:300] = 0.0, 1e300, -np.inf
    delta = np.full(1, np.inf)
    dmv = replace(small.dmv[0], y=wild, delta=delta, error=delta, mean=np.inf)
    text = rendered(replace(small, dmv=(dmv,), dmv_errors=delta))
    page = Page(text)
    assert "δ = ∞" in page.text
    assert "has a fit of -∞ %" in page.text
    assert not re.search(r' d="[^"]*(nan|inf|e\+)', text)


def test_render_report___outcome___holds_the_model_in_every_format(
    outcome: Outcome, text: str, tmp_path: Path
) -> None:
    files = {
        str(attributes["download"]): str(attributes["href"])
        for tag, attributes in Page(text).tags
        if tag == "a" and "download" in attributes
    }
    assert set(files) == {"arm.yaml", "arm.json", "arm.mat", "arm.h"}
    for name, uri in files.items():
        (tmp_path / name).write_bytes(base64.b64decode(uri.partition(";base64,")[2]))
    for name in ("arm.yaml", "arm.json", "arm.mat"):
        loaded = load_model(tmp_path / name)
        for matrix in "ABCD":
            np.testing.assert_array_equal(getattr(loaded, matrix), getattr(outcome.model, matrix))
    assert "model_arm_a" in (tmp_path / "arm.h").read_text("ascii")
    assert 'load_model("arm.yaml")' in Page(text).text


def views_of(text: str) -> int:
    return sum(attributes.get("role") == "group" for _, attributes in Page(text).tags)


def rows_of(text: str, heading: str, kind: str) -> list[list[str]]:
    section = text.split(f"<h2>{heading}</h2>")[1]
    part = section.split(f'class="{kind}"')[1].split("</table>", maxsplit=1)[0]
    return [
        re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row)
        for row in part.split("</thead>")[1].split("</tr>")
    ][:-1]


def test_render_report___outcome___says_what_each_step_of_the_reduction_costs(
    outcome: Outcome, text: str
) -> None:
    rows = {row[0]: row[1:] for row in rows_of(text, "Reduction", "costs")}
    names = ["MRM", "MSV", "MRMC"]
    steps = [f"{name}, {step}" for name in names for step in ("cut", "B refitted", "C refitted")]
    assert list(rows) == ["Full model", *steps]
    full, chosen = rows["Full model"], rows["MRMC, B refitted"]
    assert full[:1] + full[5:7] == ["14", f"{outcome.full_dmv_errors.mean():.4f}", "\u00d7 1.00"]
    assert chosen[0] == "9"
    assert chosen[1:5] == [f"{delta:.4f}" for delta in outcome.dmv_errors]
    assert outcome.sfv is not None
    assert float(chosen[7]) == pytest.approx(outcome.sfv.error.mean(), abs=1e-4)
    (marked,) = re.findall(r'<tr class="marked"><th scope="row">(M[^<]*)', text)
    assert marked == "MRMC, B refitted"


def test_render_report___outcome___ranks_the_modes_by_both_indices(
    outcome: Outcome, text: str
) -> None:
    rows = rows_of(text, "Reduction", "ranks")
    assert [row[0] for row in rows] == [str(i + 1) for i in range(len(outcome.modes))]
    for column, index in ((1, "mrm"), (4, "msv")):
        falling = sorted(outcome.modes, key=lambda mode: -float(getattr(mode, index)))
        marked = [f"{mode.label} \u2713" if mode.kept else mode.label for mode in falling]
        assert [row[column] for row in rows] == marked


def test_render_report___all_modes_kept___says_so(small_text: str) -> None:
    assert "all are kept" in small_text
    assert "reduced from" not in small_text
    assert (
        'class="marked"'
        not in small_text.split("<h2>Modes</h2>")[1].split("</table>", maxsplit=1)[0]
    )


def test_render_report___flawed_data___lists_checks_with_figures() -> None:
    model = random_model(2, states=5, outputs=2)
    clean = record(model, 600, 1, noise=0.01, source="runs/a (from a file of somebody)")
    y = clean.y.copy()
    y[:, 1] = y[:, 0]
    flawed = replace(clean, y=y)
    text = rendered(run(flawed, Request(method="orse", order=5, block_rows=8)))
    words = " ".join(Page(text).text.split())
    assert "caution: a: y1 repeats y0 (correlation" in words
    found = words.split("Duplicated channel")[1]
    assert found.strip().startswith("a, y1 ")
    assert "correlation 1" in found.split("Offset")[0]
    assert "Saturation" in words.split("checks pass")[1]


def test_render_report___notes___stand_by_their_grade(text: str, outcome: Outcome) -> None:
    # This outcome has information only: nothing to be warned of.
    assert {note.partition(":")[0] for note in outcome.warnings} == {"information"}
    assert 'class="warnings"' not in text
    box = text.split('class="remarks"')[1].split("</div>", maxsplit=1)[0]
    assert box.count("<li>") == len(outcome.warnings)
    assert "information: " not in box


def test_sections___registry___has_every_section_once_in_the_order_of_the_report(
    outcome: Outcome, text: str
) -> None:
    modules = Path(registry.__file__).parent.glob("[a-z]*.py")
    written = sum(file.read_text("utf-8").count(" = Section(") for file in modules)
    rows = registry.sections()
    assert len(rows) == written == len({row.place for row in rows})
    titles = [row.title for row in rows if row.applies(subject_of(outcome))]
    assert re.findall("<h2>(.*?)</h2>", text) == titles
    assert re.findall(r'<section id="(.*?)">', text) == [
        row.anchor for row in rows if row.title in titles
    ]
