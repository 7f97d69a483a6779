"""Every kind of file that carries our mark is known as our own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from flexarm_core.outputs import is_replaceable
from flexarm_ident.models.files import FORMATS, save_model
from flexarm_ident.models.model_parameters import model_parameters, write_parameter_file
from flexarm_ident.report.page import append_section, render_page
from support.ident_systems import random_model

if TYPE_CHECKING:
    from pathlib import Path

LONG_NAME = "a" * 2000


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("name", ["arm", LONG_NAME])
def test_model___in_every_format___is_our_own(tmp_path: Path, suffix: str, name: str) -> None:
    file = tmp_path / f"model{suffix}"
    save_model(file, random_model(3), name=name, provenance={"source": LONG_NAME})
    assert is_replaceable(file)


def test_parameter_file___is_our_own(tmp_path: Path) -> None:
    file = tmp_path / "gains.yaml"
    parameters = model_parameters("arm", random_model(3), provenance={})
    write_parameter_file(file, parameters, node="/flexarm/controller")
    assert is_replaceable(file)


def test_page___with_and_without_a_section_more___is_our_own(tmp_path: Path) -> None:
    page = render_page(LONG_NAME, [], {})
    for text in (page, append_section(page, "More", [])):
        file = tmp_path / "page.html"
        file.write_text(text, "utf-8")
        assert is_replaceable(file)
