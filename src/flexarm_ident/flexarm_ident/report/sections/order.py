"""Order section: order of the full model and its reasons."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import with_deviation
from flexarm_ident.report.content.blocks import Plots, Section, Table, Words
from flexarm_ident.report.content.wording import ranges
from flexarm_ident.report.plots.order_plots import singular_value_plot, stabilisation_plot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome


def _build(subject: Subject) -> Iterator[Block]:
    found, request = subject.outcome.identification, subject.outcome.request
    yield from map(Words, _why(subject.outcome))
    diagram = stabilisation_plot(
        found.diagram,
        [each.mode for each in found.recurring_modes if each.is_physical],
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
    if not found.diagram.modes:
        yield Words("No mode recurs at enough orders to count as a mode of the plant.")
        return
    yield Words(
        "These modes recur over the orders. Those that also answer the recorded inputs and stay at "
        "their places are marked: they are the plant's. The others belong to a steady disturbance, "
        "such as the mains, or to noise. The weight is the mean response (MRM), 1 for the "
        "strongest vibration, and 0.02 at least for a mode of the plant. ± is the scatter over "
        "the orders."
    )
    yield _clusters(subject.outcome)


SECTION = Section(20, "Order", _build)


def _why(outcome: Outcome) -> list[str]:
    """Return the reasons for the order of the full model."""
    identification = outcome.identification
    how = "chosen by the errors of models of many orders. What follows is for comparison"
    if outcome.request.order:
        how = "as asked for"
    if outcome.request.singular_value_threshold is not None:
        how = "the number of singular values above the threshold"
    if identification.friction is not None:
        how = "that of an arm's equations of motion; what follows is of its subspace start"
    orders = ranges(identification.diagram.orders)
    stable = ranges(identification.stable_orders) or "none"
    modes = f"The stabilisation diagram has the modes of the models of orders {orders}."
    models = f"Before unstable eigenvalues were moved, models of these orders were so: {stable}."
    return [
        f"The full model has order {identification.order}, {how}.",
        f"The widest gap of the singular values is after number {identification.suggested_order}.",
        f"{modes} A mode is called stable when the model of one order less has it too.",
        f"A model is called stable when its motion dies away. {models}",
    ]


def _clusters(outcome: Outcome) -> Table:
    """Return the modes that recur over the orders, with their scatter and weight."""
    figures = [
        (each.mode, each.weight, each.is_physical)
        for each in outcome.identification.recurring_modes
    ]
    rows = tuple(
        (
            with_deviation(mode.frequency_hz, mode.frequency_std_hz),
            with_deviation(mode.damping_ratio, mode.damping_std),
            f"{mode.count} ({100.0 * mode.share:.0f} %)",
            ranges(sorted(mode.orders)),
            f"{weight:.3f}",
            "yes" if is_physical else "no",
        )
        for mode, weight, is_physical in figures
    )
    header = ("Frequency, Hz", "Damping", "Found at", "Orders", "Weight", "Physical")
    marked = tuple(is_physical for _, _, is_physical in figures)
    return Table("clusters", "Modes that recur over the orders", header, rows, marked)
