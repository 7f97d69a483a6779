"""Sizes of files and folders, their titles, and tests beside each folder."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

from support.import_graph import SOURCES, project_modules
from support.project import PROJECT

MODULES = project_modules()
MOST_LINES = 500
MOST_MODULES = 20
# A title names a thing; these words begin a question or half a sentence.
NO_TITLE = {"What", "How", "Whether", "Where", "Why", "Which", "When"}
UNIT_TESTS = PROJECT / "test" / "unit"
# Test folders of what stands beside the packages.
BESIDE = {"bench", "extras", "extras/gym"}


def test_files___are___at_most_500_lines_long() -> None:
    lengths = {
        str(file.relative_to(PROJECT)): len(file.read_text("utf-8").splitlines())
        for folder in ("src", "extras", "reproduction", "bench", "examples", "test")
        for file in (PROJECT / folder).rglob("*.py")
    }
    assert {file: lines for file, lines in lengths.items() if lines > MOST_LINES} == {}


def test_folders___hold___at_most_20_modules() -> None:
    count = Counter(module.folder for module in MODULES if not module.is_init)
    assert {folder: modules for folder, modules in count.items() if modules > MOST_MODULES} == {}


def test_modules___begin___with_a_title() -> None:
    titles = {
        module.name: (ast.get_docstring(module.tree) or "").partition("\n")[0] for module in MODULES
    }
    wrong = {
        name: title
        for name, title in titles.items()
        if not title.endswith(".") or title.partition(" ")[0] in NO_TITLE
    }
    assert wrong == {}


def rooms() -> set[Path]:
    """Return the folders of modules as their tests' folders are named."""
    return {
        Path(package.removeprefix("flexarm_"), *inner)
        for module in MODULES
        if not module.is_init and SOURCES in module.file.parents
        for package, *inner in [module.folder.split(".")]
    }


def test_unit_tests___folders___mirror_the_sources() -> None:
    tested = {file.parent.relative_to(UNIT_TESTS) for file in UNIT_TESTS.rglob("test_*.py")}
    tested -= {Path(), *map(Path, BESIDE)}
    assert sorted(tested - rooms()) == []
    # A room inside a room may be tested in the folder of the outer one.
    untested = {room for room in rooms() if not {room, *room.parents[:-2]} & tested}
    assert sorted(untested) == []
