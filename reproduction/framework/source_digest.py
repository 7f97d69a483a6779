"""A digest of the source that a function's result comes from.

A kept result counts as long as this digest is the same. The walk goes from name to name: the
definition of the function, what that uses, and so on, through the packages of the project. So a
change of a node, of a plot or of another chapter throws nothing away. Comments, docstrings and
layout do not count. A definition that opens the files of its package counts with all of them.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import platform
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

PROJECT = ("flexarm_", "reproduction.")
"""What the names of the project's packages begin with."""
_LIBRARIES = ("numpy", "scipy", "numba", "control")
_READS_FILES = "files"
_DATA = "*.yaml"
_WHOLE = ""

_Place = tuple[str, str]


@dataclass(frozen=True)
class _Module:
    """The top level of a module.

    Attributes
    ----------
    defined
        Statements by the names that they bind.
    loose
        Statements that bind none and so belong to every name.
    """

    path: Path
    defined: dict[str, list[ast.stmt]]
    loose: list[ast.stmt]


def source_digest(function: Callable[..., Any]) -> str:
    """Return a digest of all source that a function's result comes from, and of the libraries.

    Parameters
    ----------
    function
        At the top level of a module. One from outside the project has no source here.
    """
    return _digest(function.__module__, function.__qualname__)


@cache
def _digest(module: str, name: str) -> str:
    places, data = _reached((module, name))
    digest = hashlib.sha256(repr((platform.python_version_tuple()[:2], _versions())).encode())
    for place in sorted(places):
        digest.update(repr((place, _text(place))).encode())
    # Not by their folders: the same package may lie elsewhere on another machine.
    for name_and_bytes in sorted((path.name, path.read_bytes()) for path in data):
        digest.update(repr(name_and_bytes).encode())
    return digest.hexdigest()


@cache
def _versions() -> tuple[str, ...]:
    return tuple(version(library) for library in _LIBRARIES)


def _reached(start: _Place) -> tuple[set[_Place], set[Path]]:
    """Return every definition that is used, and every data file."""
    found: set[_Place] = set()
    data: set[Path] = set()
    waiting = [start] if start[0].startswith(PROJECT) else []
    while waiting:
        place = waiting.pop()
        if place in found:
            continue
        found.add(place)
        used = _used(place)
        waiting += used
        if (place[0], _READS_FILES) in used:
            data.update(_module(place[0]).path.parent.rglob(_DATA))
    return found, data


@cache
def _used(place: _Place) -> frozenset[_Place]:
    """Return what a definition uses directly."""
    defined = _module(place[0]).defined
    return frozenset(
        (owner, name)
        for statement in _statements(place)
        for owner, name in _mentioned(statement, place[0])
        if owner != place[0] or name in defined
    )


def _statements(place: _Place) -> list[ast.stmt]:
    module = _module(place[0])
    if place[1] == _WHOLE:
        return [each for statements in module.defined.values() for each in statements]
    return module.defined.get(place[1], []) + module.loose


@cache
def _text(place: _Place) -> str:
    return "\n".join(map(ast.dump, _statements(place)))


@cache
def _module(name: str) -> _Module:
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        raise ValueError(f"no source of {name}")
    path = Path(spec.origin)
    defined: dict[str, list[ast.stmt]] = {}
    loose = []
    for statement in _without_docstrings(ast.parse(path.read_bytes())).body:
        names = set(_bound(statement))
        for bound in names:
            defined.setdefault(bound, []).append(statement)
        if not names:
            loose.append(statement)
    return _Module(path, defined, loose)


def _without_docstrings(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            kept = [each for each in body if not _is_text(each) and not _is_for_types(each)]
            node.body = kept  # type: ignore[attr-defined]  # a node with a body
    return tree


def _is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _is_for_types(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.If) and ast.unparse(statement.test) == "TYPE_CHECKING"


def _bound(statement: ast.stmt) -> Iterator[str]:
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        yield statement.name
    elif isinstance(statement, ast.Import | ast.ImportFrom):
        for alias in statement.names:
            yield alias.asname or alias.name.partition(".")[0]
    elif isinstance(statement, ast.If | ast.Try):
        for inner in ast.iter_child_nodes(statement):
            if isinstance(inner, ast.stmt):
                yield from _bound(inner)
    else:
        for node in ast.walk(statement):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                yield node.id


def _mentioned(statement: ast.stmt, module: str) -> Iterator[_Place]:
    """Give the names in a statement, as of its own module, and what it imports."""
    for node in ast.walk(statement):
        if isinstance(node, ast.Name):
            yield module, node.id
        elif isinstance(node, ast.Import):
            for alias in node.names:
                yield from _imported(alias.name, _WHOLE)
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield from _imported(node.module or "", alias.name)


def _imported(module: str, name: str) -> Iterator[_Place]:
    if not module.startswith(PROJECT):
        return
    owner = _module(module)
    is_module = name not in owner.defined and owner.path.name == "__init__.py" and name != _WHOLE
    yield (f"{module}.{name}", _WHOLE) if is_module else (module, name)
