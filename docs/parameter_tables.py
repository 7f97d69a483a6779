"""Tables of the page on parameters, from those that the nodes declare.

`./flexarm exec python docs/parameter_tables.py` writes them anew.
"""  # noqa: INP001 - a folder of pages

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

from flexarm_core.tables import as_markdown

PAGE = Path(__file__).with_name("parameters.md")
_TABLE = re.compile(
    r"(?P<begin><!-- parameters of (?P<module>[\w.]+) -->\n).*?(?=<!-- end -->)", re.DOTALL
)


def with_tables(page: str) -> str:
    """Return a page with the table of a node wherever it names the module of one."""
    return _TABLE.sub(
        lambda found: f"{found['begin']}{as_markdown(import_module(found['module']).PARAMETERS)}\n",
        page,
    )


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text("utf-8")), "utf-8")
