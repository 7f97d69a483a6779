"""What is reproduced: every subject with the computations that it needs.

A subject names its computations as `Call`s, so that they can be run in parallel, shared between
subjects, and kept: a call is a function of a module and plain arguments, and the same call gives
the same result.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from reproduction.framework.findings import Finding

    Results: TypeAlias = "Mapping[Call, Any]"


@dataclass(frozen=True)
class Call:
    """One computation that takes a while.

    Attributes
    ----------
    function
        A function at the top level of a module; its result can be pickled.
    arguments
        Plain values: texts, numbers and tuples of them. A seed is one of them.
    """

    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()

    @property
    def name(self) -> str:
        """The call as it would be written."""
        words = ", ".join(map(repr, self.arguments))
        return f"{self.function.__module__}.{self.function.__qualname__}({words})"

    def __call__(self) -> Any:  # noqa: ANN401 - whatever the function returns
        """Compute it."""
        return self.function(*self.arguments)


@dataclass(frozen=True)
class Subject:
    """A table, figure or claim of the thesis.

    Attributes
    ----------
    key
        Its name on the command line, such as ``table-2-4``, ``figure-4-11`` or ``claim-2-1``.
    title
        What the thesis shows there, in our words.
    needs
        Its computations.
    build
        Turns their results into the finding; takes a second at most.
    """

    key: str
    title: str
    needs: tuple[Call, ...]
    build: Callable[[Results], Finding]
