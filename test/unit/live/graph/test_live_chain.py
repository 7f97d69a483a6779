"""Command lines that do what the page's chain does."""

from __future__ import annotations

from flexarm_bringup.verbs.offline.tune import tune
from flexarm_live.graph.chain import tune_line


def test_line_of_a_tuning___is_taken_by_the_verb() -> None:
    margins = {"gain_margin_db": 9.0, "phase_margin_deg": 50.0}
    program, verb, *words = tune_line("pdpc", ["nominal:0"], margins).split()
    assert (program, verb) == ("./flexarm", "tune")
    taken = tune.make_context("tune", words).params
    assert taken["law"] == "pdp"
    assert {name: taken[name] for name in margins} == margins
