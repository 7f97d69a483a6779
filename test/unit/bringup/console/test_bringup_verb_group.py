from __future__ import annotations

import errno

import click
import pytest
from click.testing import CliRunner

from flexarm_bringup.console.verb_group import VerbGroup
from flexarm_core.errors import SettingError


@pytest.mark.parametrize("kind", [SettingError, ValueError, RuntimeError, OSError])
def test_verb___error_of_ours_or_of_a_library___is_one_line(
    kind: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FLEXARM_DEBUG", raising=False)

    def fail() -> None:
        raise kind("no\n  domain")

    group = VerbGroup("flexarm", commands={"fail": click.Command("fail", callback=fail)})
    result = CliRunner().invoke(group, ["fail"])
    assert result.exit_code == 1
    assert result.output == "flexarm: no domain\n"


def test_verb___reader_that_has_gone___ends_without_a_word() -> None:
    @click.command()
    def verb() -> None:
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    done = CliRunner().invoke(VerbGroup("flexarm", commands={"verb": verb}), ["verb"])
    assert (done.exit_code, done.output) == (1, "")
