"""Figure 2-6: the order read off the singular values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.report.plots.plots import singular_value_plot
from reproduction.chapter2.survey_tables import survey_calls, survey_of
from reproduction.framework.findings import Finding, Judgement, Plot, SideBySide, judged
from reproduction.framework.subjects import Subject

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from reproduction.framework.subjects import Results

RECORD = "O_dat2"
"""The thesis does not say whose singular values it shows; this is the record of its Ao2_19."""
ORDER = 15
SMALL = 0.01
"""Of the largest singular value: what is below cannot be seen in a picture with a linear axis."""
_LISTED = (1, 2, 3, 5, 7, 10, 15, 16, 20, 30)


def _figure(results: Results) -> Finding:
    found = survey_of(results, RECORD)
    shares = found.singular_values / found.singular_values[:, :1]
    medians = np.median(shares, axis=0)
    rows = tuple((str(number), f"{medians[number - 1]:.2g}") for number in _LISTED)
    return Finding(
        order_judgement(medians, float(found.stable_at(ORDER).mean())),
        (SideBySide("Singular values over the largest", ("number", "ours, median"), rows),),
        (
            Plot(
                f"Singular values of {RECORD}, seed 1",
                singular_value_plot(found.singular_values[0], ORDER),
            ),
        ),
        (
            (
                f"{RECORD} with noise as strong as the thesis's. The thesis shows one sample, "
                f"reads off the order {ORDER}, and warns that such a model may be unstable."
            ),
        ),
    )


def order_judgement(shares: NDArray[np.float64], stable: float) -> Judgement:
    """Judge what the thesis says of Figure 2-6.

    Parameters
    ----------
    shares : ndarray, (values,)
        Singular values over the largest, descending.
    stable
        Share of the seeds in which the model of order 15 is stable.
    """
    next_share = float(shares[ORDER])
    small, unstable = next_share <= SMALL, stable < 1.0
    first = int(np.argmax(shares <= SMALL)) if np.any(shares <= SMALL) else len(shares)
    return judged(
        agrees=small and unstable,
        same_ranking=small or unstable,
        evidence=(
            f"The value after number {ORDER} is {next_share:.1%} of the largest, in the median; "
            f"below {SMALL:.0%} they are after number {first}. The model of order {ORDER} is "
            f"unstable in {1.0 - stable:.0%} of the seeds, of which the thesis warns."
        ),
        reason="The noise that is left after the filter is a larger part of our record.",
    )


SUBJECTS = (Subject("figure-2-6", "Singular values of a record", survey_calls(RECORD), _figure),)
