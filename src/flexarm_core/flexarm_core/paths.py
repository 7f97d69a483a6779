"""Paths as a user or a caller writes them."""

from __future__ import annotations

from pathlib import Path

from flexarm_core.errors import SettingError


def user_path(text: str) -> Path:
    """Return the path that a text names, with ``~`` and ``~user`` spelt out.

    Raises
    ------
    SettingError
        If there is no such user, or no file can have such a name.
    """
    if "\0" in text:
        raise SettingError(f"{text!r}: no file has a name with a zero byte: correct the path")
    try:
        return Path(text).expanduser()
    except RuntimeError:
        user = Path(text).parts[0]
        raise SettingError(
            f"{text}: no home folder of {user} is known: write the folder out"
        ) from None
