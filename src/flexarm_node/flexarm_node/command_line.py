"""Words of a node's command line that ROS 2 passes over.

ROS 2 reads what stands between `--ros-args` and `--`, and drops everything else without a word: a
safety limit before `--ros-args` would be the default one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.bounds import shown
from flexarm_core.errors import SettingError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

BEGIN = "--ros-args"
"""ROS arguments stand after this word."""
_END = "--"
_PARAMETER, _RULE = "-p", "-r"
_ASSIGNS = ":="


def are_for_ros(words: Sequence[str]) -> list[bool]:
    """Mark the words of a command line that are for ROS 2, with those around them."""
    marks: list[bool] = []
    is_ros = False
    for word in words:
        was_ros, is_ros = is_ros, word == BEGIN or (is_ros and word != _END)
        marks.append(was_ros or is_ros)
    return marks


def own_words(words: Sequence[str]) -> list[str]:
    """Return those words of a command line, without the program's name, that are not for ROS 2."""
    return [word for word, is_ros in zip(words, are_for_ros(words), strict=True) if not is_ros]


def refuse_words(words: Sequence[str]) -> None:
    """Refuse words that nobody would read.

    Raises
    ------
    SettingError
        When there are any; it says what to write instead.
    """
    if not words:
        return
    if any(_ASSIGNS in word or word.startswith("-") for word in words):
        remedy = f"write {' '.join((BEGIN, *_as_ros(words)))}"
    else:
        remedy = "leave it out"
    raise SettingError(f"{shown(' '.join(words))} is not after {BEGIN}, and not read: {remedy}")


def _as_ros(words: Sequence[str]) -> Iterator[str]:
    """Yield words as ROS arguments: an assignment that stands alone is that of a parameter."""
    before = ""
    for word in words:
        if _ASSIGNS in word and not before.startswith("-"):
            is_rule = word.startswith("__") or "/" in word.partition(_ASSIGNS)[0]
            yield _RULE if is_rule else _PARAMETER
        yield word
        before = word
