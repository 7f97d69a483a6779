from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

NODE = shutil.which("node")
TESTS = Path(__file__).with_name("page_maths.test.mjs")


@pytest.mark.skipif(
    NODE is None, reason="the page's mathematics is tried by node, which is not here"
)
def test_page___mathematics___holds() -> None:
    assert NODE is not None
    done = subprocess.run([NODE, "--test", TESTS], capture_output=True, text=True, check=False)  # noqa: S603
    assert done.returncode == 0, done.stdout
