from __future__ import annotations

import tempfile
from typing import TYPE_CHECKING

import pytest

from flexarm_bringup.graph.laboratory import claimed_domain, unknown_nodes
from flexarm_bringup.graph.processes import LaunchError

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


def test_claimed_domain___second_graph___is_refused_until_the_first_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with (
        claimed_domain(),
        pytest.raises(LaunchError, match="a graph runs already in ROS domain"),
        claimed_domain(),
    ):
        pass
    with claimed_domain():
        pass


def test_claimed_domain___link_in_place_of_the_claim___is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with claimed_domain():
        pass
    (claim,) = tmp_path.glob("flexarm-*/*")
    assert claim.stat().st_mode & 0o777 == 0o600
    assert claim.parent.stat().st_mode & 0o777 == 0o700

    claim.unlink()
    claim.symlink_to(tmp_path / "elsewhere")
    with (
        pytest.raises(LaunchError, match=r"cannot claim the ROS domain: .*domain_"),
        claimed_domain(),
    ):
        pass
    assert not (tmp_path / "elsewhere").exists()
