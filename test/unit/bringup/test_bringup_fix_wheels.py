"""What the set-up does to the wheels that it installed."""

from __future__ import annotations

import runpy
import sys
import sysconfig
from typing import TYPE_CHECKING

import numpy as np
import pytest

from support.project import PROJECT

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of an environment that nothing is in."""
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    return tmp_path


def fix_wheels() -> None:
    runpy.run_path(str(PROJECT / "bootstrap" / "fix_wheels.py"))


def written(file: Path, text: str) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, "utf-8")
    return file


def test_cmake_files___name_the_headers_of_this_machine(prefix: Path) -> None:
    exports = written(
        prefix / "share" / "one" / "cmake" / "oneExport.cmake",
        'set(dirs "/opt/python/cp311-cp311/include/python3.11;'
        '/opt/python/cp311/lib/python3.11/site-packages/numpy/core/include")',
    )
    fix_wheels()
    ours = f"{sysconfig.get_path('include')};{np.get_include()}"
    assert exports.read_text("utf-8") == f'set(dirs "{ours}")'


def test_copies_of_a_library___become_one_file_under_its_names(prefix: Path) -> None:
    names = ("liba.so", "liba.so.2", "liba.so.2.1")
    copies = [written(prefix / "lib" / name, "the same") for name in names]
    elsewhere = written(prefix / "lib" / "python3.11" / "wheel.libs" / "libb.so", "the same")
    other = written(prefix / "lib" / "libc.so", "not that!")  # of another length
    alike = written(prefix / "lib" / "libd.so", "not same")  # of that length
    for _ in range(2):
        fix_wheels()
        assert {file.stat().st_ino for file in copies} == {elsewhere.stat().st_ino}
        assert copies[0].read_text("utf-8") == "the same"
        assert other.stat().st_nlink == alike.stat().st_nlink == 1


def test_parts_that_nobody_calls___go_and_what_is_called_stays(prefix: Path) -> None:
    packages = prefix / "lib" / "python3.11" / "site-packages"
    gone = [
        written(packages / name, "")
        for name in (
            *("cmake/data/bin/ctest", "scipy/signal/tests/test_one.py", "numpy/tests/data/a.npy"),
            *("numpy/tests/data/tests/test_b.py", "numba/tests/test_c.cpython-311.so"),
        )
    ]
    kept = [
        written(packages / name, "")
        for name in (
            *("cmake/data/bin/cmake", "scipy/signal/one.py", "jinja2/tests.py", "us/tests/a"),
            # numpy.testing of numpy 2.2, the last one for Python 3.10, imports the second.
            *("numpy/_core/tests/__init__.py", "numpy/_core/tests/_natype.py"),
        )
    ]
    fix_wheels()
    assert not any(file.exists() for file in gone)
    assert all(file.exists() for file in kept)
