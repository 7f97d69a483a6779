"""Order section: order of the full model and its reasons."""

from __future__ import annotations

import math
from operator import attrgetter
from typing import TYPE_CHECKING

from flexarm_ident.estimation.physical_modes import (
    NEAR,
    NOISE,
    PHYSICAL,
    SPLIT,
    near_modes,
    standing_as,
    standings,
)
from flexarm_ident.estimation.weighing import TOLERANCE, TOLERANCE_IN_FEEDBACK
from flexarm_ident.report.content.blocks import Heading, Plots, Section, Table, Words
from flexarm_ident.report.content.wording import error_text, listed, ranges
from flexarm_ident.report.plots.order_plots import (
    cost_plot,
    singular_value_plot,
    stabilisation_plot,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_ident.estimation.identification import Identification
    from flexarm_ident.estimation.physical_modes import JudgedMode
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome


_WORDS = {PHYSICAL: "yes", SPLIT: "possibly a split pole", NOISE: "no"}
_FREQUENCY_DIGITS, _DAMPING_DECIMALS = 4, 4


def _build(subject: Subject) -> Iterator[Block]:
    found, request = subject.outcome.identification, subject.outcome.request
    yield from map(Words, _why(subject.outcome))
    diagram = stabilisation_plot(
        found.diagram,
        standing_as(PHYSICAL, found.recurring_modes),
        split=standing_as(SPLIT, found.recurring_modes),
        known_modes_hz=request.known_modes_hz,
        order=found.order,
        measured=subject.outcome.spectra,
    )
    yield Plots(
        (
            ("Singular values", singular_value_plot(found.singular_values, found.order)),
            ("Stabilisation diagram", diagram),
        )
    )
    if found.weighed:
        yield from _weighed(found)
    yield Heading("Modes that recur over the orders")
    if not found.diagram.modes:
        yield Words("No mode recurs at enough orders to count as a mode of the plant.")
        return
    yield Words(
        "These modes recur over the orders. Those that also answer the recorded inputs and stay "
        "at their places are marked as physical. The others belong to a steady disturbance, such "
        "as the mains, or to noise. The weight is the mean response (MRM), 1 for the strongest "
        "lightly damped mode, and 0.02 at least for a physical mode. The scatter is that of "
        "models of different orders from the same data, not a standard deviation of the mode."
    )
    judged = found.recurring_modes
    yield from map(Words, pair_words(judged))
    yield recurring_table(judged)


SECTION = Section(20, "Order", _build)


def _why(outcome: Outcome) -> list[str]:
    """Return the reasons for the order of the full model."""
    identification = outcome.identification
    how = "chosen by the errors of models of many orders. The plots are for comparison"
    if outcome.request.order:
        how = "as asked for"
    if outcome.request.singular_value_threshold is not None:
        how = "the number of singular values above the threshold"
    if identification.friction is not None:
        how = "that of an arm's equations of motion; the plots are of its subspace start"
    orders = ranges(identification.diagram.orders)
    stable = ranges(identification.stable_orders) or "none"
    modes = f"The stabilisation diagram shows the modes of the models of orders {orders}."
    models = (
        f"Before unstable eigenvalues were moved, the models of these orders were stable: {stable}."
    )
    return [
        f"The full model has order {identification.order}, {how}.",
        f"The largest gap in the singular values follows number {identification.suggested_order}.",
        f"{modes} A mode stays when the next smaller model has it too.",
        models,
    ]


def _weighed(found: Identification) -> Iterator[Block]:
    """Yield what method and order were chosen from: the scores, and every model with its errors."""
    rows = found.weighed
    taken = next(row for row in rows if row.chosen)
    curves: dict[str, list[tuple[int, float]]] = {}
    for row in sorted(rows, key=attrgetter("order")):
        if math.isfinite(row.score):
            curves.setdefault(row.method, []).append((row.order, row.score))
    yield Heading("Candidate models")
    made = (found.method, found.order) == (taken.method, taken.order)
    refined = "" if made else f", and refined to order {found.order} ({found.title})"
    percent, in_feedback = (
        f"{100.0 * (tolerance - 1.0):.0f} %" for tolerance in (TOLERANCE, TOLERANCE_IN_FEEDBACK)
    )
    yield Words(
        f"{taken.method} of order {taken.order} was chosen of these{refined}. The score is the "
        "geometric mean of the error that is expected of other data, with twice the weight, and of "
        "the error on blocks that were left out of the fit. The smallest order is chosen whose "
        f"score exceeds the smallest by at most {percent}. Under feedback or friction the choice "
        f"by the one-step errors stays up to {in_feedback}: there, a simulation also rewards a "
        "model that imitates the noise or the friction."
    )
    yield Words(
        "Every row can be asked for by its method and order, as in "
        f"--method {rows[0].method} --order {rows[0].order}. Errors are relative, and means "
        "over the outputs. A dash stands where the fit is too poor to be weighed further."
    )
    plot = cost_plot(curves, order=taken.order, labels=("order", "score"))
    yield Plots((("Score", plot),))
    cells = tuple(
        (
            *(row.method, str(row.order), error_text(row.error), error_text(row.left_out)),
            error_text(row.score if math.isfinite(row.score) else math.nan),
        )
        for row in rows
    )
    header = ("Method", "Order", "Error", "Error, left-out blocks", "Score")
    marked = tuple(row.chosen for row in rows)
    yield Table("weighed", "Candidate models, the best score first", header, cells, marked)


def pair_words(judged: Sequence[JudgedMode]) -> list[str]:
    """Return a warning for each group of `near_modes`."""
    return [
        f"{listed([_text_hz(each) for each in group])} Hz stand less than {100.0 * NEAR:g} % "
        "apart. Their shapes are alike (MAC), or they scatter as widely: possibly a split pole."
        for group in near_modes(judged)
    ]


def recurring_table(judged: Sequence[JudgedMode]) -> Table:
    """Return the modes that recur over the orders, with their scatter and weight."""
    rows = tuple(
        (
            _text_hz(mode.frequency_hz),
            _at_least(mode.frequency_std_hz, _decimals(mode.frequency_hz)),
            f"{mode.damping_ratio:.{_DAMPING_DECIMALS}f}",
            _at_least(mode.damping_std, _DAMPING_DECIMALS),
            f"{mode.count} ({100.0 * mode.share:.0f} %)",
            ranges(sorted(mode.orders)),
            f"{each.weight:.3f}",
            _WORDS[standing],
        )
        for each, standing in zip(judged, standings(judged), strict=True)
        for mode in (each.mode,)
    )
    scatter = "Scatter over orders"
    header = (
        *("Frequency, Hz", f"{scatter}, Hz", "Damping", scatter),
        *("Found at", "Orders", "Weight", "Physical"),
    )
    marked = tuple(each.is_physical for each in judged)
    return Table("clusters", "Modes that recur over the orders", header, rows, marked)


def _decimals(frequency_hz: float) -> int:
    return max(0, _FREQUENCY_DIGITS - 1 - math.floor(math.log10(frequency_hz)))


def _text_hz(frequency_hz: float) -> str:
    return f"{frequency_hz:.{_decimals(frequency_hz)}f}"


def _at_least(scatter: float, decimals: int) -> str:
    """Return a scatter in the decimals of its value; what they do not show is below the last."""
    last = 10.0**-decimals
    return f"{scatter:.{decimals}f}" if scatter >= 0.5 * last else f"< {last:.{decimals}f}"
