"""Delta debugging: from a schedule that fails to a smallest one that still does.

Zeller and Hildebrandt, Simplifying and isolating failure-inducing input, IEEE Transactions on
Software Engineering 28 (2002), section 3.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import TypeVar

    Item = TypeVar("Item")


def shrunk(items: Sequence[Item], fails: Callable[[Sequence[Item]], bool]) -> tuple[Item, ...]:
    """Return a part of the items that fails and does not without any one of them.

    Parameters
    ----------
    items : sequence
        Items that fail as a whole.
    fails : callable
        Whether some of the items, in their order, fail.
    """
    left = tuple(items)
    parts = 1
    while left and parts <= len(left):
        edges = [len(left) * part // parts for part in range(parts + 1)]
        for begin, end in pairwise(edges):
            rest = left[:begin] + left[end:]
            if fails(rest):
                left, parts = rest, max(parts - 1, 1)
                break
        else:
            if parts == len(left):
                break
            parts = min(2 * parts, len(left))
    return left
