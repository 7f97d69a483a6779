"""Laws of the user's own, from the files that the environment variable FLEXARM_LAWS names.

A file has a tuple `LAWS` of `LawSpec` rows. All processes of flexarm have them beside its own:
nodes, verbs, the page, and the replay of a record.
"""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from flexarm_core.errors import SettingError
from flexarm_core.own_modules import error_text, failed_line, own_module

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

FILES = "FLEXARM_LAWS"
"""Environment variable: Python files with laws, separated as those of PATH."""
_NAME = re.compile("[a-z][a-z0-9_]*")
_MODELS = "models"
_METHODS = ("step", "reset", "memory", "remember")
_AT_REST_V = (0.0, 0.0, 0.0, 0.0)


class Row(Protocol):
    """What is looked at in a row, a `LawSpec`."""

    @property
    def name(self) -> str:
        """Name of the law."""

    @property
    def build(self) -> Any:  # noqa: ANN401 - the law's own arguments
        """Constructor of the law."""

    @property
    def settings(self) -> Sequence[type]:
        """Tables of its parameters."""

    @property
    def design(self) -> object | None:
        """Design on a model, or None."""


RowT = TypeVar("RowT", bound=Row)


def own_laws(row: type[RowT], known: Sequence[str]) -> tuple[RowT, ...]:
    """Return the rows of the user's laws, each tried once at rest.

    Parameters
    ----------
    row : type
        The class of rows.
    known : sequence of str
        Names that are taken.

    Raises
    ------
    SettingError
        When a file cannot be read, or has a row that is not a law or whose name is taken.
    """
    files = [each for each in os.environ.get(FILES, "").split(os.pathsep) if each]
    found: dict[str, RowT] = {}
    for file in files:
        for each in _rows(file, row):
            if each.name in {*known, *found, _MODELS}:
                raise SettingError(
                    f"{FILES}: {file}: law {each.name!r}: the name is taken: choose another one"
                )
            if not _NAME.fullmatch(each.name):
                raise SettingError(
                    f"{FILES}: {file}: law {each.name!r}: a name is a word in small letters"
                )
            _try_out(file, each)
            found[each.name] = each
    return tuple(found.values())


def _rows(file: str, row: type[RowT]) -> Iterator[RowT]:
    """Yield the rows of a file."""
    rows = getattr(own_module(Path(file), FILES), "LAWS", ())
    if not rows or not all(isinstance(each, row) for each in rows):
        raise SettingError(
            f"{FILES}: {file}: it has no tuple LAWS of LawSpec rows (docs/howto/own_law.md)"
        )
    yield from rows


def _try_out(file: str, row: Row) -> None:
    """Refuse a law that does not answer a sample at rest; one that needs a model is left alone."""
    if row.design is not None:
        return
    start = f"{FILES}: {file}: law {row.name}"
    try:
        law = row.build(*(kind() for kind in row.settings))
        lacking = [name for name in _METHODS if not callable(getattr(law, name, None))]
        if not lacking:
            _answer_at_rest(law)
    except Exception as error:
        where = failed_line(error, Path(file))
        raise SettingError(
            f"{start} does not answer at rest{where}: {error_text(error)}"
        ) from error
    if lacking:
        raise SettingError(f"{start} has no method {', '.join(lacking)}")


def _answer_at_rest(law: Any) -> None:  # noqa: ANN401 - it may be none
    law.reset()
    law.remember(law.memory())
    effort_v, compensation_v = law.step(_AT_REST_V, 0.0)
    if not math.isfinite(effort_v + compensation_v):
        raise ValueError(f"{effort_v} V of effort and {compensation_v} V of compensation")
