"""Physical modes: those that recur over the orders, answer the inputs, and are known well.

A mode that recurs may still belong to a steady disturbance, such as the mains, or to what a high
order makes of noise. Neither answers the recorded inputs: its mean response to them (3-8) is far
below that of the strongest mode. On a plant without any vibration all of them are noise, and the
strongest is not a measure: the response must also stand out of the error of the simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.diagnostics.stabilisation import Criteria
from flexarm_ident.fitting.stable_fit import fit_stable
from flexarm_ident.models.modes import modal_form, modal_response, ranked_modes
from flexarm_ident.models.state_space import WAYS, simulate, state_space
from flexarm_ident.records.preprocess import output_scale

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.diagnostics.stabilisation import RecurringMode, Stabilisation
    from flexarm_ident.models.modes import ModalForm, Mode
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.subspace_protocol import Subspace

# A weaker mode adds at most so much to an error (2-25), a tenth of what a good model may miss.
HEARD = 0.02
"""Response (3-8) in units of the strongest vibration's from which a mode is heard."""
# Energy of the response in units of the error's in one line of its spectrum there. A mode that is
# fitted to noise explains about as many lines as it has parameters, from the strongest on: up to
# some 15 in records of thousands of samples. Modes of plants have hundreds.
_EVIDENT = 30.0
# Lines whose mean is the error near a frequency: those within a fifth of it, and at least so many.
_NEAR_ERROR, _FEWEST_LINES = 0.2, 8
# Standard deviation of the frequency over the orders. A mode of a plant is at one place; one that
# describes noise wanders within the width of its cluster, a tenth.
_SCATTER = 0.03
# Bending modes stand farther apart; one mode that high orders split stands this near to itself.
NEAR = 0.06
"""Distance of neighbours of which one at most is the plant's, in units of their frequency."""
_OTHER_SHAPE = 0.5
_DISTINCT = 4.0
PHYSICAL, SPLIT, NOISE = "physical", "split", "noise"
"""What a recurring mode is: the plant's, one of neighbours of which at most one is, or neither."""


@dataclass(frozen=True, eq=False)
class JudgedMode:
    """Mode that recurs over the orders, and whether it is one of the plant.

    Attributes
    ----------
    mode : RecurringMode
        The mode.
    weight : float
        Its mean response to the recorded inputs (3-8), in units of the strongest vibration's.
    is_physical : bool
        Whether it is heard, stands out of the error and stays at its place.
    """

    mode: RecurringMode
    weight: float
    is_physical: bool


def judged_modes(
    diagram: Stabilisation,
    space: Subspace,
    records: Sequence[IoData],
    *,
    feedthrough: bool,
    largest_damping: float,
) -> tuple[JudgedMode, ...]:
    """Judge the modes that recur over the orders by their response to the recorded inputs.

    Each is weighed in the model of the highest order that has it.

    Parameters
    ----------
    diagram : Stabilisation
        The diagram with the modes.
    space : Subspace
        Source of the models.
    records : sequence of IoData
        Records whose inputs drive the modes.
    feedthrough : bool
        Whether D is fitted.
    largest_damping : float
        Largest damping ratio of a vibration.
    """

    @cache
    def weighing(order: int) -> _Weighing:
        return _weighing(space, order, records, largest_damping, feedthrough=feedthrough)

    judged = []
    for mode in diagram.modes:
        form, vibrations, spectra = weighing(mode.orders[-1])
        strongest = max((each.mrm for each in vibrations), default=0.0)
        if form is None or strongest <= 0.0:
            judged.append(JudgedMode(mode, 0.0, False))  # noqa: FBT003 - a field of the result
            continue
        own = min(vibrations, key=lambda each: abs(each.frequency_hz - mode.frequency_hz))
        weight = own.mrm / strongest
        stays = mode.frequency_std_hz <= _SCATTER * mode.frequency_hz
        is_heard = weight >= HEARD and _evidence(own, form, records, spectra) >= _EVIDENT
        judged.append(JudgedMode(mode, weight, is_heard and stays))
    return tuple(judged)


def recurring(mode: Mode, judged: Sequence[JudgedMode]) -> JudgedMode | None:
    """Return which of the recurring modes a mode of one model is; None for one that does not recur.

    The frequency of a mode drifts over the orders, so it is compared with those of all of them and
    not with their median.

    Parameters
    ----------
    mode : Mode
        Mode of a model of any order.
    judged : sequence of JudgedMode
        Modes that recur, as `judged_modes` returns them.
    """
    limits = Criteria()

    def apart(each: JudgedMode) -> float:
        return min(abs(hz - mode.frequency_hz) for hz in each.mode.frequencies_hz)

    if not (judged and mode.is_pair and 0.0 < mode.damping_ratio <= limits.largest_damping):
        return None
    nearest = min(judged, key=apart)
    return nearest if apart(nearest) <= limits.frequency * mode.frequency_hz else None


def standings(judged: Sequence[JudgedMode]) -> list[str]:
    """Return what each of the modes is that recur, by rising frequency: a word of the above."""
    doubtful = {frequency_hz for group in near_modes(judged) for frequency_hz in group}
    kept = {True: SPLIT, False: PHYSICAL}
    return [
        kept[each.mode.frequency_hz in doubtful] if each.is_physical else NOISE for each in judged
    ]


def standing_of(mode: Mode, judged: Sequence[JudgedMode]) -> str | None:
    """Return what a mode of one model is, as `standings`; None for one that does not recur."""
    found = recurring(mode, judged)
    return None if found is None else standings(judged)[judged.index(found)]


def standing_as(wanted: str, judged: Sequence[JudgedMode]) -> list[RecurringMode]:
    """Return those of the modes that recur which are what is wanted."""
    found = zip(judged, standings(judged), strict=True)
    return [each.mode for each, standing in found if standing == wanted]


def near_modes(judged: Sequence[JudgedMode]) -> list[tuple[float, ...]]:
    """Return the frequencies of physical modes that stand too near to each other, in groups.

    Parameters
    ----------
    judged : sequence of JudgedMode
        Modes that recur, by rising frequency.
    """
    groups: list[list[RecurringMode]] = []
    for mode in (each.mode for each in judged if each.is_physical):
        if groups and not _are_two(groups[-1][-1], mode):
            groups[-1].append(mode)
        else:
            groups.append([mode])
    return [tuple(mode.frequency_hz for mode in group) for group in groups if len(group) > 1]


def _are_two(lower: RecurringMode, upper: RecurringMode) -> bool:
    """Return whether two modes are far apart, or move differently and keep their distance."""
    apart_hz = upper.frequency_hz - lower.frequency_hz
    if apart_hz >= NEAR * upper.frequency_hz:
        return True
    # Modal assurance criterion: 1 for the same shape, as with one output always.
    powers = (np.vdot(each.shape, each.shape).real for each in (lower, upper))
    mac = abs(np.vdot(lower.shape, upper.shape)) ** 2 / np.prod(list(powers))
    scatter_hz = np.hypot(lower.frequency_std_hz, upper.frequency_std_hz)
    return bool(mac < _OTHER_SHAPE and apart_hz > _DISTINCT * scatter_hz)


class _Weighing(NamedTuple):
    """Model of one order with its vibrations, and how its simulation of each record errs.

    The form is None where the model is too unstable to be fitted. The spectra, (lines, outputs),
    are the energy of the error in each line of the discrete Fourier transform.
    """

    form: ModalForm | None
    vibrations: tuple[Mode, ...] = ()
    spectra: tuple[FloatArray, ...] = ()


def _weighing(
    space: Subspace,
    order: int,
    records: Sequence[IoData],
    largest_damping: float,
    *,
    feedthrough: bool,
) -> _Weighing:
    raw = space.matrices(order)
    try:
        A, fit, *_ = fit_stable(
            *(raw.A, raw.C, records, WAYS), feedthrough=feedthrough, noise_weighted=True
        )
    except IdentificationError:
        return _Weighing(None)
    model = state_space(A, fit.B, raw.C, fit.D, records[0].dt_s)
    modes = ranked_modes(model, records, output_scale(records))
    vibrations = tuple(
        mode for mode in modes if mode.is_pair and abs(mode.damping_ratio) <= largest_damping
    )
    spectra = tuple(
        _spectrum(np.nan_to_num(record.y_usable - simulate(model, record.u, x0)))
        for record, x0 in zip(records, fit.x0, strict=True)
    )
    return _Weighing(modal_form(model), vibrations, spectra)


def _spectrum(error: FloatArray) -> FloatArray:
    return np.asarray(2.0 / len(error) * np.abs(np.fft.rfft(error, axis=0)) ** 2)


def _evidence(
    mode: Mode,
    form: ModalForm,
    records: Sequence[IoData],
    spectra: Sequence[FloatArray],
) -> float:
    """Return the energy of a mode's response in units of the error's in one line near it.

    It is that in the output where it is largest.
    """
    energy, lines = np.zeros(len(form.C)), []
    for record, power in zip(records, spectra, strict=True):
        energy += np.sum(modal_response(form, mode.states, record.u) ** 2, axis=0)
        line_hz = 1.0 / (len(record) * record.dt_s)
        width_hz = max(_NEAR_ERROR * mode.frequency_hz, 0.5 * _FEWEST_LINES * line_hz)
        away_hz = np.abs(line_hz * np.arange(len(power)) - mode.frequency_hz)
        lines.append(power[away_hz <= width_hz])
    of_a_line = np.mean(np.concatenate(lines), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.max(np.where(energy > 0.0, energy / of_a_line, 0.0)))
