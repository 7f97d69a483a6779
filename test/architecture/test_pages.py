"""Files and modules that the pages name, beside the files that there are."""

from __future__ import annotations

import re
import shlex
import subprocess
from typing import TYPE_CHECKING

import click
import pytest

from docs.pages import plain_blocks, steps
from flexarm_bringup.cli import main
from support.import_graph import project_modules
from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path

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


def test_pages_on_the_front___links___lead_to_files_and_headings() -> None:
    """Those of docs are checked when the site is built."""
    missing = []
    for page in PROJECT.glob("*.md"):
        for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text("utf-8")):
            path, _, anchor = target.partition("#")
            if "://" not in target and not leads_to(PROJECT / path, anchor):
                missing.append(f"{page.name}: {target}")
    assert missing == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PROJECT)))
def test_page___commands_of_flexarm___have_verbs_and_options_that_exist(page: Path) -> None:
    """Those with a prompt are run when the site is built; the others are read here."""
    text = page.read_text("utf-8")
    lines = [line for _, line in plain_blocks(text)]
    lines += [command for step in steps(text) for command in step.commands]
    for command in re.split(r"\n|; (?=\./)", "\n".join(lines)):
        if command.startswith("./flexarm "):
            read_as_typed(shlex.split(command)[1:])


def read_as_typed(words: list[str]) -> None:
    """Read a command line up to its options; what they name need not be there."""
    command: click.Command | None = main
    while isinstance(command, click.Group) and not words[0].startswith("-"):
        _, command, words = command.resolve_command(click.Context(command), words)
    assert command is not None
    context = click.Context(command, **command.context_settings)
    command.make_parser(context).parse_args(list(words))


def leads_to(file: Path, anchor: str) -> bool:
    """Return whether there is a file, with a heading of that anchor if one is given."""
    if not anchor:
        return file.exists()
    headings = re.findall(r"^#+ (.+)$", file.read_text("utf-8"), re.MULTILINE)
    return anchor in {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


def prose(page: Path) -> list[str]:
    """Return the lines of a page without commands and output, tables, pictures and headings."""
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.MULTILINE | re.DOTALL)
    return [
        line for line in text.splitlines() if not line.startswith(("    ", "|", "![", "<", "#"))
    ]


@pytest.mark.parametrize(
    "page", [each for each in PAGES if each.name != "CHANGELOG.md"], ids=lambda page: page.stem
)
def test_lines_of_prose___have_at_most_120_characters(page: Path) -> None:
    assert [line for line in prose(page) if len(line) > 120] == []


def test_readme___is_short() -> None:
    assert len((PROJECT / "README.md").read_text("utf-8").splitlines()) <= 120


def test_readme___counts_of_the_reproduction___are_those_of_its_page() -> None:
    page = (PROJECT / "docs" / "reproduction" / "index.md").read_text("utf-8")
    row = re.findall(r"^\| all \|(.+)\|$", page, re.MULTILINE)[0]
    agree, constructed, same, partly, differ, impossible, elsewhere, _ = map(int, row.split("|"))
    kinds = re.findall(r"^\| all \| (\d+) of (\d+) kinds", page, re.MULTILINE)[0]
    comparisons = agree + constructed + same + partly + differ + impossible
    words = (
        f"in {comparisons} comparisons ({elsewhere} further subjects refer to one of these)",
        f"{agree} agree and {constructed} more by construction",
        f"{same} come to the same conclusions with other figures, {partly} agree in part",
        f"{differ} differ and {impossible} are not comparable",
        "Of {1} kinds of figures {0} agree".format(*kinds),
    )
    text = " ".join((PROJECT / "README.md").read_text("utf-8").split())
    assert [each for each in words if each not in text] == []


def known(name: str, modules: set[str]) -> bool:
    """Return whether a dotted name is a module, or a name in one."""
    return name in modules or name.rpartition(".")[0] in modules
