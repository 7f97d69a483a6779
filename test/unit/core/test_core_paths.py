from __future__ import annotations

from pathlib import Path

import pytest

from flexarm_core.errors import SettingError
from flexarm_core.own_files import user_path


def test_path___with_a_home___is_spelt_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/somebody")
    assert user_path("~/run") == Path("/home/somebody/run")
    assert user_path("out/~/run") == Path("out/~/run")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("~no_such_user/run", "no home folder of ~no_such_user is known: write the folder out"),
        ("a\0b", r"'a\\x00b': no file has a name with a zero byte"),
    ],
)
def test_path___that_names_no_file___is_refused(text: str, complaint: str) -> None:
    with pytest.raises(SettingError, match=complaint):
        user_path(text)
