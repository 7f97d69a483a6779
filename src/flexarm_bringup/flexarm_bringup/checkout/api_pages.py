"""Pages of the API reference: one per package with its modules, one with all interfaces."""

from __future__ import annotations

import ast
import inspect
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

PACKAGES = (
    "flexarm_core",
    "flexarm_bags",
    "flexarm_ident",
    "flexarm_control",
    "flexarm_daq",
    "flexarm_node",
)
_KINDS = (("msg", "Messages"), ("srv", "Services"), ("action", "Actions"))


def write_api_pages(sources: Path, folder: Path) -> None:
    """Write the pages that Sphinx turns into the reference.

    Parameters
    ----------
    sources
        The folder of the packages' sources.
    folder
        Where ``index.md``, ``interfaces.md`` and a page per package and module are written.
    """
    folder.mkdir(parents=True)
    (folder / "interfaces.md").write_text(_interfaces(sources / "flexarm_msgs"), "utf-8")
    for package in PACKAGES:
        modules = _modules(sources / package / package)
        (folder / f"{package}.md").write_text(_package_page(package, modules), "utf-8")
        for name in modules:
            (folder / f"{name}.rst").write_text(_module_page(name), "utf-8")
    contents = toctree(["interfaces", *PACKAGES], hidden=False)
    (folder / "index.md").write_text(f"# API reference\n\n{contents}", "utf-8")


def _modules(folder: Path) -> dict[str, str]:
    """Return the docstrings of the public modules of a package by their names."""
    paths = sorted(path for path in folder.rglob("*.py") if not path.stem.startswith("_"))
    return {
        ".".join(path.relative_to(folder.parent).with_suffix("").parts): ast.get_docstring(
            ast.parse(path.read_text("utf-8"))
        )
        or ""
        for path in paths
    }


def _package_page(package: str, modules: dict[str, str]) -> str:
    imported = import_module(package)
    parts = [f"# {package}\n\n{inspect.getdoc(imported)}\n"]
    exported = [getattr(imported, name) for name in getattr(imported, "__all__", ())]
    # A constant does not know where it comes from; it stands on the page of its module.
    documented = {
        f"~{each.__module__}.{each.__name__}": inspect.getdoc(each) or ""
        for each in exported
        if hasattr(each, "__name__")
    }
    if documented:
        parts.append(f"What `from {package} import ...` gives:\n\n{_table(documented)}")
    parts.append(f"## Modules\n\n{_table(modules)}")
    parts.append(toctree(modules, hidden=True))
    return "\n".join(parts)


def _module_page(name: str) -> str:
    return f"{name}\n{'=' * len(name)}\n\n.. automodule:: {name}\n   :members:\n"


def _table(docstrings: dict[str, str]) -> str:
    lines = ("| | |", "| --- | --- |", *(_row(*each) for each in docstrings.items()))
    return "\n".join(lines) + "\n"


def _row(name: str, docstring: str) -> str:
    summary = " ".join(docstring.partition("\n\n")[0].split()).replace("|", "\\|")
    return f"| {{py:obj}}`{name}` | {summary} |"


def toctree(entries: Iterable[str], *, hidden: bool) -> str:
    """Return the lines that put pages below the one on which they stand.

    Parameters
    ----------
    entries
        The pages, from the folder of the page, without their suffix.
    hidden
        Whether they show in the navigation only.
    """
    options = [":maxdepth: 1", *([":hidden:"] if hidden else [])]
    return "\n".join(("```{toctree}", *options, "", *entries, "```", ""))


def _interfaces(folder: Path) -> str:
    return "\n".join(_interface_lines(folder))


def _interface_lines(folder: Path) -> Iterator[str]:
    yield "# Messages, services, actions\n"
    yield "Package `flexarm_msgs`, as written. Units stand in the names: [units](../units.md).\n"
    for kind, title in _KINDS:
        yield f"## {title}\n"
        for path in sorted((folder / kind).glob(f"*.{kind}")):
            yield f"### flexarm_msgs/{kind}/{path.stem}\n"
            yield f"```text\n{path.read_text('utf-8').strip()}\n```\n"
