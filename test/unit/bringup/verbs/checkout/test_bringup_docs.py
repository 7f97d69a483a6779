"""The pages: examples hold, a site replaces a site, the viewers' layouts name what there is."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib import import_module
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest
from click.testing import CliRunner

from docs.pages import build_site
from flexarm_bringup.graph.processes import LaunchError
from flexarm_bringup.verbs.checkout.checks import DOCTEST
from flexarm_bringup.verbs.checkout.handing_on import docs
from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

ROOT = PROJECT
CONFIG = ROOT / "src" / "flexarm_bringup" / "config"
TYPES = {
    "/flexarm/reference": "std_msgs/Float64",
    "/flexarm/state": "flexarm_msgs/ArmState",
    "/flexarm/command": "flexarm_msgs/MotorCommand",
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
}


def run_examples(*places: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # noqa: S603 - our own tests
        [sys.executable, "-m", *DOCTEST, *places],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_examples___of_docstrings_and_pages___are_collected() -> None:
    found = run_examples("src/flexarm_daq/flexarm_daq/loop", "docs", "--collect-only", "-q").stdout
    for place in ("flexarm_daq/loop/limiter.py", "docs/units.md", "docs/howto/own_rig.md"):
        assert place in found


@pytest.mark.slow
def test_example_that_does_not_hold___is_shown(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("Text.\n\n```python\n>>> 1 + 1\n3\n\n```\n", "utf-8")
    done = run_examples(str(page))
    assert done.returncode == 1
    assert "Expected:\n    3\nGot:\n    2\n" in done.stdout


def test_site___without_its_theme___says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "furo", None)
    with pytest.raises(LaunchError, match=r"^no module furo: install requirements/dev\.in$"):
        build_site(ROOT, tmp_path / "site")


@pytest.mark.parametrize("name", ["mine.txt", ".buildinfo"])
def test_site___folder_with_something_else___is_left_alone(tmp_path: Path, name: str) -> None:
    """Also one with a site that Sphinx made of other pages."""
    (tmp_path / name).write_text("# Sphinx build info version 1\n", "utf-8")
    with pytest.raises(LaunchError, match=r"holds something else than a site of flexarm.*--force"):
        build_site(ROOT, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_docs___outside_a_checkout___says_where_to_go(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("FLEXARM_ROOT", raising=False)
    done = CliRunner().invoke(docs, ["-o", str(tmp_path / "site")])
    assert isinstance(done.exception, LaunchError)
    assert "run ./flexarm there" in str(done.exception)


def foxglove_paths() -> Iterator[tuple[str, str]]:
    """Yield topic and field of every curve of the layout."""
    layout = json.loads((CONFIG / "foxglove.json").read_text("utf-8"))
    for panel in layout["configById"].values():
        for path in panel.get("paths", ()):
            topic, _, field = path["value"].partition(".")
            yield topic, field


def test_foxglove___shows_the_arm_by_the_topic_and_the_frames_of_the_launch_file() -> None:
    layout = json.loads((CONFIG / "foxglove.json").read_text("utf-8"))
    panels = {name: panel for name, panel in layout["configById"].items() if name[:3] == "3D!"}
    ((name, panel),) = panels.items()
    assert f'"{name}"' in json.dumps(layout["layout"])
    (arm,) = [each for each in panel["layers"].values() if each["layerId"] == "foxglove.Urdf"]
    assert (arm["sourceType"], arm["topic"]) == ("topic", "/flexarm/robot_description")
    assert arm["framePrefix"] + "base_link" == panel["followTf"]


def plotjuggler_paths() -> Iterator[tuple[str, str]]:
    """Yield topic and field of every curve of the layout."""
    for curve in ET.parse(CONFIG / "plotjuggler.xml").iter("curve"):  # noqa: S314 - our own file
        topic, _, field = str(curve.get("name")).rpartition("/")
        yield topic, field


def fields_of(topic: str) -> dict[str, str]:
    package, _, name = TYPES[topic].partition("/")
    message = getattr(import_module(f"{package}.msg"), name)
    fields: dict[str, str] = message.get_fields_and_field_types()
    return fields


def test_reference___every_interface___is_on_its_page() -> None:
    files = (ROOT / "src" / "flexarm_msgs").glob("*/*.*")
    interfaces = {f"../../{path.relative_to(ROOT)}" for path in files}
    page = (ROOT / "docs" / "api" / "interfaces.md").read_text("utf-8")
    assert set(re.findall(r"\{literalinclude\} (\S+)", page)) == interfaces


def test_reference___every_package_but_the_command___is_in_it() -> None:
    page = (ROOT / "docs" / "api" / "index.rst").read_text("utf-8")
    packages = {path.parent.name for path in (ROOT / "src").glob("*/setup.py")}
    assert set(re.findall(r"^   (flexarm_\w+)$", page, re.MULTILINE)) == packages - {
        "flexarm_bringup"
    }


@pytest.mark.parametrize(("topic", "field"), sorted({*foxglove_paths(), *plotjuggler_paths()}))
def test_layouts___curve___is_a_number_of_a_message(topic: str, field: str) -> None:
    assert fields_of(topic)[field] == "double"


def test_layouts___both___show_the_same_curves() -> None:
    assert set(foxglove_paths()) == set(plotjuggler_paths())


def test_page_on_viewers___topics___have_their_types() -> None:
    text = (ROOT / "docs" / "howto" / "viewers.md").read_text("utf-8")
    assert dict(re.findall(r"^\| `(/\S+)` \| `(\S+)` \|", text, re.MULTILINE)) == TYPES
