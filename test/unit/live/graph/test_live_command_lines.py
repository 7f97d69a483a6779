"""Command lines that do what the page's chain does."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from flexarm_bringup.verbs.laboratory.programs import record
from flexarm_bringup.verbs.offline.identify import identify, report
from flexarm_bringup.verbs.offline.tune import tune
from flexarm_control.design.tuning_job import TUNINGS
from flexarm_control.laws.registry import LAWS
from flexarm_ident.workflow.request import Request
from flexarm_live.graph.chain import compare_line, identify_line, record_line, shown, tune_line

if TYPE_CHECKING:
    import click


def taken(verb: click.Command, line: str) -> dict[str, Any]:
    """Return what a verb takes from a command line."""
    program, name, *words = shlex.split(line)
    assert (program, name) == ("./flexarm", verb.name)
    return verb.make_context(name, words).params


@pytest.mark.parametrize("law", [name for name, row in LAWS.items() if row.tuning])
def test_line_of_a_tuning___is_taken_by_the_verb(law: str) -> None:
    margins = {"gain_margin_db": 9.0, "phase_margin_deg": 50.0}
    found = taken(tune, tune_line(law, ["nominal:0", "out/my arm/model.yaml"], margins))
    assert found["law"] == LAWS[law].tuning
    assert found["models"] == ("nominal:0", "out/my arm/model.yaml")
    assert {name: found[name] for name in margins} == margins


def test_laws_tuned_to_margins___are_those_whose_tuning_takes_them() -> None:
    assert {row.tuning for row in LAWS.values() if row.is_tuned_to_margins} == {*TUNINGS} - {"pi"}


@pytest.mark.parametrize(
    "request_",
    [
        {"method": "auto", "order": None},
        {"method": "pbsid", "order": 12},
        {
            "method": "auto",
            "order": 14,
            "reduction": "mrmc",
            "reduced_order": 8,
            "update": "b",
            "known_modes_hz": [9.02, 22.84],
        },
    ],
)
def test_line_of_an_identification___is_taken_by_the_verb(request_: dict[str, Any]) -> None:
    found = taken(identify, identify_line(Path("/a b/bag"), Path("/a b/models/bag"), request_))
    assert (found["bags"], found["out"]) == ((Path("/a b/bag"),), Path("/a b/models/bag"))
    given = {name: found[name] for name in request_}
    assert Request(**given) == Request(
        **request_ | {"known_modes_hz": tuple(request_.get("known_modes_hz", ()))}
    )


def test_line_of_an_identification_of_named_signals___is_taken_by_the_verb() -> None:
    signals = {"inputs": ["u_v=my u"], "outputs": ["y", "z"], "times": ["t", "200Hz"]}
    line = identify_line(Path("/a b/my run.csv"), Path("/a b/models"), {}, signals)
    found = taken(identify, line)
    assert {name: list(found[name]) for name in signals} == signals


@pytest.mark.parametrize("reduction", ["none", "mrmc"])
def test_line_of_a_comparison___is_taken_by_the_verb(reduction: str) -> None:
    request = {"order": 12} | ({"reduction": reduction} if reduction != "none" else {})
    places = [Path("/a b/run.csv"), Path("/a b/models/other")]
    line = compare_line(places, Path("/a b/page.html"), request, {"inputs": ["u"]})
    found = taken(report, line)
    assert (found["bags"], found["out"]) == (tuple(places), Path("/a b/page.html"))
    assert (found["order"], found["reduction"], found["inputs"]) == (12, reduction, ("u",))


def test_line_of_a_record___is_taken_by_the_verb() -> None:
    found = taken(record, record_line(Path("/a b/bag")))
    assert found["bag"] == Path("/a b/bag")


def test_path___below_the_working_folder___is_shown_from_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert shown(tmp_path / "out" / "run") == "out/run"
    assert shown(Path("/elsewhere/run")) == "/elsewhere/run"
