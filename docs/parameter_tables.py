"""Tables of the page on parameters, from those that the nodes declare.

`./flexarm exec python docs/parameter_tables.py` writes them anew.
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.specs import ParameterSpec

PAGE = Path(__file__).with_name("parameters.md")
_TABLE = re.compile(
    r"(?P<begin><!-- parameters of (?P<module>[\w.]+) -->\n).*?(?=<!-- end -->)", re.DOTALL
)


_TYPES = {"bool": "bool", "int": "int", "float": "double", "str": "string"}


def as_markdown(specs: Sequence[ParameterSpec]) -> str:
    """Return a table of parameters for a page: name, type, default, range, changes and meaning."""
    head = ["| parameter | type | default | range | a change acts | meaning |", f"|{' --- |' * 6}"]
    return "\n".join([*head, *map(_row, specs)])


def _row(spec: ParameterSpec) -> str:
    has_range = spec.minimum is not None or spec.maximum is not None
    allowed = spec.range_text if has_range else ", ".join(f"`{each}`" for each in spec.choices)
    listed = isinstance(spec.default, list)
    one = spec.default[0] if listed else spec.default
    kind = _TYPES[type(one).__name__] + "_array" * listed
    name, acts = f"`{spec.name}`", spec.change_acts
    return f"| {' | '.join((name, kind, _shown(spec), allowed, acts, spec.description))} |"


def _shown(spec: ParameterSpec) -> str:
    if isinstance(spec.default, bool):
        return str(spec.default).lower()
    if isinstance(spec.default, list):
        return ", ".join(f"{each:g}" if isinstance(each, float) else each for each in spec.default)
    if isinstance(spec.default, float):
        return f"{spec.default:g}"
    return str(spec.default)


def with_tables(page: str) -> str:
    """Return a page with the table of a node wherever it names the module of one."""
    return _TABLE.sub(
        lambda found: f"{found['begin']}{as_markdown(import_module(found['module']).PARAMETERS)}\n",
        page,
    )


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text("utf-8")), "utf-8")
