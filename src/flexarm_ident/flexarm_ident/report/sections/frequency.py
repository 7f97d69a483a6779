"""Frequency response section."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_core.labels import label_and_unit
from flexarm_ident.models.modes import frequency_grid
from flexarm_ident.report.content.blocks import Heading, Plots, Section, Words
from flexarm_ident.report.content.wording import deviation_words
from flexarm_ident.report.plots.frequency_plot import frequency_plot

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_RESPONSES_SHOWN = 12
_MEASURED = (
    "The grey curve is the response by averaged spectra, where the output is coherent with the "
    "inputs. The coherence is below it, with the line that chance exceeds at one frequency in a "
    "hundred. In a closed loop this response is biased by the noise that the controller feeds back."
)


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    record = max(outcome.records, key=len)
    full = outcome.identification.model
    models = {f"full, {full.nstates} states": full}
    if outcome.reduction is not None:
        reduced = outcome.reduction.model
        models[f"reduced, {reduced.nstates} states"] = reduced
    grid_hz = frequency_grid(full, 1.0 / (len(record) * record.dt_s))
    known = outcome.identification.response_uncertainty(grid_hz)
    shown = record.inputs[: max(1, _RESPONSES_SHOWN // len(record.outputs))]
    for number, source in enumerate(shown):
        words = f"From {label_and_unit(source)[0]} to each output."
        if number:
            yield Heading(SECTION.title, level=2)
        else:
            words += f" {_band_words(outcome, known is not None)}"
            if outcome.spectra is not None:
                words += f" {_MEASURED}"
            if len(shown) < len(record.inputs):
                words += f" The first {len(shown)} of {len(record.inputs)} inputs are shown."
        yield Words(words)
        yield Plots(
            tuple(
                (
                    label_and_unit(name)[0],
                    frequency_plot(
                        models,
                        output,
                        number,
                        frequencies_hz=grid_hz,
                        deviation=None if known is None else known.deviation[:, output, number],
                        measured=outcome.spectra,
                        known_modes_hz=outcome.request.known_modes_hz,
                    ),
                )
                for output, name in enumerate(record.outputs)
            )
        )


SECTION = Section(100, "Frequency response", _build)


def _band_words(outcome: Outcome, known: bool) -> str:  # noqa: FBT001 - the one question
    if known:
        return (
            "The band is ± two standard deviations of the full model's gain, from leaving out one "
            "tenth of the data at a time. It does not include a bias, such as that of friction."
        )
    return f"No band is drawn. {deviation_words(outcome)}"
