"""The script `flexarm` at the root: the paths that it keeps are those of colcon's own script."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

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
