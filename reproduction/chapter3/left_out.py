"""The strongest mode that a reduced model leaves out: its rank, and what that costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scipy import stats

from reproduction.chapter3.examples import INITIAL
from reproduction.chapter3.trial import means
from reproduction.framework.findings import prose, spread, thesis_table
from reproduction.framework.verdicts import LEVEL, p_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from reproduction.chapter3.examples import ReductionTrial


def ranks_text(found: Sequence[ReductionTrial], way: str) -> str:
    """Return the rank by MRM of the strongest mode left out by a way: median and range."""
    return spread([trial.left_out_rank(way) for trial in found], "g")


def thesis_rank(number: str, way: str) -> int:
    """Return the same of the tables of the thesis with a number."""
    name = f"table_{number.replace('-', '_')}"
    (row,) = (
        row for row in thesis_table(f"{name}b") if (row["stage"], row["validation"]) == (way, "dmv")
    )
    kept = row["modes"].split(",")
    modes = thesis_table(f"{name}a")["modes"]
    return min(int(mode["mrm"]) for mode in modes if mode["mode"] not in kept)


def left_out_reason(number: str, found: Sequence[ReductionTrial], way: str) -> str:
    """Compare the ranks, and tell whether a stronger mode that is left out costs more in ours."""
    return prose(
        "table-3-x-parts.left_out",
        way=way.upper(),
        theirs=thesis_rank(number, way),
        strong=ranks_text(found, way),
        correlation=_correlation(found, way),
    )


def _correlation(found: Sequence[ReductionTrial], way: str) -> str:
    ours = [trial.left_out_rank(way) for trial in found]
    if len({*ours}) == 1:
        return "that rank is the same in all of them"
    ranks = stats.spearmanr(ours, means(found, way) / means(found, INITIAL))
    falls = ranks.pvalue < LEVEL and ranks.statistic < 0.0
    return prose(
        "table-3-x-parts.correlation",
        does="falls with" if falls else "does not fall with",
        rank=ranks.statistic,
        p=p_text(float(ranks.pvalue)),
    )
