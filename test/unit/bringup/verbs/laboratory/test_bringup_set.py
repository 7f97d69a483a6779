from __future__ import annotations

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph.assignments import assigned, parsed
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.laboratory.remote import set_
from support.hostile_texts import doubled


@pytest.mark.parametrize("value", ["!!int ''", "[", "9" * 5000, doubled(40), "[" * 2000])
def test_set___value_that_is_none___is_refused_before_any_graph(value: str) -> None:
    result = CliRunner().invoke(set_, ["daq", f"rate_hz={value}"])
    assert isinstance(result.exception, LaunchError)
    assert "the value is none" in str(result.exception)
    assert len(str(result.exception)) < 200


def test_assignment___of_nothing___is_the_empty_text_and_no_number() -> None:
    name, value = parsed("trajectory=")

    assert assigned("controller", {name: value}, {"trajectory": "/a.csv"}) == {"trajectory": ""}
    with pytest.raises(LaunchError, match="must be a number"):
        assigned("daq", {"rate_hz": value}, {"rate_hz": 300.0})
