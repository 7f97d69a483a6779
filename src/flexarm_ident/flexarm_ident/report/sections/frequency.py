"""Response sections: outputs of the model over the frequency, and after a unit step."""

from __future__ import annotations

import math
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.labels import label_and_unit
from flexarm_ident.models.modes import frequency_grid
from flexarm_ident.models.state_space import simulate
from flexarm_ident.report.content.blocks import Heading, Plots, Section, Words
from flexarm_ident.report.content.wording import deviation_words
from flexarm_ident.report.plots import marks
from flexarm_ident.report.plots.chart import Panel, View, chart
from flexarm_ident.report.plots.frequency_plot import frequency_plot
from flexarm_ident.report.plots.marks import Axis

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.models.modes import Mode
    from flexarm_ident.report.content.blocks import Block, Subject
    from flexarm_ident.workflow.outcome import Outcome

_RESPONSES_SHOWN = 12
_MEASURED = (
    "The grey curve is the response by averaged spectra, where the output is coherent with the "
    "inputs. The coherence is below it, with the line that chance exceeds at one frequency in a "
    "hundred. In a closed loop this response is biased by the noise that the controller feeds back."
)
# More responses than these are a page of their own.
_CHANNELS = 12
_LOOKS = (marks.SOLID, marks.DASHED)
# Time constants after which a motion has decayed to 2 %.
_DECAYED = 4.0
_FEWEST, _MOST = 20, 3000


def _build(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    record = max(outcome.records, key=len)
    full = outcome.identification.model
    models = _models(outcome)
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


def _models(outcome: Outcome) -> dict[str, control.StateSpace]:
    """Return the full and the reduced model by their names."""
    full = outcome.identification.model
    models = {f"full, {full.nstates} states": full}
    if outcome.reduction is not None:
        reduced = outcome.reduction.model
        models[f"reduced, {reduced.nstates} states"] = reduced
    return models


def _band_words(outcome: Outcome, known: bool) -> str:  # noqa: FBT001 - the one question
    if known:
        return (
            "The band is ± two standard deviations of the full model's gain, from leaving out one "
            "tenth of the data at a time. It does not include a bias, such as that of friction."
        )
    return f"No band is drawn. {deviation_words(outcome)}"


def _stepped(subject: Subject) -> Iterator[Block]:
    outcome = subject.outcome
    record = outcome.records[0]
    full = outcome.identification.model
    models = _models(outcome)
    samples = settling_samples(outcome.modes, full.dt)
    yield Words(
        "Outputs after a step of one input from 0 to 1 in its unit, from rest. The plots end when "
        "the slowest oscillating mode has decayed to 2 %; an output that integrates still moves "
        "then. Dry friction is not in these linear responses."
    )
    plots = (
        (
            f"{label_and_unit(output)[0]} from {label_and_unit(source)[0]}",
            step_response_plot(models, i, j, samples, names=(output, source)),
        )
        for j, source in enumerate(record.inputs)
        for i, output in enumerate(record.outputs)
    )
    yield Plots(tuple(islice(plots, _CHANNELS)))


STEP_RESPONSE = Section(105, "Step response", _stepped)


def settling_samples(modes: Sequence[Mode], dt_s: float) -> int:
    """Return the samples until the slowest decaying mode has decayed to 2 %.

    Real modes count only where no mode oscillates: an arm's slow ones stand for friction.
    """
    decays = [
        (mode.is_pair, -_DECAYED / math.log(abs(mode.eigenvalue)))
        for mode in modes
        if 0.0 < abs(mode.eigenvalue) < 1.0
    ]
    oscillating = [samples for is_pair, samples in decays if is_pair]
    slowest = max(oscillating or [samples for _, samples in decays], default=1.0 / dt_s)
    return int(np.clip(slowest, _FEWEST, _MOST))


def step_response_plot(
    models: Mapping[str, control.StateSpace],
    output: int,
    source: int,
    samples: int,
    *,
    names: tuple[str, str],
) -> str:
    """Plot an output of discrete models after a unit step of one input.

    Parameters
    ----------
    models : mapping of str to control.StateSpace
        At most two models with the same signals, by their names.
    output, source : int
        Numbers of the output and of the input.
    samples : int
        Length of the response.
    names : tuple of str
        Names of output and input, each with its unit at the end.
    """
    curves = []
    for (label, model), look in zip(models.items(), _LOOKS, strict=False):
        response = step_response(model, output, source, samples)
        curves.append(marks.line(model.dt * np.arange(samples), response, look, label))
    (words, unit), (drive, drive_unit) = map(label_and_unit, names)
    per = f", {unit}/{drive_unit}" if unit and drive_unit else ""
    y = Axis.around(f"{words}{per}", [*(curve.y for curve in curves), [0.0]])
    end_s = float(curves[0].x[-1])
    about = f"{words} after a unit step of {drive}"
    return chart(View(about, Axis("time, s", 0.0, end_s), [Panel(y, curves)]))


def step_response(model: control.StateSpace, output: int, source: int, samples: int) -> FloatArray:
    """Return an output, (samples,), after a unit step of one input, from rest."""
    u = np.zeros((samples, model.ninputs))
    u[:, source] = 1.0
    return simulate(model, u)[:, output]
