"""Folders that the experiments find, without any node."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.laboratory.experiment_runs import _make_room
from flexarm_daq.experiments.catalogue import experiment

if TYPE_CHECKING:
    from pathlib import Path


def a_folder(folder: Path, *names: str) -> None:
    bag = folder / "O_dat2"
    bag.mkdir()
    for name in names:
        (bag / name).write_text("mine")


def test_overwriting___folder_of_a_bag_alone___is_allowed(tmp_path: Path) -> None:
    a_folder(tmp_path, "metadata.yaml", "metadata.yaml.tmp", "O_dat2_0.mcap", "O_dat2_0.mcap.zstd")
    _make_room(tmp_path, [experiment("O_dat2")], overwrite=True)


@pytest.mark.parametrize("name", ["notes.txt", "photo.png", "mcap"])
def test_overwriting___folder_with_something_else___is_refused_by_its_name(
    tmp_path: Path, name: str
) -> None:
    a_folder(tmp_path, "metadata.yaml", "O_dat2_0.mcap", name)
    with pytest.raises(LaunchError, match=f"O_dat2/{name} is no part of a bag: move it away"):
        _make_room(tmp_path, [experiment("O_dat2")], overwrite=True)
