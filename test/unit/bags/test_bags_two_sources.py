"""Check of a bag in which two nodes have sent to one topic."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_bags.check import check_bag
from flexarm_bags.content import taking_turns
from support.bag_samples import START_NS, STEP_NS, arm_state, commander_info, motor_command
from support.bag_samples import write_bag as written

if TYPE_CHECKING:
    from pathlib import Path

    from support.bag_samples import Sent

ALONE, TOGETHER = 50, 40
"""Samples that one controller answers, and those that two answer."""
NODES = ("/flexarm/controller", "/lab/controller")


def session(*, reported: bool) -> list[Sent]:
    """Return a run in whose midst a second controller starts, which numbers from 1."""
    sent: list[Sent] = []
    for k in range(ALONE + TOGETHER):
        stamp_ns = START_NS + k * STEP_NS
        sent += [arm_state(k + 1, stamp_ns), motor_command(k + 1, stamp_ns + 300_000, 0.1)]
        if k >= ALONE:
            second = motor_command(k + 1 - ALONE, stamp_ns + 400_000, 0.2, state_sequence=k + 1)
            sent.append(second)
    starts_ns = (START_NS, START_NS + ALONE * STEP_NS)
    told_of = [
        commander_info(start_ns, uses_outputs=True, node=node)
        for start_ns, node in zip(starts_ns, NODES, strict=True)
    ]
    return sorted([*sent, *told_of] if reported else sent, key=lambda each: each.time_ns)


@pytest.mark.parametrize(("reported", "named"), [(True, f" ({', '.join(NODES)})"), (False, "")])
def test_check___two_commanders_at_once___are_named_in_one_line(
    tmp_path: Path, named: str, *, reported: bool
) -> None:
    found = check_bag(written(tmp_path / "run", session(reported=reported)))
    # The second one's first number follows none; each of its others comes after one of the first.
    line = (
        f"/flexarm/command: two nodes sent at the same time{named}: their numbers take turns at "
        f"{TOGETHER - 1} places, the first after number {ALONE + 2}; end one of them and record "
        "again"
    )
    assert found.problems == (line,)
    assert not found.notes


@pytest.mark.parametrize(
    ("numbers", "turns"),
    [
        ([1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7], 6),
        ([*range(1, 30), *range(1, 30)], 0),
        ([*range(1, 30), *range(1, 30), *range(1, 9), *range(1, 9), *range(1, 9), *range(1, 9)], 0),
        ([9, 8, 7, 6, 5, 4, 3, 2, 1], 0),
        ([], 0),
    ],
)
def test_turns___of_two_sources___are_no_restarts_and_no_other_disorder(
    numbers: list[int], turns: int
) -> None:
    assert len(taking_turns(np.array(numbers, dtype=np.int64))) == turns
