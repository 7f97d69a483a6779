"""The script `flexarm` at the root: answers before the set-up, its paths, its end."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main
from support.project import PROJECT


def environment(script: str, install: Path) -> dict[str, str]:
    """Return the environment that bash has after a script."""
    done = subprocess.run(  # noqa: S603 - our own script
        ["/bin/bash", "-c", f"{script}; /usr/bin/env -0"],
        env={
            "PATH": "/usr/bin:/bin",
            "LD_LIBRARY_PATH": "/before",
            "install": str(install),
            "home": str(install.parent),
            "suffix": install.name.removeprefix("install"),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(line.split("=", 1) for line in done.stdout.split("\0") if line)


def test_kept_paths___set___what_the_script_of_colcon_sets() -> None:
    install = Path(os.environ.get("FLEXARM_INSTALL", ""))
    if PROJECT not in install.parents:
        pytest.skip("this environment was not made by ./flexarm in this checkout")
    ours = environment('source "$install/.flexarm-paths"', install)
    theirs = environment(
        'COLCON_CURRENT_PREFIX=$install; source "$install/local_setup.bash"', install
    )
    for name in ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"):
        assert ours[name] == theirs[name]


def test_sources_of_a_build___are_not_the_bytecode_beside_them(tmp_path: Path) -> None:
    launch = tmp_path / "src" / "one" / "launch"
    (launch / "__pycache__").mkdir(parents=True)
    (launch / "one.launch.py").touch()
    (launch / "__pycache__" / "one.pyc").touch()
    lines = (PROJECT / "flexarm").read_text("utf-8")
    found = lines[lines.index("sources=$(") : lines.index("mapfile -t sources")]
    done = subprocess.run(  # noqa: S603 - our own script
        ["/bin/bash", "-c", f'{found}printf %s "$sources"'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "src/one/launch/one.launch.py"


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """Return a checkout that nobody has set up."""
    root = tmp_path / "checkout"
    (root / "src" / "flexarm_msgs").mkdir(parents=True)
    (root / "src" / "flexarm_msgs" / "package.xml").touch()
    shutil.copytree(PROJECT / "requirements", root / "requirements")
    for name in ("flexarm", "pyproject.toml"):
        shutil.copy2(PROJECT / name, root / name)
    return root


def called(root: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S603 - our own script
        [root / "flexarm", *arguments],
        env={"PATH": "/usr/bin:/bin", "HOME": str(root), "FLEXARM_PYTHON": sys.executable},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("arguments", [(), ("-h",), ("--help",), ("demo", "--help")], ids=" ".join)
def test_help___before_the_set_up___says_what_will_happen(
    bare: Path, arguments: tuple[str, ...]
) -> None:
    before = sorted(bare.rglob("*"))
    done = called(bare, *arguments)
    assert done.returncode == 0
    assert done.stderr == ""
    assert "not set up" in done.stdout
    assert f"installs them in {bare}/.venv" in done.stdout
    assert sorted(bare.rglob("*")) == before


def test_version___before_the_set_up___is_that_of_the_command(bare: Path) -> None:
    assert called(bare, "--version").stdout == CliRunner().invoke(main, ["--version"]).output


def test_clean___removes_what_the_set_up_made_alone(bare: Path) -> None:
    before = sorted(bare.rglob("*"))
    for name in (".venv", "install", "build", "log"):
        (bare / name).mkdir()
        (bare / name / "one").touch()
    done = called(bare, "clean")
    assert done.returncode == 0
    assert [name in done.stderr for name in (".venv", "install", "build", "log")] == [True] * 4
    assert sorted(bare.rglob("*")) == before
    assert called(bare, "clean").returncode == 0
