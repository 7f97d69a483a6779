from __future__ import annotations

import pytest
from click.testing import CliRunner

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.laboratory.remote import set_
from support.hostile_texts import doubled


@pytest.mark.parametrize("value", ["!!int ''", "[", "9" * 5000, doubled(40), "[" * 2000])
def test_set___value_that_is_none___is_refused_before_any_graph(value: str) -> None:
    result = CliRunner().invoke(set_, ["daq", f"rate_hz={value}"])
    assert isinstance(result.exception, LaunchError)
    assert "the value is none" in str(result.exception)
    assert len(str(result.exception)) < 200
