"""Settings of the site that `flexarm docs` builds from these pages."""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING, Any

from sphinx.domains.python import PythonDomain
from sphinx.pycode.parser import Parser

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = "flexarm"
copyright = "flexarm maintainers, Apache-2.0"  # noqa: A001 - Sphinx names it
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
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
# These come with a ROS 2 installation, not with the wheels.
autodoc_mock_imports = ["control_msgs", "trajectory_msgs"]
# Nobody here writes types as comments, and the search for them takes long.
autodoc_use_type_comments = False
# Nor does anything here ask for the lines of a definition, which are a seventh of the whole time.
Parser.parse_definition = lambda _: None


@cache
def _last_parts(domain: PythonDomain) -> frozenset[str]:
    return frozenset(name.rpartition(".")[2] for name in domain.objects)


def _found(domain: PythonDomain, *asked: Any) -> Any:  # noqa: ANN401 - as Sphinx calls it
    """Look through all names only for one that ends so: most types are those of libraries."""
    *_, name, _, _ = asked
    known = name.removesuffix("()").rpartition(".")[2] in _last_parts(domain)
    return _among_all(domain, *asked) if known else []


# A type of another module is looked for among all names, and each page has the same ones.
_among_all = cache(PythonDomain.find_obj)
PythonDomain.find_obj = _found
add_module_names = False
napoleon_google_docstring = False
# Words such as "inputs" would be linked to whatever has that name.
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "code"

# What is copied is what is typed.
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
copybutton_copy_empty_lines = False

html_theme = "furo"
html_title = "flexarm"
# The colours of the live page. Pictures are drawn on white: in the dark their lightness is turned
# so that white becomes the page's ground, and their hues are kept.
html_theme_options = {
    "light_css_variables": {
        "color-brand-primary": "#0b6e83",
        "color-brand-content": "#0b6e83",
        "color-code-background": "#f4f6f7",
        "color-link-underline": "var(--color-foreground-border)",
        "picture-filter": "none",
    },
    "dark_css_variables": {
        "color-brand-primary": "#4cc3d9",
        "color-brand-content": "#4cc3d9",
        "color-link-underline": "var(--color-foreground-border)",
        "picture-filter": "invert(92.5%) hue-rotate(180deg)",
    },
}
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"
html_static_path = ["static"]
html_css_files = ["flexarm.css"]
html_js_files = ["flexarm.js"]
html_copy_source = False
html_show_sphinx = False
# A page that is opened from a disk asks nobody for anything.
html_use_opensearch = ""
# The same pages at any time.
html_last_updated_fmt = None

_ANCHOR = re.compile(r'^<a id="([\w-]+)"></a>$', re.MULTILINE)
# As MyST writes a cell of a heading that has no words.
_EMPTY_HEADING = re.compile(r"<th\b[^>]*><p></p></th>")
_LITERAL = re.compile(r"(`+[^`]+`+)")


_METHODS_HERE = "<!-- table of methods -->"
_WARNINGS_HERE = "<!-- table of data warnings -->"


def _with_tables(_: Sphinx, __: str, source: list[str]) -> None:
    """Put the tables of the estimators and of the data warnings where a page asks for them."""
    if _METHODS_HERE in source[0]:
        from flexarm_ident.subspace.methods import METHODS  # noqa: PLC0415 - one page needs it

        rows = [f"| `{row.name}` | {row.title} | {row.help} |" for row in METHODS.values()]
        table = ["| method | what it is | when |", "| --- | --- | --- |", *rows]
        source[0] = source[0].replace(_METHODS_HERE, "\n".join(table))
    if _WARNINGS_HERE in source[0]:
        from flexarm_ident.diagnostics.quality import kinds  # noqa: PLC0415 - one page needs it

        rows = [f"| `{each.code}` | {each.when} | {each.remedy} |" for each in kinds().values()]
        table = ["| code | when | what to do |", "| --- | --- | --- |", *rows]
        source[0] = source[0].replace(_WARNINGS_HERE, "\n".join(table))


def _with_targets(_: Sphinx, __: str, source: list[str]) -> None:
    """Turn the anchors of plain Markdown into targets that links are checked against."""
    source[0] = _ANCHOR.sub(r"(\1)=", source[0])


def _with_own_branch(_: Sphinx, __: str, ___: str, context: dict[str, Any], ____: object) -> None:
    """Unfold the contents where the page is: all of 300 modules beside each of them take long."""
    contents = context["toctree"]
    context["toctree"] = lambda **asked: contents(**{**asked, "collapse": True})


def _without_empty_headings(
    _: Sphinx, __: str, ___: str, context: dict[str, Any], ____: object
) -> None:
    """Let a corner of a table be a plain cell: a reader that speaks announces each heading."""
    context["body"] = _EMPTY_HEADING.sub("<td></td>", context.get("body", ""))


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
    app.connect("source-read", _with_tables)
    app.connect("autodoc-process-docstring", _as_plain_text)
    # Before the theme, which asks for the contents.
    app.connect("html-page-context", _with_own_branch, priority=400)
    app.connect("html-page-context", _without_empty_headings)
