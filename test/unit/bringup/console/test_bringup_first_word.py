from __future__ import annotations

import subprocess
import sys

import pytest

SLOW = """
import sys, time
from flexarm_bringup.console import first_word
sys.argv = ["flexarm", *{arguments}]
first_word.promise_word(sys.argv[1:])
{said}
time.sleep(1.5)
"""


def reported(arguments: list[str], said: str = "") -> str:
    code = SLOW.format(arguments=arguments, said=said)
    done = subprocess.run(  # noqa: S603 - our own code
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return done.stderr


def test_verb___that_is_silent___is_said_to_be_at_work() -> None:
    assert reported(["status"]) == "flexarm status: at work\n"


@pytest.mark.parametrize("stream", ["stdout", "stderr"])
def test_verb___that_has_spoken___is_left_alone(stream: str) -> None:
    assert "at work" not in reported(["up"], f"print('up', file=sys.{stream})")


@pytest.mark.parametrize("arguments", [[], ["--help"], ["exec", "true"], ["ros2", "node"]])
def test_program___that_is_not_ours_or_none___has_no_word(arguments: list[str]) -> None:
    assert reported(arguments) == ""
