"""Import graph of the sources, drawn from their syntax trees without importing anything."""

from __future__ import annotations

import ast
from collections import defaultdict
from dataclasses import dataclass
from functools import cache, cached_property
from typing import TYPE_CHECKING

from support.project import PROJECT

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    Arrows = Mapping[str, frozenset[str]]

SOURCES = PROJECT / "src"
REPRODUCTION = PROJECT / "reproduction"
EXTRAS = PROJECT / "extras" / "flexarm_extras"


@dataclass(frozen=True)
class Module:
    """One source file.

    Attributes
    ----------
    name : str
        Dotted name; of an `__init__.py` the name of its folder.
    file : Path
        The file.
    """

    name: str
    file: Path

    @property
    def package(self) -> str:
        """First part of the name."""
        return self.name.partition(".")[0]

    @property
    def is_init(self) -> bool:
        """Whether the module is the front of its folder."""
        return self.file.name == "__init__.py"

    @property
    def folder(self) -> str:
        """Dotted name of the folder that holds the file."""
        return self.name if self.is_init else self.name.rpartition(".")[0]

    @cached_property
    def tree(self) -> ast.Module:
        """Syntax tree of the file."""
        return ast.parse(self.file.read_text("utf-8"))

    @cached_property
    def imported(self) -> frozenset[str]:
        """Dotted names that the file imports, at its top, late, or for its types only."""
        return frozenset(_imported(ast.walk(self.tree)))

    @cached_property
    def loaded(self) -> frozenset[str]:
        """Dotted names that the file imports when it runs, at its top or late."""
        return frozenset(_imported(_walk_without_types(self.tree)))


def _imported(nodes: Iterable[ast.AST]) -> Iterator[str]:
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _walk_without_types(tree: ast.AST) -> Iterator[ast.AST]:
    yield tree
    for node in ast.iter_child_nodes(tree):
        if not (isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"):
            yield from _walk_without_types(node)


@cache
def project_modules() -> tuple[Module, ...]:
    """Return the modules of every package under `src`, of the reproduction and the extras."""
    packages = sorted(
        setup.parent / setup.parent.name for setup in SOURCES.glob("flexarm_*/setup.py")
    )
    roots = [*packages, *(each for each in (REPRODUCTION, EXTRAS) if each.is_dir())]
    return tuple(
        Module(_dotted(file, root.parent), file)
        for root in roots
        for file in sorted(root.rglob("*.py"))
    )


def _dotted(file: Path, root: Path) -> str:
    parts = file.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def module_arrows(modules: tuple[Module, ...], *, types: bool = False) -> Arrows:
    """Return for each module the modules of the project that it imports.

    Parameters
    ----------
    modules : tuple of Module
        All modules.
    types : bool
        Count what is imported for its types only.
    """
    known = {module.name for module in modules}
    return {
        module.name: frozenset(
            target
            for name in (module.imported if types else module.loaded)
            if (target := _resolved(name, known)) not in {"", module.name}
        )
        for module in modules
    }


def _resolved(name: str, known: set[str]) -> str:
    """Return the module that an imported name is, or lives in; empty: no module of the project."""
    return next((each for each in (name, name.rpartition(".")[0]) if each in known), "")


def folder_arrows(modules: tuple[Module, ...]) -> Arrows:
    """Return for each folder the other folders that its modules import from.

    The front of a package gathers its public names from all rooms, so it is not part of its folder.
    """
    folder = {module.name: module.folder for module in modules if not module.is_init}
    arrows: dict[str, set[str]] = defaultdict(set)
    for name, targets in module_arrows(modules, types=True).items():
        if name in folder:
            arrows[folder[name]] |= {folder[each] for each in targets if each in folder}
    return {name: frozenset(targets - {name}) for name, targets in arrows.items()}


def circle(arrows: Arrows) -> list[str]:
    """Return one circle of the arrows as a path that ends where it begins; empty: there is none."""
    done: set[str] = set()
    path: list[str] = []

    def visit(name: str) -> list[str]:
        if name in path:
            return [*path[path.index(name) :], name]
        if name in done:
            return []
        path.append(name)
        for target in sorted(arrows.get(name, ())):
            if found := visit(target):
                return found
        path.pop()
        done.add(name)
        return []

    for start in sorted(arrows):
        if found := visit(start):
            return found
    return []


def longest_chain(arrows: Arrows, members: frozenset[str]) -> list[str]:
    """Return the longest path of arrows among the members; their graph has no circle."""
    longest: dict[str, list[str]] = {}

    def below(name: str) -> list[str]:
        if name not in longest:
            chains = [below(each) for each in sorted(arrows[name] & members)]
            longest[name] = [name, *max(chains, key=len, default=[])]
        return longest[name]

    return max((below(name) for name in sorted(members)), key=len, default=[])
