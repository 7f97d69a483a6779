"""Dependencies that a package declares in its `package.xml`, beside those that it imports."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

from support.import_graph import SOURCES, Module

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

# Names of imports that are called otherwise by rosdep; every other name is its own.
ROSDEP = {
    "click": "python3-click",
    "control": "python3-control-pip",
    "jinja2": "python3-jinja2",
    "joblib": "python3-joblib",
    "matplotlib": "python3-matplotlib",
    "lz4": "python3-lz4",
    "mcap": "python3-mcap",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags",
    "scipy": "python3-scipy",
    "sphinx": "python3-sphinx",
    "yaml": "python3-yaml",
    "zstandard": "python3-zstandard",
}
DEPENDS = {"depend", "exec_depend", "build_depend", "build_export_depend"}
PACKAGES = sorted(setup.parent for setup in SOURCES.glob("flexarm_*/setup.py"))


def sources(package: Path) -> Iterator[Module]:
    """Yield modules, launch files and programs of a package."""
    for file in package.rglob("*.py"):
        if file.name != "setup.py":
            yield Module(file.stem, file)


def imported(package: Path) -> set[str]:
    """Return the keys of what a package imports and neither is nor gets with Python."""
    names = {name.partition(".")[0] for each in sources(package) for name in each.imported}
    return {
        ROSDEP.get(name, name)
        for name in names - {package.name, "__future__"} - sys.stdlib_module_names
    }


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: str(package.name))
def test_package___declares___what_it_imports_and_nothing_else(package: Path) -> None:
    manifest = ET.parse(package / "package.xml").getroot()  # noqa: S314 - our own file
    declared = {str(each.text) for each in manifest if each.tag in DEPENDS}
    assert sorted(declared) == sorted(imported(package))


def test_imported___of_a_file___has_late_and_type_only_imports_too(tmp_path: Path) -> None:
    file = tmp_path / "part.py"
    file.write_text(
        "import os, numpy.linalg\n"
        "if TYPE_CHECKING:\n    from rosbags.typesys.store import Typestore\n"
        "def late():\n    import yaml\n",
        "utf-8",
    )
    assert imported(tmp_path) == {"python3-numpy", "python3-rosbags", "python3-yaml"}
