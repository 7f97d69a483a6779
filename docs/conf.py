"""Settings of the site that `flexarm docs` builds from these pages."""  # noqa: INP001 - a folder of pages

from __future__ import annotations

import re
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = "flexarm"
copyright = "flexarm maintainers, Apache-2.0"  # noqa: A001 - Sphinx names it
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["README.md", "templates"]
templates_path = ["templates"]
# A type whose name two modules have is linked to one of them.
suppress_warnings = ["ref.python"]

myst_enable_extensions = ["html_image", "colon_fence"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
# Nobody here writes types as comments, and the search for them takes long.
autodoc_use_type_comments = False
add_module_names = False
napoleon_google_docstring = False
# Words such as "inputs" would be linked to whatever has that name.
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "code"

html_theme = "alabaster"
html_theme_options = {
    "description": "Measure, model and control a flexible arm",
    "fixed_sidebar": True,
    "page_width": "70rem",
    "show_powered_by": False,
}
html_static_path = ["static"]
html_css_files = ["flexarm.css"]
html_show_sourcelink = False
# A page that is opened from a disk asks nobody for anything.
html_use_opensearch = ""
# The same pages at any time.
html_last_updated_fmt = None

_ANCHOR = re.compile(r'^<a id="([\w-]+)"></a>$', re.MULTILINE)
_LITERAL = re.compile(r"(`+[^`]+`+)")


_METHODS_HERE = "<!-- table of methods -->"
_PARAMETERS_HERE = re.compile(r"<!-- parameters of ([\w.]+) -->")


def _with_methods(_: Sphinx, __: str, source: list[str]) -> None:
    """Put the table of the estimators where a page asks for it."""
    if _METHODS_HERE in source[0]:
        from flexarm_ident.subspace.methods import METHODS  # noqa: PLC0415 - one page needs it

        rows = [f"| `{row.name}` | {row.title} | {row.help} |" for row in METHODS.values()]
        table = ["| method | what it is | when |", "| --- | --- | --- |", *rows]
        source[0] = source[0].replace(_METHODS_HERE, "\n".join(table))


def _with_parameters(_: Sphinx, __: str, source: list[str]) -> None:
    """Put the table of a node's parameters where a page asks for it."""
    from flexarm_core.tables import as_markdown  # noqa: PLC0415 - one page needs it

    source[0] = _PARAMETERS_HERE.sub(
        lambda asked: as_markdown(import_module(asked[1]).PARAMETERS), source[0]
    )


def _with_targets(_: Sphinx, __: str, source: list[str]) -> None:
    """Turn the anchors of plain Markdown into targets that links are checked against."""
    source[0] = _ANCHOR.sub(r"(\1)=", source[0])


def _as_plain_text(*arguments: Any) -> None:  # noqa: ANN401 - as autodoc calls it
    """Let docstrings stand for themselves: |x| is a magnitude, and `x`s are several x."""
    lines: list[str] = arguments[-1]
    for number, line in enumerate(lines):
        if not line.lstrip().startswith(">>>"):
            words = _LITERAL.split(line)
            words[::2] = (word.replace("|", r"\|") for word in words[::2])
            words[2::2] = (re.sub(r"^(?=\w)", r"\\ ", word) for word in words[2::2])
            lines[number] = "".join(words)


def setup(app: Sphinx) -> None:
    """Add what the pages need beside the extensions."""
    app.connect("source-read", _with_targets)
    app.connect("source-read", _with_methods)
    app.connect("source-read", _with_parameters)
    app.connect("autodoc-process-docstring", _as_plain_text)
