"""What the front page shows of its second command; `flexarm docs` runs those of all pages."""

from __future__ import annotations

import pytest

from docs.pages import outdated
from support.project import PROJECT

pytestmark = pytest.mark.slow


def test_readme___lines_of_output___are_printed_today() -> None:
    assert list(outdated(PROJECT, PROJECT / "README.md")) == []
