"""Sections of the report: each module of this folder is one, by its `SECTION`."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexarm_ident.report.content.blocks import Section


@cache
def sections() -> tuple[Section, ...]:
    """Return all sections in the order of the report."""
    found: list[Section] = [
        import_module(f"{__name__}.{module.name}").SECTION for module in iter_modules(__path__)
    ]
    return tuple(sorted(found, key=lambda section: section.place))
