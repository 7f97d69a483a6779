"""Words that complete a command line, found without importing what the verbs need."""

from __future__ import annotations

import ast
import re
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from click.shell_completion import CompletionItem

from flexarm_core.bounds import yaml_content

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

_BAG_FILES = ("metadata.yaml", "*.mcap", "*.db3")
_TABLES = {
    "daq": ("flexarm_daq", "nodes/daq.yaml"),
    "controller": ("flexarm_control", "controller.yaml"),
    "experiment": ("flexarm_daq", "nodes/experiment.yaml"),
    "recorder": ("flexarm_daq", "nodes/recorder.yaml"),
    "ident": ("flexarm_ident", "ident.yaml"),
    "player": ("flexarm_daq", "nodes/player.yaml"),
}
"""Tables of the parameters of each node."""


def completed(verb: str, given: Sequence[str], start: str) -> list[CompletionItem] | None:
    """Return what may stand next on a line; None when the verb itself has to be asked.

    Parameters
    ----------
    verb : str
        Verb of the line.
    given : sequence of str
        Complete words after the verb.
    start : str
        Begin of the word that is being written.
    """
    words = _ARGUMENTS.get(verb) if not start.startswith("-") else None
    if given:
        words = _OPTIONS.get(given[-1], words)
    if words is None:
        return None
    found = [CompletionItem(word) for word in words(given, start) if word.startswith(start)]
    # What is not a bag yet, such as a folder of them, is left to the shell.
    return found or [CompletionItem(start, type="file")]


def bags(_: Sequence[str], start: str) -> Iterator[str]:
    """Yield the bags whose paths begin with a text, also one folder further down."""
    folder = Path(start.rpartition("/")[0] or ".")
    for pattern in ("*", "*/*"):
        for path in sorted(folder.glob(pattern)):
            if path.is_dir() and any(any(path.glob(name)) for name in _BAG_FILES):
                yield str(path)


def experiments(_: Sequence[str], __: str) -> Iterator[str]:
    """Yield the names of the catalogue."""
    text = _file_of("flexarm_daq", "experiments/catalogue.yaml").read_text("utf-8")
    yield from re.findall(r"^(\w+): \{", text, re.MULTILINE)


def laws(_: Sequence[str], __: str) -> Iterator[str]:
    """Yield the names of the control laws."""
    tree = ast.parse(_file_of("flexarm_control", "laws/registry.py").read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "LawSpec":
            names = (*node.args[:1], *(each.value for each in node.keywords if each.arg == "name"))
            yield from (str(name.value) for name in names if isinstance(name, ast.Constant))


def managed(_: Sequence[str], __: str) -> Iterator[str]:
    """Yield the nodes with a lifecycle."""
    yield from ("daq", "controller", "experiment")


def settings(given: Sequence[str], _: str) -> Iterator[str]:
    """Yield the nodes, and behind a node its parameters with the sign of an assignment."""
    if not given:
        yield from _TABLES
    elif given[0] in _TABLES:
        table: Any = yaml_content(_file_of(*_TABLES[given[0]]).read_text("utf-8"))
        for content in table.values():
            yield from (f"{name}=" for name in _leaves(content, ""))


def _leaves(table: dict[str, Any], prefix: str) -> Iterator[str]:
    """Yield the names of the parameters in a table of parameters and groups."""
    for name, row in table.items():
        # Rows for each model or law, whose names are not in the table, begin so.
        if isinstance(row, dict) and not name.startswith("__map"):
            yield from ((f"{prefix}{name}",) if "type" in row else _leaves(row, f"{prefix}{name}."))


def _file_of(package: str, path: str) -> Path:
    """Return a file of a package, which is not imported for it."""
    spec = find_spec(package)
    return Path(str(spec and spec.origin)).parent / path


_ARGUMENTS: dict[str, Callable[[Sequence[str], str], Iterator[str]]] = {
    **dict.fromkeys(("experiment", "catalogue"), experiments),
    **dict.fromkeys(("activate", "deactivate"), managed),
    "set": settings,
    **dict.fromkeys(("identify", "report", "replay", "play", "tune"), bags),
}
_OPTIONS = {"--law": laws}
