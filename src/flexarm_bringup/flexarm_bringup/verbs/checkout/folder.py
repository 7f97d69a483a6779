"""Folder of the checkout, and the environment of the programs in it."""

from __future__ import annotations

import os
from pathlib import Path

from flexarm_bringup.graph.processes import LaunchError


def checkout(what: str) -> Path:
    """Return the folder of the checkout; outside one, raise a `LaunchError` that names `what`."""
    root = os.environ.get("FLEXARM_ROOT")
    if root is None or not Path(root, "pyproject.toml").is_file():
        raise LaunchError(f"the {what} live in the checkout: run ./flexarm there")
    return Path(root)


def environment(root: Path) -> dict[str, str]:
    """Return this process's environment, in which its children find the folders of the checkout."""
    paths = [str(root), str(root / "extras"), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
