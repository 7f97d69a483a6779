from __future__ import annotations

import click
import pytest

from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.verbs.laboratory.options import chosen_pace as chosen


def test_options___choose_a_pace_and_exclude_each_other() -> None:
    assert chosen() is Pace.WALL_CLOCK
    assert chosen(fast=True) is Pace.FAST
    assert chosen(real_time=True) is Pace.REAL
    with pytest.raises(click.UsageError, match="exclude each other"):
        chosen(fast=True, real_time=True)
