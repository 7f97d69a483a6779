"""Modes ordered by what they contribute, as Tables 3-1a to 3-5a list them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.models.modes import Mode


class RankTable(NamedTuple):
    """The same modes in two orders, the most significant one first.

    Attributes
    ----------
    by_msv : tuple of Mode
        By falling mode singular value (3-4).
    by_mrm : tuple of Mode
        By falling modal response magnitude (3-8).
    """

    by_msv: tuple[Mode, ...]
    by_mrm: tuple[Mode, ...]


def rank_table(modes: Sequence[Mode]) -> RankTable:
    """Return the modes in the order of either index.

    Parameters
    ----------
    modes : sequence of Mode
        Modes of one model, such as `Identification.modes` or `Reduction.modes`.

    Returns
    -------
    RankTable
        The two orders.
    """
    return RankTable(
        by_msv=tuple(sorted(modes, key=lambda mode: mode.msv_rank)),
        by_mrm=tuple(sorted(modes, key=lambda mode: mode.mrm_rank)),
    )
