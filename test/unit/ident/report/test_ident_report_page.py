from __future__ import annotations

import base64
import hashlib
import re
from html import unescape

import pytest

from flexarm_ident import IdentificationError
from flexarm_ident.report.content.blocks import Plots, Words
from flexarm_ident.report.page import append_section, render_page
from support.html_page import Page
from support.step_plots import a_step


def test_render_page___any___runs_its_script_alone() -> None:
    text = render_page("A page", [], {})
    (reported,) = re.findall(r'<meta http-equiv="Content-Security-Policy" content="(.*?)">', text)
    (code,) = re.findall("<script>(.*?)</script>", text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
    assert unescape(reported).startswith(f"default-src 'none'; script-src 'sha256-{digest}';")
    assert len(code.splitlines()) < 250


def test_append_section___two___stand_at_the_end_in_order() -> None:
    text = append_section(
        render_page("A page", [], {"The model": []}), "First <b>", [Words("5 < 6 & more")]
    )
    text = append_section(text, "Second", [Words("with a plot"), Plots((("", a_step()),))])
    headings = [unescape(heading) for heading in re.findall("<h2>(.*?)</h2>", text)]
    assert headings[-3:] == ["The model", "First <b>", "Second"]
    assert "<p>5 &lt; 6 &amp; more</p>" in text
    assert a_step() in text
    Page(text)
    targets = re.findall(r'<li><a href="#([^"]+)">(.*?)</a>', text)
    assert [unescape(title) for _, title in targets][-2:] == ["First <b>", "Second"]
    assert all(text.count(f'<section id="{target}">') == 1 for target, _ in targets)


def test_append_section___text_of_something_else___is_refused() -> None:
    with pytest.raises(IdentificationError, match="cannot add 'Step': the text is not a report"):
        append_section("<html></html>", "Step", [Words("words")])
