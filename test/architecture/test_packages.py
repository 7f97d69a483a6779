"""Manifests of the packages: what they declare and import, and what a release needs."""

from __future__ import annotations

import ast
import re
import runpy
import shutil
import sys
from configparser import ConfigParser
from functools import cache
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import pytest
from catkin_pkg.package import parse_package
from catkin_pkg.package_version import get_forthcoming_label
from catkin_pkg.topological_order import topological_order

import flexarm_core
from support.import_graph import SOURCES, Module
from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import TypeGuard

# Names of imports that are called otherwise by rosdep; every other name is its own. Each was looked
# up in rosdistro's rosdep/python.yaml or the pull request that added it there.
ROSDEP = {
    "click": "python3-click",
    "hypothesis": "python3-hypothesis",
    "jinja2": "python3-jinja2",
    "joblib": "python3-joblib",
    "matplotlib": "python3-matplotlib",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "sphinx": "python3-sphinx",
    "yaml": "python3-yaml",
}
# Without a key, or with one that is too old on Ubuntu 24.04 (websockets 10): `setup.py` names them,
# with the bounds of requirements/base.in.
FROM_PIP = {"control", "lz4", "mcap", "threadpoolctl", "websockets", "zstandard"}
DEPENDS = {"depend", "exec_depend", "build_depend", "build_export_depend"}
PACKAGES = sorted(setup.parent for setup in SOURCES.glob("flexarm_*/setup.py"))
EVERY_PACKAGE = sorted(manifest.parent for manifest in SOURCES.glob("flexarm_*/package.xml"))


def sources(package: Path) -> Iterator[Module]:
    """Yield modules, launch files and programs of a package."""
    for file in package.rglob("*.py"):
        if file.name != "setup.py":
            yield Module(file.stem, file)


@cache
def imported(folder: Path) -> set[str]:
    """Return the names of what is imported in a folder and neither is nor comes with Python."""
    names = {name.partition(".")[0] for each in sources(folder) for name in each.imported}
    return names - {folder.name, "__future__"} - sys.stdlib_module_names


def keys(names: set[str]) -> list[str]:
    """Return the keys of rosdep for what has one."""
    return sorted(ROSDEP.get(name, name) for name in names - FROM_PIP)


def manifest_of(package: Path) -> ET.Element:
    """Return the content of a package's `package.xml`."""
    return ET.parse(package / "package.xml").getroot()  # noqa: S314 - our own file


def declared(package: Path, tags: set[str]) -> list[str]:
    """Return the keys that a `package.xml` declares."""
    return sorted(str(each.text) for each in manifest_of(package) if each.tag in tags)


def setup_arguments(package: Path) -> dict[str, Any]:
    """Return the constant arguments of a package's `setup`."""
    calls = [
        node for node in ast.walk(Module("setup", package / "setup.py").tree) if is_setup(node)
    ]
    return {
        str(each.arg): ast.literal_eval(each.value)
        for each in calls[0].keywords
        if each.arg in {"version", "install_requires", "extras_require", "license", "description"}
    }


def is_setup(node: ast.AST) -> TypeGuard[ast.Call]:
    """Return whether a node of a syntax tree calls `setup`."""
    return isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setup"


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: str(package.name))
@pytest.mark.slow
def test_package___declares___what_it_imports_and_nothing_else(package: Path) -> None:
    assert declared(package, DEPENDS) == keys(imported(package))


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: str(package.name))
@pytest.mark.slow
def test_setup___requires___what_rosdep_has_no_key_for(package: Path) -> None:
    lines = (PROJECT / "requirements" / "base.in").read_text("utf-8").splitlines()
    bounds = {found[1]: found[2] for line in lines if (found := re.match(r"([\w-]+)(\S+)", line))}
    wanted = [f"{name}{bounds[name]}" for name in sorted(imported(package) & FROM_PIP)]
    assert setup_arguments(package)["install_requires"] == ["setuptools", *wanted]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: str(package.name))
@pytest.mark.slow
def test_package___declares___the_tools_of_its_unit_tests(package: Path) -> None:
    tests = PROJECT / "test" / "unit" / package.name.removeprefix("flexarm_")
    tools = imported(tests) & {"pytest", "hypothesis"}
    assert declared(package, {"test_depend"}) == keys(tools)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: str(package.name))
def test_package___has_its_unit_tests___found_by_colcon_test(package: Path) -> None:
    # Colcon takes pytest for a package that asks for it, and runs it in the package's folder.
    assert setup_arguments(package)["extras_require"]["test"] == ["pytest"]
    settings = ConfigParser()
    settings.read(package / "setup.cfg", "utf-8")
    (tests,) = package.glob(settings["tool:pytest"]["testpaths"])
    assert tests.resolve() == PROJECT / "test" / "unit" / package.name.removeprefix("flexarm_")
    paths = {(package / each).resolve() for each in settings["tool:pytest"]["pythonpath"].split()}
    assert paths == {PROJECT, PROJECT / "test"}


def test_workspace___as_released___has_an_order_and_changelogs() -> None:
    packages = {each.name: parse_package(each) for each in EVERY_PACKAGE}
    order = [package.name for _, package in topological_order(SOURCES)]
    assert packages.keys() <= set(order)
    for name, package in packages.items():
        complaints: list[str] = []
        package.validate(complaints)
        assert complaints == []
        # The release takes it for its version.
        changes = (SOURCES / name / "CHANGELOG.rst").read_text("utf-8")
        assert get_forthcoming_label(changes) == "Forthcoming"


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: str(package.name))
def test_setup___installs___every_data_file_beside_the_modules(
    package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments: dict[str, Any] = {}
    monkeypatch.chdir(package)
    monkeypatch.setattr("setuptools.setup", arguments.update)
    runpy.run_path("setup.py")
    installed = {
        file
        for name, patterns in arguments.get("package_data", {}).items()
        for pattern in patterns
        for file in (package / name.replace(".", "/")).glob(pattern)
    }
    beside = {
        file
        for file in (package / package.name).rglob("*")
        if file.is_file() and file.suffix != ".py" and file.parent.name != "__pycache__"
    }
    assert beside - installed == set()


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_setup___with_bytecode_beside_its_data___installs_files_alone(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = shutil.copytree(package, tmp_path / package.name)
    folders = [folder for folder in copy.rglob("*") if folder.is_dir()]
    for folder in folders:
        if folder.name != "__pycache__":
            (folder / "__pycache__").mkdir(exist_ok=True)
    arguments: dict[str, Any] = {}
    monkeypatch.chdir(copy)
    monkeypatch.setattr("setuptools.setup", arguments.update)
    runpy.run_path("setup.py")
    named = [file for _, files in arguments["data_files"] for file in files]
    assert named
    assert [file for file in named if not (copy / file).is_file()] == []


def test_messages___declare___the_packages_of_their_fields() -> None:
    package = SOURCES / "flexarm_msgs"
    texts = [file.read_text("utf-8") for file in package.glob("*/*.*")]
    fields = {name for text in texts for name in re.findall(r"^(\w+)/\w+", text, re.MULTILINE)}
    assert declared(package, {"depend"}) == sorted({"action_msgs"} | fields)


@pytest.mark.parametrize("package", EVERY_PACKAGE, ids=lambda package: str(package.name))
def test_package___could_be_released(package: Path) -> None:
    manifest = manifest_of(package)
    texts = {each.tag: str(each.text) for each in manifest}
    assert {"name", "version", "description", "maintainer", "license", "url", "author"} <= set(
        texts
    )
    assert texts["name"] == package.name
    assert texts["version"] == flexarm_core.__version__
    license_text = (PROJECT / "LICENSE").read_bytes()
    assert manifest.find("license").attrib == {"file": "LICENSE"}  # type: ignore[union-attr]
    assert (package / "LICENSE").read_bytes() == license_text
    title = f"Changelog for package {package.name}"
    bar = "^" * len(title)
    changes = (package / "CHANGELOG.rst").read_text("utf-8")
    assert changes.startswith(f"{bar}\n{title}\n{bar}\n\nForthcoming\n-----------\n* ")
    if package in PACKAGES:
        settings = setup_arguments(package)
        same = ("version", "license", "description")
        assert {name: settings[name] for name in same} == {name: texts[name] for name in same}


def test_imported___of_a_file___has_late_and_type_only_imports_too(tmp_path: Path) -> None:
    file = tmp_path / "part.py"
    file.write_text(
        "import os, numpy.linalg\n"
        "if TYPE_CHECKING:\n    from rosbags.typesys.store import Typestore\n"
        "def late():\n    import yaml\n",
        "utf-8",
    )
    assert keys(imported(tmp_path)) == ["python3-numpy", "python3-rosbags-pip", "python3-yaml"]
