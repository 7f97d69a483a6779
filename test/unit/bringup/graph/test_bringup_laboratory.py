from __future__ import annotations

import tempfile
from typing import TYPE_CHECKING

import pytest

from flexarm_bringup.graph.laboratory import claimed_domain
from flexarm_bringup.graph.processes import LaunchError

if TYPE_CHECKING:
    from pathlib import Path


def test_claimed_domain___second_graph___is_refused_until_the_first_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with (
        claimed_domain("/flexarm"),
        pytest.raises(LaunchError, match="a graph runs already in ROS domain"),
        claimed_domain("/flexarm"),
    ):
        pass
    with claimed_domain("/flexarm"), claimed_domain("/lab/arm2"):
        pass


def test_claimed_domain___link_in_place_of_the_claim___is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with claimed_domain("/flexarm"):
        pass
    (claim,) = tmp_path.glob("flexarm-*/*")
    assert claim.stat().st_mode & 0o777 == 0o600
    assert claim.parent.stat().st_mode & 0o777 == 0o700

    claim.unlink()
    claim.symlink_to(tmp_path / "elsewhere")
    with (
        pytest.raises(LaunchError, match=r"cannot claim the ROS domain: .*domain_"),
        claimed_domain("/flexarm"),
    ):
        pass
    assert not (tmp_path / "elsewhere").exists()
