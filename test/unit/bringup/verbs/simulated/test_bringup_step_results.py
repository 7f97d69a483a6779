"""Words about a controlled step."""

from __future__ import annotations

import numpy as np
import pytest

from flexarm_bringup.verbs.simulated.simulated_run import switching_words
from flexarm_ident.records.iodata import IoData


def step_with(compensation_v: list[float]) -> IoData:
    column = np.array(compensation_v)[:, None]
    return IoData(column, np.zeros((len(column), 4)), dt_s=1.0 / 300.0, compensation=column)


def test_switching_words___compensation_that_chatters___say_level_and_turns() -> None:
    (words,) = switching_words(step_with([0.7, -0.7] * 20 + [0.0] * 60))
    assert "±0.7 V" in words
    assert "here 39 times:" in words


@pytest.mark.parametrize(
    "compensation_v",
    [[0.0] * 100, [0.7] * 50 + [-0.7] * 50, [0.7, 0.0] * 50],
    ids=["none", "one turn", "off and on"],
)
def test_switching_words___compensation_that_does_not___are_not_there(
    compensation_v: list[float],
) -> None:
    assert switching_words(step_with(compensation_v)) == []


def test_switching_words___record_without_a_compensation___are_not_there() -> None:
    data = step_with([0.7, -0.7] * 20)
    assert switching_words(IoData(data.u, data.y, dt_s=data.dt_s)) == []
