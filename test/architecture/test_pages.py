"""Files and modules that the pages name, beside the files that there are."""

from __future__ import annotations

import re
import subprocess

from support.import_graph import project_modules
from support.project import PROJECT

PAGES = sorted(
    page
    for page in (*PROJECT.glob("*.md"), *(PROJECT / "docs").rglob("*.md"))
    if "reproduction" not in page.parts
)
# Files that the reader of a page writes.
WRITTEN = {"validate.py", "step.py", "weigh.py", "my_script.py"}


def named(pattern: str) -> dict[str, set[str]]:
    """Return for each page what a pattern catches between backticks."""
    return {page.name: set(re.findall(rf"`{pattern}`", page.read_text("utf-8"))) for page in PAGES}


def test_pages___name___only_files_that_exist() -> None:
    files = subprocess.run(
        ["git", "ls-files"],  # noqa: S607 - any git
        cwd=PROJECT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    ends = {
        "/".join(file.split("/")[start:]) for file in files for start in range(file.count("/") + 1)
    }
    missing = {
        page: unknown
        for page, paths in named(r"([\w./]+\.py)").items()
        if (unknown := paths - ends - WRITTEN)
    }
    assert missing == {}


def test_pages___name___only_modules_that_exist() -> None:
    modules = {module.name for module in project_modules()}
    missing = {
        page: unknown
        for page, names in named(r"(flexarm_\w+(?:\.\w+)+)").items()
        if (unknown := {name for name in names if not known(name, modules)})
    }
    assert missing == {}


def known(name: str, modules: set[str]) -> bool:
    """Return whether a dotted name is a module, or a name in one."""
    return name in modules or name.rpartition(".")[0] in modules
