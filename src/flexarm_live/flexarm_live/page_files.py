"""Files of the page, each with its media type; nothing else is served by their names."""

from __future__ import annotations

from importlib.resources import files
from typing import NamedTuple

from flexarm_core.errors import FlexarmError

_MEDIA_TYPES = {
    "html": "text/html; charset=utf-8",
    "js": "text/javascript; charset=utf-8",
    "css": "text/css; charset=utf-8",
    "svg": "image/svg+xml",
    "txt": "text/plain; charset=utf-8",
}
INDEX = "index.html"


class PageFile(NamedTuple):
    """Content of one file and its media type."""

    content: bytes
    media_type: str


def page_files() -> dict[str, PageFile]:
    """Return the files of the page by their names.

    They are read once, so that no name that a browser sends ever becomes a path.

    Raises
    ------
    FlexarmError
        When a file is of no known media type.
    """
    found = {}
    for file in files("flexarm_live").joinpath("page").iterdir():
        ending = file.name.rpartition(".")[2]
        if ending not in _MEDIA_TYPES:
            raise FlexarmError(f"{file.name} of the page has no known media type")
        found[file.name] = PageFile(file.read_bytes(), _MEDIA_TYPES[ending])
    return found
