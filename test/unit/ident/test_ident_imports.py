"""Test that the package, and the job of its node, load nothing that takes long."""

import subprocess
import sys
from pathlib import Path

import pytest

from support.loaded_modules import loaded
from support.project import BAGS


@pytest.mark.slow
def test_import__slow_libraries___wait_until_they_are_needed() -> None:
    # Every other part of scipy loads one of its two here.
    slow = "control matplotlib numba scipy.linalg scipy.special"
    assert not loaded("flexarm_ident, flexarm_ident.job", slow)


@pytest.mark.slow
def test_identification__whole_way_to_the_report___needs_no_library_that_takes_long(
    tmp_path: Path,
) -> None:
    program = (
        "import sys; from flexarm_ident.job import identify_bags, report_bags\n"
        "from pathlib import Path; from flexarm_ident.workflow.request import Request\n"
        f"bags, out = [Path({str(BAGS / 'c_dat3_0g')!r})], Path({str(tmp_path)!r})\n"
        "identify_bags(bags, out / 'found', Request())\n"
        "chosen = Request(order=6, method='orse', reduction='mrm', update='b')\n"
        "report_bags(bags, out / 'report.html', chosen)\n"
        "slow = {'matplotlib', 'numba', 'scipy.optimize', 'scipy.signal', 'scipy.stats'}\n"
        "print(slow & set(sys.modules))"
    )
    command = [sys.executable, "-c", program]
    run = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - ours
    assert run.stdout == "set()\n"
