"""The pages: examples hold, the site builds, the viewers' layouts name what there is."""

from __future__ import annotations

import json
import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import pytest

from flexarm_bringup.checkout.docs import build_docs, build_site
from flexarm_bringup.checkout.doctests import (
    failures_in_module,
    failures_in_page,
    modules_with_examples,
    pages_with_examples,
)
from flexarm_bringup.graph.processes import LaunchError
from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = PROJECT
CONFIG = ROOT / "src" / "flexarm_bringup" / "config"
TYPES = {
    "/flexarm/reference": "std_msgs/Float64",
    "/flexarm/state": "flexarm_msgs/ArmState",
    "/flexarm/command": "flexarm_msgs/MotorCommand",
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
}


@pytest.mark.parametrize("name", list(modules_with_examples(ROOT / "src")))
def test_docstrings___examples___hold(name: str) -> None:
    assert failures_in_module(name) == ""


@pytest.mark.parametrize(
    "page", list(pages_with_examples(ROOT / "docs")), ids=lambda page: str(page.name)
)
def test_page___examples___hold(page: Path) -> None:
    assert failures_in_page(page) == ""


def test_page___example_that_does_not_hold___is_shown(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("Text.\n\n```python\n>>> 1 + 1\n3\n\n```\n", "utf-8")
    assert list(pages_with_examples(tmp_path)) == [page]
    said = failures_in_page(page)
    assert "Expected:\n    3\nGot:\n    2\n" in said


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::PendingDeprecationWarning")
def test_site___pages_of_the_checkout___build_without_a_warning(tmp_path: Path) -> None:
    site = tmp_path / "site"
    assert build_site(ROOT, site) == ""
    pages = {page.relative_to(site).with_suffix(".md") for page in site.rglob("*.html")}
    written = {page.relative_to(ROOT / "docs") for page in (ROOT / "docs").rglob("*.md")}
    assert written - {Path("README.md")} <= pages
    assert 'id="flexarm_ident.subspace.orse.past_instruments"' in (
        site / "api" / "flexarm_ident.subspace.orse.html"
    ).read_text("utf-8")
    for page in site.rglob("*.html"):
        text = page.read_text("utf-8")
        assert not re.search(r'(src|<link[^>]* href)="(https?:)?//', text), page


def test_site___folder_with_something_else___is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine", "utf-8")
    with pytest.raises(LaunchError, match="holds something else than a site"):
        build_site(ROOT, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_docs___outside_a_checkout___says_where_to_go(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv("FLEXARM_ROOT", raising=False)
    with pytest.raises(LaunchError, match=r"run \./flexarm there"):
        build_docs(tmp_path / "site")


def foxglove_paths() -> Iterator[tuple[str, str]]:
    """Yield topic and field of every curve of the layout."""
    layout = json.loads((CONFIG / "foxglove.json").read_text("utf-8"))
    for panel in layout["configById"].values():
        for path in panel.get("paths", ()):
            topic, _, field = path["value"].partition(".")
            yield topic, field


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


@pytest.mark.parametrize(("topic", "field"), sorted({*foxglove_paths(), *plotjuggler_paths()}))
def test_layouts___curve___is_a_number_of_a_message(topic: str, field: str) -> None:
    assert fields_of(topic)[field] == "double"


def test_layouts___both___show_the_same_curves() -> None:
    assert set(foxglove_paths()) == set(plotjuggler_paths())


def test_page_on_viewers___topics___have_their_types() -> None:
    text = (ROOT / "docs" / "howto" / "viewers.md").read_text("utf-8")
    assert dict(re.findall(r"^\| `(/\S+)` \| `(\S+)` \|", text, re.MULTILINE)) == TYPES
