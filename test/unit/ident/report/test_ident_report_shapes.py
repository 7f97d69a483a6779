"""Tests of the mode shapes in the report."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from flexarm_ident.models.modes import ModeShape
from flexarm_ident.report.content.blocks import Plots, Subject, Table, Words
from flexarm_ident.report.sections.shapes import SECTION, shape_plot
from flexarm_ident.workflow.request import Request
from flexarm_ident.workflow.stages import run
from support.ident_systems import named, random_model, record


def subject(outputs: int) -> Subject:
    """Return a model of two oscillating modes and a real one."""
    data = record(random_model(2, states=5, outputs=outputs), 600, 1, noise=0.001)
    return Subject(run(data, Request(method="orse", order=5, block_rows=8)), "rig", {})


def test_shapes__each_oscillating_mode___has_a_row_and_a_plot() -> None:
    found = subject(3)
    plots, table, words = SECTION.build(found)
    assert isinstance(plots, Plots)
    assert isinstance(table, Table)
    assert isinstance(words, Words)
    own = sorted(mode.frequency_hz for mode in found.outcome.modes if mode.is_pair)
    assert len(plots.plots) == len(own) == 2
    assert [float(row[0]) for row in table.rows] == pytest.approx(own, abs=1e-3)
    for _, *cells in table.rows:
        sizes, phases = zip(*(cell.rstrip("\u00b0").split(", ") for cell in cells), strict=True)
        largest = max(range(len(sizes)), key=lambda i: float(sizes[i]))
        assert (sizes[largest], phases[largest]) == ("1.00", "0")
        assert all(-180 < int(phase.replace("\u2212", "-")) <= 180 for phase in phases)


def test_shapes__many_outputs___are_a_table_alone() -> None:
    table, words = SECTION.build(subject(7))
    assert isinstance(table, Table)
    assert isinstance(words, Words)


def test_shapes__one_output___has_no_section() -> None:
    assert SECTION.applies(subject(2))
    assert not SECTION.applies(subject(1))


def test_shape_plot__outputs___have_a_bar_a_point_and_a_name_each() -> None:
    plot = shape_plot(
        ModeShape(9.4, 0.01, np.array([1.0, -0.5 + 0.2j, 0.1j])), ("angle_v", "strain_v", "speed_v")
    )
    bars = plot.split('class="band m0"')[1].split(" d=")[1]
    assert bars.count("z") >= 3
    assert plot.split('class="dot m1"')[1].split("/>")[0].count("h0") == 3
    for name in ("angle", "strain", "speed"):
        assert f">{name}<" in plot
    assert "shape of the mode at 9.4 Hz over 3 outputs" in plot


def test_shapes__output_that_hardly_moves___is_not_reported_as_still() -> None:
    outcome = subject(3).outcome
    whole = outcome.model
    faint = named(whole.A, whole.B, whole.C * np.array([[1.0], [1e-4], [1.0]]), whole.D)
    outcome = replace(outcome, identification=replace(outcome.identification, model=faint))
    _, table, _ = SECTION.build(Subject(outcome, "rig", {}))
    assert isinstance(table, Table)
    sizes = [float(row[2].split(", ")[0]) for row in table.rows]
    assert len(sizes) == 2
    assert all(0.0 < size < 0.005 for size in sizes)
