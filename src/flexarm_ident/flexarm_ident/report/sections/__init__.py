"""Sections of the report: each module of this folder holds one or more."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from flexarm_ident.report.content.blocks import Section


@cache
def sections() -> tuple[Section, ...]:
    """Return all sections in the order of the report."""
    modules = [import_module(f"{__name__}.{module.name}") for module in iter_modules(__path__)]
    held = (each for module in modules for each in vars(module).values())
    found = [each for each in held if isinstance(each, Section)]
    return tuple(sorted(found, key=lambda section: section.place))
