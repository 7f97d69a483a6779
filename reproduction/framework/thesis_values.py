"""What the thesis prints: its tables, taken over into the files of `thesis`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import yaml

_FOLDER = Path(__file__).parents[1] / "thesis"


@cache
def thesis_table(name: str) -> Any:  # noqa: ANN401 - each table has a shape of its own
    """Return a table of the thesis by the name of its file, such as ``table_2_4``."""
    return yaml.safe_load((_FOLDER / f"{name}.yaml").read_text("utf-8"))
