"""The site of the pages: it builds, and it is read from a disk, on a phone, in the dark."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from docs.pages import build_site
from flexarm_core.outputs import is_replaceable
from support.project import PROJECT

if TYPE_CHECKING:
    from support.browser import Browser

pytestmark = [
    pytest.mark.slow,
    # The build of all takes minutes of a free core, and may have a tenth of one.
    pytest.mark.timeout(2700),
    pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::PendingDeprecationWarning"),
]
DOCS = PROJECT / "docs"
ORSE = "api/flexarm_ident.subspace.orse.html"
PACKAGES = re.compile(r"   flexarm_\w+\n")
# The home page, long output, wide tables, signatures.
PAGES = ("index.html", "tutorial.html", "parameters.html", "reproduction/chapter-2.html", ORSE)
# Boxes in the text that hold more than they show, and those of them that the keyboard reaches.
SCROLLING = """[...document.querySelectorAll("pre, .table-wrapper")]
  .filter((box) => box.scrollWidth > box.clientWidth)"""
TOO_WIDE = """["html", ".content"].map((name) => document.querySelector(name))
  .filter((box) => box.scrollWidth > box.clientWidth).map((box) => box.className)"""
GROUND = "getComputedStyle(document.body).backgroundColor"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Site of all pages with the reference of one room, and the warnings of its build."""
    root = tmp_path_factory.mktemp("docs")
    shutil.copytree(DOCS, root / "docs")
    (root / "src").symlink_to(PROJECT / "src")
    index = root / "docs" / "api" / "index.rst"
    text = PACKAGES.sub("", index.read_text("utf-8"))
    index.write_text(f"{text}   flexarm_ident.subspace\n", "utf-8")
    return root / "site", build_site(root, root / "site")


@pytest.mark.exhaustive
def test_site___reference_of_every_package___builds_without_a_warning(tmp_path: Path) -> None:
    assert build_site(PROJECT, tmp_path / "site") == ""


@pytest.fixture
def site(built: tuple[Path, str]) -> Path:
    return built[0]


def test_site___pages_of_the_checkout___build_without_a_warning(built: tuple[Path, str]) -> None:
    site, warnings = built
    assert warnings == ""
    assert is_replaceable(site / ".buildinfo")
    pages = {page.relative_to(site).with_suffix(".md") for page in site.rglob("*.html")}
    written = {page.relative_to(DOCS) for page in DOCS.rglob("*.md")}
    assert written - {Path("README.md")} <= pages


def test_site___tables_and_reference___are_filled_from_the_sources(site: Path) -> None:
    reference = (site / ORSE).read_text("utf-8")
    assert 'id="flexarm_ident.subspace.orse.past_instruments"' in reference
    tables = (site / "parameters.html").read_text("utf-8")
    for name in ("position_bound_v", "pdpc.kp", "autostart", "snapshot_mode", "exports"):
        assert f">{name}<" in tables


def test_site___every_page___names_no_file_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text("utf-8")
        assert not re.search(r'(src|<link[^>]* href)="(https?:)?//', text), page


@pytest.mark.parametrize("page", PAGES)
def test_page___from_a_disk_on_a_phone___scrolls_in_its_boxes_and_asks_nobody(
    browser: Browser, site: Path, page: str
) -> None:
    browser.open((site / page).as_uri(), width=400)
    browser.wait_for(f"{SCROLLING}.every((box) => box.tabIndex === 0)")
    assert browser.ask(TOO_WIDE) == []
    assert browser.console == []
    assert [asked for asked in browser.requests if not asked.startswith(("file:", "data:"))] == []


def test_search___from_a_disk___finds_pages_without_a_word_in_the_console(
    browser: Browser, site: Path
) -> None:
    browser.open(f"{(site / 'search.html').as_uri()}?q=stabilisation")
    browser.wait_for("document.querySelector('#search-results a[href*=identification]') !== null")
    assert browser.console == []


def test_theme___by_the_system_and_by_its_button___turns_the_pictures_with_the_ground(
    browser: Browser, site: Path
) -> None:
    picture = "getComputedStyle(document.querySelector('article img[src$=svg]')).filter"
    address = (site / "index.html").as_uri()
    browser.open(address)
    light, as_drawn = browser.ask(GROUND), browser.ask(picture)
    browser.open(address, dark=True)
    dark, turned = browser.ask(GROUND), browser.ask(picture)
    assert light == "rgb(255, 255, 255)" != dark
    assert as_drawn == "none" != turned
    browser.click(".theme-toggle-content button")
    assert (browser.ask(GROUND), browser.ask(picture)) == (light, as_drawn)


def test_code___of_a_page___is_copied_without_its_prompts(browser: Browser, site: Path) -> None:
    browser.open((site / "units.html").as_uri())
    browser.wait_for("document.querySelector('.copybtn') !== null")
    browser.ask("void addEventListener('copy', (event) => { window.copied = event.target.value; })")
    browser.ask("document.querySelector('pre:has(.gp) + .copybtn').id = 'first'")
    browser.click("#first")
    browser.wait_for("window.copied !== undefined")
    typed = browser.ask("window.copied").splitlines()
    assert typed[0].startswith(("import ", "from "))
    assert not any(line.startswith((">>>", "[")) for line in typed)
