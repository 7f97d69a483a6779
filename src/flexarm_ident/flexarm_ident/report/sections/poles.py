"""Poles section: poles of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_ident.report.content.blocks import Plots, Section, Words
from flexarm_ident.report.plots.pole_plots import damping_plot, pole_plot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    damping = damping_plot(outcome.modes, outcome.identification.known_deviations)
    yield Plots(
        (
            ("z plane with the unit circle", pole_plot(outcome.modes, outcome.model.dt)),
            ("Damping over frequency", damping),
        )
    )
    yield Words(
        "A motion with a pole outside the unit circle grows. Slow poles lie near 1, the fastest "
        "that the sampling can show near -1."
    )


SECTION = Section(40, "Poles", _build)
