"""Files of the page: what is served, and as what."""

from __future__ import annotations

import pytest

from flexarm_live.page_files import INDEX, page_files


def test_page_files___have___the_media_type_of_their_ending() -> None:
    index = page_files()[INDEX]
    assert index.content.startswith(b"<!doctype html>")
    assert index.media_type == "text/html; charset=utf-8"


@pytest.mark.parametrize("ending", ["js", "css"])
def test_page_files___of_scripts_and_styles___are_text(ending: str) -> None:
    kinds = {file.media_type for name, file in page_files().items() if name.endswith(ending)}
    assert kinds <= {"text/javascript; charset=utf-8", "text/css; charset=utf-8"}
