"""Short names of records: the file's name instead of the whole origin."""

from __future__ import annotations

from pathlib import PurePath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence


def short_names(labels: Sequence[str]) -> dict[str, str]:
    """Return the shortest names that tell records apart, by their labels.

    A label may be a path with a bracketed remark, which bags add: the last part of the path
    suffices mostly, otherwise folders stand before it.
    """
    paths = [PurePath(label.partition(" (")[0]) for label in labels]
    different = len(set(paths))
    for parts in range(1, max((len(path.parts) for path in paths), default=0) + 1):
        names = [str(PurePath(*path.parts[-parts:])) for path in paths]
        if len(set(names)) == different == len(set(labels)):
            return dict(zip(labels, names, strict=True))
    return {label: label for label in labels}


def portable_names(labels: Sequence[str]) -> list[str]:
    """Return labels for files that others read: no absolute path, which reveals this machine."""
    short = short_names(labels)
    return [_portable(short[label]) if _is_absolute(label) else label for label in labels]


def _is_absolute(label: str) -> bool:
    return PurePath(label).is_absolute()


def _portable(name: str) -> str:
    return PurePath(name).name if _is_absolute(name) else name
