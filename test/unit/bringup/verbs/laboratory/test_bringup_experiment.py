"""Folders that the experiments find, without any node."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from flexarm_bags.check import check_bag
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.laboratory.experiment import catalogue
from flexarm_bringup.verbs.laboratory.experiment import experiment as verb
from flexarm_bringup.verbs.laboratory.experiment_runs import _make_room, require_good
from flexarm_core.errors import FlexarmError
from flexarm_daq.experiments.catalogue import catalogue as experiments
from flexarm_daq.experiments.catalogue import experiment
from support.bag_samples import START_NS, STEP_NS, arm_state, write_bag

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ((), list(experiments())),
        (("C_dat3",), ["C_dat3"]),
        (("O_dat1", "square", "1 V", "300"), ["O_dat1"]),
    ],
)
def test_catalogue___words___choose_lines_that_fit_80_columns(
    words: tuple[str, ...], expected: list[str]
) -> None:
    done = CliRunner().invoke(catalogue, list(words))
    listed = re.findall(r"^ (\w+_dat\d+) ", done.output, re.MULTILINE)
    assert listed == expected
    assert max(map(len, done.output.splitlines())) <= 80


def test_catalogue___words_that_nothing_has___are_refused() -> None:
    done = CliRunner().invoke(catalogue, ["open", "sawtooth"])
    assert done.exit_code == 2
    assert "no experiment has open and sawtooth" in done.output


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
    with pytest.raises(LaunchError, match=f"O_dat2/{name} is not part of a bag: move it away"):
        _make_room(tmp_path, [experiment("O_dat2")], overwrite=True)


def test_payload___for_another_rig___is_refused(tmp_path: Path) -> None:
    new = tmp_path / "new"
    words = ["B_dat1", "--payload", "0.2", "--rig", "mujoco-two-link", "-o", str(new)]
    with pytest.raises(FlexarmError, match="--payload loads the thesis's arm"):
        verb.main(words, standalone_mode=False)
    assert not new.exists()


def test_record___skipped_periods___are_reported_and_not_refused(tmp_path: Path) -> None:
    numbers = [k for k in range(1, 40) if k not in {10, 11, 20}]
    sent = [arm_state(number, START_NS + number * STEP_NS) for number in numbers]
    check = check_bag(write_bag(tmp_path / "run", sent))
    (skipped,) = check.problems
    assert check.skipped == (skipped,)
    assert "3 periods without a sample at 2 places" in skipped
    require_good(check)


def test_record___stamps_that_stand_among_skipped_periods___is_refused(tmp_path: Path) -> None:
    numbers = [k for k in range(1, 40) if k not in {10, 11, 20}]
    stamps = [START_NS + min(number, 30) * STEP_NS for number in numbers]
    sent = [arm_state(number, stamp) for number, stamp in zip(numbers, stamps, strict=True)]
    with pytest.raises(LaunchError, match=r"run: .*the stamps do not advance .*: record again"):
        require_good(check_bag(write_bag(tmp_path / "run", sent)))
