from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_bringup.graph.laboratory import unknown_nodes

if TYPE_CHECKING:
    from pathlib import Path

KNOWN = {"/flexarm/daq", "/flexarm/controller"}


@pytest.mark.parametrize(
    ("text", "unknown"),
    [
        ("/flexarm/daq: {ros__parameters: {rig: nidaq}}", []),
        ("flexarm: {daq: {ros__parameters: {}}, controller: {ros__parameters: {}}}", []),
        ("/**: {ros__parameters: {use_sim_time: true}}", []),
        ("/flexarm/controler: {ros__parameters: {law: pd}}", ["/flexarm/controler"]),
        # Without its namespace the name is another one.
        ("controller: {ros__parameters: {law: pd}}", ["/controller"]),
        ("law: pd", []),
        ("[1, 2]", []),
        ("{: no yaml", []),
    ],
)
def test_unknown_nodes___are_those_that_nobody_has(
    tmp_path: Path, text: str, unknown: list[str]
) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(text)
    assert unknown_nodes(file, KNOWN) == unknown


def test_unknown_nodes___file_that_is_not_there___is_left_to_the_nodes(tmp_path: Path) -> None:
    assert unknown_nodes(tmp_path / "none.yaml", KNOWN) == []
