from __future__ import annotations

import pytest
from click.testing import CliRunner

from flexarm_bringup.cli import main


@pytest.mark.parametrize(
    "line",
    [
        ["experiment", "C_dat3", "--payload", "nan"],
        ["demo", "--payload", "nan"],
        ["up", "--rate", "nan"],
        ["play", "run", "--rate", "inf"],
        ["identify", "run", "--train-fraction", "nan"],
        ["tune", "nominal:0", "--error-weight", "inf"],
    ],
)
def test_option___with_no_finite_number___is_refused_at_the_command_line(line: list[str]) -> None:
    done = CliRunner().invoke(main, line)
    assert done.exit_code == 2
    option, value = line[-2:]
    refusal = done.output.splitlines()[-1]
    assert refusal.startswith(f"Error: Invalid value for '{option}': {value} is ")
