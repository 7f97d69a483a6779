from __future__ import annotations

import os
import subprocess
import sys
from typing import TYPE_CHECKING, Any

from numba import njit
from numba.core.caching import CacheImpl

from flexarm_core.compilation import _called, compiled

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

HEAD = "from flexarm_core.compilation import compiled\n"


def test_compiling___with_no_place_for_a_cache___goes_without(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])

    def double(value: float) -> float:
        return 2.0 * value

    assert compiled(double)(2.5) == 5.0


def test_compiled_functions___that_call_each_other___are_called_by_another() -> None:
    names: dict[str, Any] = {}
    for one, other in (("even", "odd"), ("odd", "even"), ("outer", "even")):
        source = f"def {one}(k):\n    return {other}(k - 1) if k else 0\n"
        exec(source, names)  # noqa: S102 - each finds the others in one module
        names[one] = njit(names[one])

    assert _called(names["outer"]) == {names[each] for each in ("even", "odd", "outer")}


def test_compiled_function___that_it_calls_in_another_file_has_changed___is_compiled_anew(
    tmp_path: Path,
) -> None:
    caller = "from middle import middle\n@compiled\ndef outer(x):\n    return middle(x) + 0.5\n"
    middle = "from inner import inner\n@compiled\ndef middle(x):\n    return inner(x) + 1.0\n"
    (tmp_path / "outer.py").write_text(HEAD + caller, "utf-8")
    (tmp_path / "middle.py").write_text(HEAD + middle, "utf-8")
    said = []

    for factor in ("2.0", "30.0"):
        (tmp_path / "inner.py").write_text(
            f"{HEAD}@compiled\ndef inner(x):\n    return {factor} * x\n", "utf-8"
        )
        for _ in range(2):
            run = subprocess.run(
                [sys.executable, "-c", "import outer; print(outer.outer(1.0), outer.outer.stats)"],
                cwd=tmp_path,
                env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
                capture_output=True,
                text=True,
                check=True,
            )
            said.append(run.stdout)

    assert [float(each.split()[0]) for each in said] == [3.5, 3.5, 31.5, 31.5]
    # What nobody changed is read from the disk.
    assert all("cache_hits=Counter({(float64,): 1})" in said[run] for run in (1, 3)), said
