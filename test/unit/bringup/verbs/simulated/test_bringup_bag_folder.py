"""Folder of the bags of a run on the simulated arm, at the run's end."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_bringup.graph.processes import HeldDriveError, LaunchError
from flexarm_bringup.runs.pace import Pace
from flexarm_bringup.verbs.simulated.simulated_run import RunSettings
from flexarm_core.outputs import OutputError

if TYPE_CHECKING:
    from pathlib import Path


def settings(out: Path) -> RunSettings:
    return RunSettings(
        out=out,
        payload_kg=0.0,
        seed=1,
        pace=Pace.FAST,
        keep_bag=False,
        force=False,
        live=False,
        namespace="/flexarm",
    )


@pytest.mark.parametrize(
    ("error", "is_kept"), [(HeldDriveError, True), (LaunchError, False), (KeyboardInterrupt, False)]
)
def test_bags___of_a_run_whose_drive_was_held___stay_until_the_next_run(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    error: type[BaseException],
    is_kept: bool,  # noqa: FBT001
) -> None:
    run = settings(tmp_path)
    with pytest.raises(error), run.bag_folder() as bags:  # noqa: PT012 - as in a run
        (bags / "experiment").mkdir()
        raise error("torn")
    assert (tmp_path / "bag" / "experiment").is_dir() == is_kept
    kept = f"what was recorded is kept in {tmp_path / 'bag'}\n"
    assert capsys.readouterr().out == (kept if is_kept else "")
    # It is replaced without a question.
    run.make_room()
    with run.bag_folder() as bags:
        assert not (bags / "experiment").exists()


def test_bags___of_a_run_at_work___are_not_taken_away_by_another_one(tmp_path: Path) -> None:
    first, second = settings(tmp_path / "same"), settings(tmp_path / "same")
    with first.bag_folder() as bags:
        (bags / "experiment").mkdir()
        with (
            pytest.raises(OutputError, match=r"same: another run is at work there: choose another"),
            second.bag_folder(),
        ):
            pass
        assert (bags / "experiment").is_dir()
    with second.bag_folder():
        pass
