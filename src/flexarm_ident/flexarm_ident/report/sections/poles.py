"""Poles section: poles of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit
from flexarm_ident.report.content.blocks import Plots, Section, Words
from flexarm_ident.report.plots.pole_plots import damping_plot, pole_plot, pole_zero_plot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome


# More maps than these are a page of their own.
_CHANNELS = 6


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    modes, deviations = outcome.modes, outcome.identification.known_deviations
    yield Plots(
        (
            ("z plane with the unit circle", pole_plot(modes, outcome.model.dt, deviations)),
            ("Damping over frequency", damping_plot(modes, deviations)),
        )
    )
    yield Words(
        "A motion with a pole outside the unit circle grows. Slow poles lie near 1, the fastest "
        "that the sampling can show near -1."
    )
    yield Plots(tuple(_pole_zero_maps(outcome))[:_CHANNELS])
    yield Words(
        "These are poles and zeros of the model from one input to one output. A zero beside a pole "
        "hides that motion from the output. A zero outside the unit circle, beside those near -1 "
        "that sampling brings, limits the bandwidth of a controller of that output "
        "(non-minimum phase)."
    )


def _pole_zero_maps(outcome: Outcome) -> Iterator[tuple[str, str]]:
    record, model = outcome.records[0], outcome.model
    for i, output in enumerate(record.outputs):
        for j, drive in enumerate(record.inputs):
            channel = model[i, j]
            names = " from ".join(label_and_unit(name)[0] for name in (output, drive))
            yield names, pole_zero_plot(channel.poles(), channel.zeros(), model.dt)


SECTION = Section(40, "Poles", _build)
