"""Late front of a package: a public name loads its module when somebody asks for it.

A front that imported all of its names would load every room of the package, with its libraries, for
a verb or a node that needs one of them.
"""

from __future__ import annotations

import ast
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


def late(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the functions `__getattr__` and `__dir__` of a package's front.

    The names are those that the front imports for the type checker.

    Parameters
    ----------
    package : str
        `__name__` of the front.
    file : str
        Its `__file__`.

    Examples
    --------
    ::

        if TYPE_CHECKING:
            from package.room.module import function
        else:
            __getattr__, __dir__ = late(__name__, __file__)
    """

    @cache
    def places() -> dict[str, tuple[str, str]]:
        return {
            alias.asname or alias.name: (node.module, alias.name)
            for node in ast.walk(ast.parse(Path(file).read_text("utf-8")))
            if isinstance(node, ast.ImportFrom) and node.module
            for alias in node.names
        }

    def get(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
        if name not in places():
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, own_name = places()[name]
        value = getattr(import_module(module), own_name)
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *places()})

    return get, names
