from __future__ import annotations

import importlib
import subprocess
import sys
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType

FRONT = """
from typing import TYPE_CHECKING
from flexarm_core.fronts import late
if TYPE_CHECKING:
    from front_of_a_test.room import first
    from front_of_a_test.room import second as other
else:
    __getattr__, __dir__ = late(__name__, __file__)
"""


@pytest.fixture
def front(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    folder = tmp_path / "front_of_a_test"
    folder.mkdir()
    (folder / "__init__.py").write_text(FRONT)
    (folder / "room.py").write_text("first, second = 1, 2\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("front_of_a_test", "front_of_a_test.room"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module("front_of_a_test")


def test_name___that_is_asked_for___loads_its_room(front: ModuleType) -> None:
    assert "front_of_a_test.room" not in sys.modules
    assert {"first", "other"} <= set(dir(front))
    assert (front.first, front.other) == (1, 2)
    assert vars(front)["first"] == 1  # kept: asked for once


def test_name___that_is_not_there___is_reported(front: ModuleType) -> None:
    with pytest.raises(AttributeError, match="'front_of_a_test' has no attribute 'third'"):
        _ = front.third
    with pytest.raises(ImportError):
        exec("from front_of_a_test import second", {})  # noqa: S102 - its name is another one


@pytest.mark.parametrize("package", ["flexarm_control", "flexarm_daq", "flexarm_ident"])
def test_public_names___of_a_package___are_all_there(package: str) -> None:
    module = importlib.import_module(package)
    assert [name for name in module.__all__ if not hasattr(module, name)] == []


def test_fronts___of_the_packages___load_no_mathematics() -> None:
    packages = "flexarm_control, flexarm_daq, flexarm_ident"
    program = f"import sys, {packages}; print('numpy' in sys.modules)"
    done = subprocess.run(  # noqa: S603 - ours
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    assert done.stdout == "False\n"
