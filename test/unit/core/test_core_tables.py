"""Parameter tables in YAML: groups, names that the code knows, and what is refused."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pytest

from flexarm_core.errors import SettingError
from flexarm_core.specs import ParameterSpec
from flexarm_core.tables import defaults, read_table

if TYPE_CHECKING:
    from pathlib import Path

TABLE = """
arm:
  rate_hz:
    type: double
    default_value: 300.0
    unit: Hz
    description: sampling rate
    validation:
      bounds<>: [10.0, $fastest_hz]
  board:
    device:
      type: string
      default_value: $Board.device
      description: name of the board
      read_only: true
    inputs:
      type: string_array
      default_value: [ai0]
      description: wired inputs
      validation:
        subset_of<>: [$inputs]
  __map_laws:
    gain:
      type: int
      default_value: 1
      description: gain
      live: true
"""
RATE = ParameterSpec("rate_hz", 300.0, "sampling rate", 10.0, 2000.0, "Hz")
DEVICE = ParameterSpec("board.device", "Dev1", "name of the board", read_only=True)
INPUTS = ParameterSpec("board.inputs", ["ai0"], "wired inputs", choices=("ai0", "ai1"))
GAINS = [ParameterSpec(f"{law}.gain", 1, "gain", live=True) for law in ("pd", "pi")]


@dataclass(frozen=True)
class Board:
    """Settings that exist before the table."""

    device: str = "Dev1"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of an importable package."""
    folder = tmp_path / "arm_tables"
    folder.mkdir()
    (folder / "__init__.py").touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "arm_tables", raising=False)
    return folder


def test_table___groups_maps_and_known_names___are_read(package: Path) -> None:
    (package / "arm.yaml").write_text(TABLE, "utf-8")
    known = {"fastest_hz": 2000.0, "inputs": ("ai0", "ai1"), "laws": ("pd", "pi")}
    read = read_table("arm_tables", "arm", known | defaults(Board()))
    assert read == (RATE, DEVICE, INPUTS, *GAINS)


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        ("{type: double, default_value: 1, description: x}", "x is a double, .* default is 1"),
        ("{type: float, default_value: 1.0, description: x}", "x is a float"),
        ("{type: bool, default_value: $on, description: x}", r"nothing is known as \$on"),
        ("{type: int, default_value: 1, description: x, units: V}", "x has units, which has no"),
        (
            "{type: int, default_value: 1, description: x, validation: {gt<>: [0]}}",
            "x has gt<>, which has no meaning",
        ),
    ],
)
def test_table___what_has_no_meaning___is_refused(package: Path, row: str, complaint: str) -> None:
    (package / "wrong.yaml").write_text(f"wrong:\n  x: {row}\n", "utf-8")
    with pytest.raises(SettingError, match=complaint):
        read_table("arm_tables", "wrong")


def test_complaint___list_with_a_member_that_is_no_choice___names_it() -> None:
    assert INPUTS.complaint(["ai1", "ai0"]) is None
    assert INPUTS.complaint(["ai1", "ai7"]) == "board.inputs = 'ai7': must be one of ai0, ai1"
