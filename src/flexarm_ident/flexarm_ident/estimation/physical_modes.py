"""Physical modes: those that recur over the orders, answer the inputs, and are known well.

A mode that recurs may still belong to a steady disturbance, such as the mains, or to what a high
order makes of noise. Neither answers the recorded inputs: its mean response to them (3-8) is far
below that of the strongest mode.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from flexarm_core.errors import IdentificationError
from flexarm_ident.diagnostics.stabilisation import Criteria
from flexarm_ident.fitting.stable_fit import fit_stable
from flexarm_ident.models.modes import ranked_modes
from flexarm_ident.models.state_space import WAYS, state_space
from flexarm_ident.records.preprocess import output_scale

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.diagnostics.stabilisation import RecurringMode, Stabilisation
    from flexarm_ident.models.modes import Mode
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.subspace_protocol import Subspace

# Response in units of the strongest vibration's. A weaker mode adds at most so much to an error
# (2-25), a tenth of what a good model may miss.
_HEARD = 0.02
# Standard deviation of the frequency over the orders. A mode of a plant is at one place; one that
# describes noise wanders within the width of its cluster, a tenth.
_SCATTER = 0.03
# Bending modes stand farther apart; one mode that high orders split stands this near to itself.
NEAR = 0.06
"""Distance of neighbours of which one at most is the plant's, in units of their frequency."""
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
        Whether it is heard and stays at its place.
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
    def vibrations(order: int) -> tuple[Mode, ...]:
        modes = _modes(space, order, records, feedthrough=feedthrough)
        return tuple(
            mode for mode in modes if mode.is_pair and abs(mode.damping_ratio) <= largest_damping
        )

    judged = []
    for mode in diagram.modes:
        others = vibrations(mode.orders[-1])
        strongest = max((each.mrm for each in others), default=0.0)
        weight = _nearest(others, mode.frequency_hz).mrm / strongest if strongest > 0.0 else 0.0
        stays = mode.frequency_std_hz <= _SCATTER * mode.frequency_hz
        judged.append(JudgedMode(mode, weight, weight >= _HEARD and stays))
    return tuple(judged)


def recurring(
    mode: Mode, judged: Sequence[JudgedMode], criteria: Criteria | None = None
) -> JudgedMode | None:
    """Return which of the recurring modes a mode of one model is; None for one that does not recur.

    The frequency of a mode drifts over the orders, so it is compared with those of all of them and
    not with their median.

    Parameters
    ----------
    mode : Mode
        Mode of a model of any order.
    judged : sequence of JudgedMode
        Modes that recur, as `judged_modes` returns them.
    criteria : Criteria, optional
        Largest damping ratio of a vibration, and relative change of its frequency.
    """
    limits = criteria or Criteria()

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
    groups: list[list[float]] = []
    for frequency_hz in (each.mode.frequency_hz for each in judged if each.is_physical):
        if groups and frequency_hz - groups[-1][-1] < NEAR * frequency_hz:
            groups[-1].append(frequency_hz)
        else:
            groups.append([frequency_hz])
    return [tuple(group) for group in groups if len(group) > 1]


def _nearest(modes: Sequence[Mode], frequency_hz: float) -> Mode:
    return min(modes, key=lambda mode: abs(mode.frequency_hz - frequency_hz))


def _modes(
    space: Subspace, order: int, records: Sequence[IoData], *, feedthrough: bool
) -> tuple[Mode, ...]:
    """Return the modes of a model of one order; none when it is too unstable to be fitted."""
    raw = space.matrices(order)
    try:
        A, fit, *_ = fit_stable(
            *(raw.A, raw.C, records, WAYS), feedthrough=feedthrough, noise_weighted=True
        )
    except IdentificationError:
        return ()
    model = state_space(A, fit.B, raw.C, fit.D, records[0].dt_s)
    return ranked_modes(model, records, output_scale(records))
