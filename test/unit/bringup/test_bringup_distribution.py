"""The one distribution of the root's pyproject: what `pip install .` gives without ROS 2."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from typing import TYPE_CHECKING

import numpy as np
import pytest

from flexarm_ident import load_model
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

pytestmark = pytest.mark.slow

EXAMPLE = PROJECT / "examples" / "own_csv"
NO_ROS = """
import sys
class NoRos:
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package in {"rclpy", "ament_index_python"} or package.endswith(("_msgs", "_interfaces")):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, NoRos())
"""


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the command of an environment that has our distribution, our libraries and no ROS."""
    folder = tmp_path_factory.mktemp("distribution")
    # A build leaves files beside what it builds.
    source = folder / "flexarm"
    unwanted = shutil.ignore_patterns("__pycache__", "*.egg-info")
    shutil.copytree(PROJECT / "src", source / "src", ignore=unwanted)
    shutil.copytree(PROJECT / "requirements", source / "requirements")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(PROJECT / name, source)
    environment = folder / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)  # noqa: S603
    python = environment / "bin" / "python"
    (packages,) = environment.glob("lib/python*/site-packages")
    (packages / "libraries.pth").write_text(sysconfig.get_path("purelib"), "utf-8")
    install = ["install", "-q", "--no-deps", "--no-build-isolation", "--no-index", str(source)]
    subprocess.run(  # noqa: S603 - our own pip
        [sys.executable, "-m", "pip", "--python", python, *install], check=True, env=plain()
    )
    # A sitecustomize of ours would be hidden by that of Debian's Python.
    (packages / "no_ros.py").write_text(NO_ROS, "utf-8")
    (packages / "no_ros.pth").write_text("import no_ros\n", "utf-8")
    return environment / "bin" / "flexarm"


def plain() -> dict[str, str]:
    """Return the environment of a shell in which no workspace was sourced."""
    ours = ("ROS_", "AMENT_", "COLCON_", "FLEXARM_", "PYTHON")
    return {name: value for name, value in os.environ.items() if not name.startswith(ours)}


def called(command: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S603 - our own command
        [command, *words], cwd=folder, env=plain(), capture_output=True, text=True, check=False
    )


@pytest.mark.exhaustive
def test_identify___csv_of_the_example___gives_the_modes_of_the_arm(
    command: Path, tmp_path: Path
) -> None:
    words = ["identify", str(EXAMPLE / "run.csv"), "--map", str(EXAMPLE / "columns.yaml")]
    done = called(command, tmp_path, *words, "--order", "10", "-o", "model")
    assert done.returncode == 0, done.stderr
    model = load_model(tmp_path / "model" / "model.yaml")
    poles = np.linalg.eigvals(model.A).astype(complex)
    modes_hz = np.abs(np.log(poles)) / (2.0 * np.pi * model.dt)
    for hz in (9.3, 23.9, 46.5):
        assert min(abs(modes_hz / hz - 1.0)) < 0.05
    assert "</html>" in (tmp_path / "model" / "report.html").read_text("utf-8")


def test_verbs___that_start_no_node___work(command: Path, tmp_path: Path) -> None:
    words = ["import", str(EXAMPLE / "run.csv"), "--map", str(EXAMPLE / "columns.yaml")]
    for line in ([*words, "-o", "bag"], ["bag", "check", "bag"], ["catalogue"], ["--version"]):
        done = called(command, tmp_path, *line)
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("verb", ["experiment C_dat3", "up", "status", "run flexarm_daq daq_node"])
def test_verbs___that_need_nodes___say_so_in_one_line(
    command: Path, tmp_path: Path, verb: str
) -> None:
    done = called(command, tmp_path, *verb.split())
    assert done.returncode == 1
    # A busy machine is told of the wait, before.
    *waits, line = done.stderr.splitlines()
    assert all(wait.endswith(": at work") for wait in waits)
    assert "this verb works with ROS 2 nodes, and this Python has no " in line
    assert not list(tmp_path.iterdir())
