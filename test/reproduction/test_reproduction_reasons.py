"""Figures in a reason are computed: its constant text has none."""

from __future__ import annotations

import ast
import re
from typing import TYPE_CHECKING

import pytest
import yaml

from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

STUDY = PROJECT / "reproduction"
PLACE = re.compile(r"\{[^}]*\}")
PARTS = ("kept", "left_out", "leaving")
"""Texts that reasons are put together from."""


def constants_of_reasons(module: Path) -> Iterator[str]:
    """Yield the constant text of `reason=...`, and of functions whose name ends in a reason."""
    for node in ast.walk(ast.parse(module.read_text("utf-8"))):
        if (isinstance(node, ast.keyword) and node.arg == "reason") or (
            isinstance(node, ast.FunctionDef) and node.name in ("_reason", "_other_cost")
        ):
            yield from _constants(node)


def _constants(node: ast.AST) -> Iterator[str]:
    formats = {
        id(part)
        for each in ast.walk(node)
        if isinstance(each, ast.FormattedValue) and each.format_spec
        for part in ast.walk(each.format_spec)
    }
    # The name of a text is not a text.
    keys = {
        id(argument)
        for each in ast.walk(node)
        if isinstance(each, ast.Call)
        and isinstance(each.func, ast.Name)
        and each.func.id == "prose"
        for argument in ast.walk(each.args[0])
    }
    for each in ast.walk(node):
        if not isinstance(each, ast.Constant) or id(each) in formats | keys:
            continue
        if isinstance(each.value, str):
            yield each.value


@pytest.mark.parametrize("module", sorted(STUDY.rglob("*.py")), ids=lambda path: path.stem)
def test_reasons_in_the_code___have_no_digits_of_their_own(module: Path) -> None:
    for text in constants_of_reasons(module):
        assert not re.search(r"\d", text), text


@pytest.mark.parametrize(
    "page", sorted((STUDY / "texts").glob("*.yaml")), ids=lambda path: path.stem
)
def test_reasons_on_the_pages___have_no_digits_of_their_own(page: Path) -> None:
    for key, parts in yaml.safe_load(page.read_text("utf-8")).items():
        for name, text in parts.items():
            if name == "reason" or name in PARTS:
                assert not re.search(r"\d", PLACE.sub("", text)), f"{key}: {text}"


def test_the_check___finds_a_digit(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text('judged(reason=f"off by {gap:.1f} dB from 1 to 6 Hz", evidence="3")')
    assert list(constants_of_reasons(module)) == ["off by ", " dB from 1 to 6 Hz"]
