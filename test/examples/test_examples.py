"""The programs of `examples`, run as their user runs them, where ROS can't be imported.

The two that are ROS 2 nodes run in `test/system/test_system_own_nodes.py`.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

EXAMPLES = sorted((PROJECT / "examples").glob("*.py"))
# The one that commands an arm takes a place over and gives it back.
MOST_LINES = {"own_commander": 120}
USUAL_LINES = 70


def printed(program: str, folder: Path) -> str:
    """Run a program in a Python without ROS and return what it printed."""
    (folder / "rclpy.py").write_text('raise ImportError("an example needs no ROS")\n', "utf-8")
    done = subprocess.run(  # noqa: S603 - our own program
        [sys.executable, str(PROJECT / "examples" / f"{program}.py")],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path])},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def figure(pattern: str, text: str) -> float:
    """Return the number that a pattern catches in a text."""
    found = re.search(pattern, text)
    assert found, text
    return float(found[1])


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: str(file.stem))
def test_example___is___short(file: Path) -> None:
    assert len(file.read_text("utf-8").splitlines()) < MOST_LINES.get(file.stem, USUAL_LINES)


def test_identify_bag___recorded_arm___prints_the_bending_modes_and_small_errors(
    tmp_path: Path,
) -> None:
    text = printed("identify_bag", tmp_path)
    kept_hz = [float(hz) for hz in re.findall(r"([\d.]+) Hz .* kept", text)]
    # The thesis's arm bends at 9.4 and 24.1 Hz.
    assert any(abs(hz - 9.4) < 0.5 for hz in kept_hz)
    assert any(abs(hz - 24.1) < 0.7 for hz in kept_hz)
    assert figure(r"position_v: ([\d.]+)", text) < 0.25


def test_design_controller___identified_model___margins_hold_and_the_step_settles(
    tmp_path: Path,
) -> None:
    text = printed("design_controller", tmp_path)
    assert figure(r"margins: ([\d.]+) dB", text) > 9.9
    assert figure(r"dB, ([\d.]+) deg", text) > 54.0
    assert figure(r"settling time \(5 %\) ([\d.]+) s", text) < 2.0


def test_own_rig___under_pd_control___comes_to_the_set_point(tmp_path: Path) -> None:
    text = printed("own_rig", tmp_path)
    assert abs(figure(r"mean error ([-+\d.]+) V", text)) < 0.05
    assert figure(r"settling time \(5 %\) ([\d.]+) s", text) < 3.0


def test_own_law___beside_a_packaged_one___settles(tmp_path: Path) -> None:
    text = printed("own_law", tmp_path)
    for name in ("pid", "pdpc"):
        assert figure(rf"{name}: .*settling_s=([\d.]+)", text) < 5.0
        assert abs(figure(rf"{name}: .*mean_error_v=([-\d.e]+)", text)) < 0.05


@pytest.mark.exhaustive
def test_learn_gains___six_rounds___are_no_worse_than_the_law_on_new_arms(tmp_path: Path) -> None:
    text = printed("learn_gains", tmp_path)
    assert figure(r"round 1: best [-\d.]+, median ([-\d.]+)", text) < -200.0
    # The law's -46 and a tenth: where gains end differs with the last digit of the arms.
    assert figure(r"learned: ([-\d.]+)", text) > 1.1 * figure(r"pdpc: ([-\d.]+)", text)
