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
MODULES = sorted(STUDY.rglob("*.py"))
PLACE = re.compile(r"\{[^}]*\}")


def pieces_of_reasons(module: Path) -> list[ast.AST]:
    """Return what a module gives as a reason, and its functions that this calls, however deep."""
    nodes = list(ast.walk(ast.parse(module.read_text("utf-8"))))
    functions = {node.name: node for node in nodes if isinstance(node, ast.FunctionDef)}
    todo: list[ast.AST] = list(filter(None, map(reason_in, nodes)))
    pieces: list[ast.AST] = []
    while todo:
        pieces.append(todo.pop())
        called = functions.keys() & {name_of(call) for call in calls_in(pieces[-1])}
        todo.extend(functions.pop(name) for name in called)
    return pieces


def reason_in(node: ast.AST) -> ast.AST | None:
    if isinstance(node, ast.FunctionDef):
        return node if node.name.endswith("_reason") else None
    if isinstance(node, ast.Assign):
        named = any(isinstance(each, ast.Name) and each.id == "reason" for each in node.targets)
        return node.value if named else None
    return node.value if isinstance(node, ast.keyword) and node.arg == "reason" else None


def calls_in(piece: ast.AST) -> Iterator[ast.Call]:
    return (node for node in ast.walk(piece) if isinstance(node, ast.Call))


def name_of(call: ast.Call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else ""


def constants_of_reasons(module: Path) -> Iterator[str]:
    """Yield the constant text of a module's reasons, without formats and the names of texts."""
    for piece in pieces_of_reasons(module):
        silent = {
            id(part)
            for each in ast.walk(piece)
            if isinstance(each, ast.FormattedValue) and each.format_spec
            for part in ast.walk(each.format_spec)
        } | {id(part) for name in names_of_texts(piece) for part in ast.walk(name)}
        for each in ast.walk(piece):
            is_text = isinstance(each, ast.Constant) and isinstance(each.value, str)
            if is_text and id(each) not in silent:
                yield ast.literal_eval(each)


def names_of_texts(piece: ast.AST) -> list[ast.expr]:
    return [call.args[0] for call in calls_in(piece) if name_of(call) == "prose"]


def texts_of_reasons() -> set[str]:
    """Return the keys of the texts that reasons are made of: what stands in braces is any word."""
    written = {
        # Without the quotes, and the f before them; a name may begin with f itself.
        ast.unparse(name).removeprefix("f")[1:-1]
        for module in MODULES
        for piece in pieces_of_reasons(module)
        for name in names_of_texts(piece)
    }
    patterns = [re.compile(r"[\w-]+".join(map(re.escape, PLACE.split(each)))) for each in written]
    return {key for key in texts() if any(pattern.fullmatch(key) for pattern in patterns)}


def texts() -> dict[str, str]:
    pages = (yaml.safe_load(page.read_text("utf-8")) for page in (STUDY / "texts").glob("*.yaml"))
    return {
        f"{subject}.{part}": text
        for page in pages
        for subject, parts in page.items()
        for part, text in parts.items()
    }


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.stem)
def test_reasons_in_the_code___have_no_digits_of_their_own(module: Path) -> None:
    for text in constants_of_reasons(module):
        assert not re.search(r"\d", text), text


@pytest.mark.parametrize("key", sorted(texts_of_reasons()))
def test_reasons_on_the_pages___have_no_digits_of_their_own(key: str) -> None:
    assert not re.search(r"\d", PLACE.sub("", texts()[key]))


def test_texts_of_reasons___are_all_that_have_the_name_and_what_goes_into_them() -> None:
    named = {key for key in texts() if key.endswith(".reason")}
    parts = ("kept", "left_out", "correlation")
    into_them = {
        "chapter-2.leaving",
        *(f"table-3-x-parts.{part}" for part in parts),
    }
    assert named | into_them <= texts_of_reasons()


def test_modules_that_judge___have_reasons() -> None:
    judging = [
        module
        for module in MODULES
        if any(name_of(call) == "judged" for call in calls_in(ast.parse(module.read_text("utf-8"))))
    ]
    assert judging
    for module in judging:
        assert pieces_of_reasons(module), module


def test_the_check___finds_a_digit_in_the_reason_and_in_what_it_calls(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        'judged(reason=words(gap), evidence="3")\n'
        "def words(gap):\n"
        '    return f"off by {gap:.1f} dB from 1 to 6 Hz" + prose("table-2-1.reason")\n'
    )
    assert list(constants_of_reasons(module)) == ["off by ", " dB from 1 to 6 Hz"]
