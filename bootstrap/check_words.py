"""Refuse a verb or an option that nobody knows, before minutes of set-up are spent on it.

Without any package: what is known stands in the sources, which are read and not imported. Usage:
`python bootstrap/check_words.py VERB [WORD...]`; exit code 2 with one line when something is wrong.
"""

from __future__ import annotations

import ast
import sys
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

_ROOT = Path(__file__).parents[1]
PACKAGE = _ROOT / "src" / "flexarm_bringup" / "flexarm_bringup"
PACKAGES = {PACKAGE.name: PACKAGE, "bench": _ROOT / "bench"}
"""Packages in which options of a verb stand."""
HELP = {"-h", "--help"}
HANDS_ON = ("RUN_ON", "ignore_unknown_options")
"""What a verb says that hands its words on to another program."""
ALIKE = 0.65
"""Similarity from which a word may be a misspelt one; `validate` is not `activate`."""


def main() -> str:
    """Return what is wrong with the words of the command line; nothing when they may be right."""
    verb, *words = sys.argv[1:]
    places = verbs()
    if verb not in places:
        kind = "option" if verb.startswith("-") else "verb"
        return f"no {kind} {verb}{nearest(verb, places)}: ./flexarm --help lists the verbs"
    module, _, function = places[verb].partition(":")
    file = verb_file = PACKAGE / "verbs" / f"{module.replace('.', '/')}.py"
    if verb == "bench" and words and not words[0].startswith("-"):
        benches = {"all", *assigned(file, "_BENCHES")}
        if words[0] not in benches:
            return f"no bench {words[0]}{nearest(words[0], benches)}: ./flexarm bench --help"
        # A bench has options of its own.
        file = next(PACKAGES["bench"].glob(f"*/{words[0]}.py"), file)
    if file is verb_file and hands_on(file, function):
        return ""
    known = HELP.union(*map(options, {file, *imported(file, set())}))
    for word in words:
        if word == "--":
            return ""
        name = word.partition("=")[0]
        if name.startswith("--") and name not in known:
            return f"{verb} has no option {name}{nearest(name, known)}"
    return ""


def verbs() -> dict[str, str]:
    """Return the verbs, and the function that each is."""
    groups: dict[str, dict[str, str]] = assigned(PACKAGE / "cli.py", "GROUPS")
    return {verb: place for group in groups.values() for verb, place in group.items()}


def assigned(file: Path, name: str) -> Any:  # noqa: ANN401 - whatever stands there
    """Return the literal that a file gives a name at its top."""
    for node in ast.parse(file.read_text("utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return ast.literal_eval(node.value)
    raise AssertionError(f"{file.name} has no {name}")


def hands_on(file: Path, function: str) -> bool:
    """Return whether a verb takes options that it does not know."""
    for node in ast.parse(file.read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name == function:
            decorators = " ".join(map(ast.unparse, node.decorator_list))
            return any(word in decorators for word in HANDS_ON)
    return True


def options(file: Path) -> Iterator[str]:
    """Yield the options whose names stand in a file, also those of other verbs."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield from (each for each in node.value.split("/") if each.startswith("--"))


def imported(file: Path, seen: set[Path]) -> set[Path]:
    """Return the files of our packages that a file imports, which may define options of a verb."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            package, *inner = (node.module or "").split(".")
            if package not in PACKAGES:
                continue
            path = PACKAGES[package].joinpath(*inner).with_suffix(".py")
            if path.is_file() and path not in seen:
                seen.add(path)
                imported(path, seen)
    return seen


def nearest(word: str, known: dict[str, str] | set[str]) -> str:
    """Return the nearest known word, for the end of a sentence."""
    near = get_close_matches(word, known, n=1, cutoff=ALIKE)
    return f" (nearest: {near[0]})" if near else ""


if wrong := main():
    print(f"flexarm: {wrong}; nothing was set up", file=sys.stderr)  # noqa: T201
    sys.exit(2)
