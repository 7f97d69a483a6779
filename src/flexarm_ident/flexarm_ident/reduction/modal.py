"""Modal model reduction and model updating (chapter 3).

The reduced model is realised directly in real numbers, with a pair of states per complex pair. The
thesis obtains real matrices by identification of the reduced model's simulated output (3-10); both
are realisations of the same triplet (3-9).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_ident.fitting.output_fit import fit_initial_states, fit_inputs, fit_outputs
from flexarm_ident.models.modes import modal_form, mode_table, ranked_modes
from flexarm_ident.models.state_space import stabilise, with_matrices
from flexarm_ident.records.iodata import as_records
from flexarm_ident.records.preprocess import output_scale

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.estimation.identification import Identification
    from flexarm_ident.models.modes import ModalForm, Mode
    from flexarm_ident.records.iodata import IoData

# Largest distance of a flexible mode from its known frequency (natural logarithm of the ratio).
_FARTHEST = 0.3
# MRM has a weight that falls with the distance: 0.6 at this one, 0.1 at twice as far.
_NEAR = 0.05
# Damping ratio below which a pair can be a flexible mode.
_VIBRATES = 0.3
# Below this part of the lowest known frequency a pair belongs to the rigid motion.
_SLOW = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class Reduction:
    """Reduced model and its modes.

    Attributes
    ----------
    model : control.StateSpace
        Reduced model in real block-diagonal form, inputs and outputs named.
    kept : tuple of str
        Labels of the modes that were kept, ``3/4`` for a pair.
    modes : tuple of Mode
        All modes of the full model, with both indices, ranks and whether they were kept.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    update_rank : int or None
        Numerical rank of the update's regression; None without an update.
    update_condition : float or None
        Its condition number.
    warnings : tuple of str
        Differences between result and request.
    """

    model: control.StateSpace
    kept: tuple[str, ...]
    modes: tuple[Mode, ...]
    x0: tuple[FloatArray, ...]
    update_rank: int | None
    update_condition: float | None
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<{type(self).__name__} order {self.order}, modes {', '.join(self.kept)}>"

    def _repr_html_(self) -> str:
        return mode_table(f"Reduced to order {self.order}.", self.modes, self.model.dt)

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.model.nstates)


def reduce_model(
    identification: Identification,
    data: IoData | Sequence[IoData],
    *,
    ranking: Literal["mrm", "msv", "mrmc"] = "mrm",
    order: int,
    known_modes_hz: Sequence[float] = (),
    update: Literal["b", "c", "none"] = "b",
) -> Reduction:
    """Keep the significant modes of an identified model and refit B or C to the data.

    Modes are taken in the order of the ranking; an unstable model is stabilised first. A pair is
    never split: with room for one state only, the next real mode takes its place. Without a real
    mode the model gets one state more than `order`.

    The MRMC ranking of section 3.2 keeps, for each known frequency, the flexible mode nearby with
    the strongest MRM, then adds the rigid motion (real modes and pairs below half the lowest known
    frequency) by MRM.

    Parameters
    ----------
    identification : Identification
        Identified model.
    data : IoData or sequence of IoData
        Records for the indices and the update, usually those of the identification.
    ranking : {'mrm', 'msv', 'mrmc'}
        Order of significance of the modes.
    order : int
        States to keep.
    known_modes_hz : sequence of float
        Frequencies of the flexible modes that 'mrmc' keeps.
    update : {'b', 'c', 'none'}
        Matrix that is refitted by output least squares: B (3-11), C (3-19) or neither.

    Returns
    -------
    Reduction
        The reduced model.

    Raises
    ------
    IdentificationError
        If order, ranking or update do not suit the model.
    """
    records = as_records(data)
    full = _stable_model(identification)
    _check_request(full, records, ranking, order, known_modes_hz, update=update)
    # Many reductions of one model rank the same modes.
    same = full is identification.model and records is identification.linear_records
    modes = identification.modes if same else ranked_modes(full, records, output_scale(records))
    kept, notes = _choose(modes, ranking, order, known_modes_hz)
    realised = truncate(full, [state for mode in kept for state in mode.states])
    updated = _updated(realised, records, update, at_rest=identification.at_rest)
    return Reduction(
        model=updated.model,
        kept=tuple(mode.label for mode in kept),
        modes=tuple(replace(mode, kept=mode in kept) for mode in modes),
        x0=updated.x0,
        update_rank=updated.rank,
        update_condition=updated.condition,
        warnings=tuple(notes),
    )


def truncate(model: control.StateSpace, states: Sequence[int]) -> control.StateSpace:
    """Return a real model of some states of the modal form (3-9).

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    states : sequence of int
        States of its modal form to keep, both of a pair.

    Raises
    ------
    IdentificationError
        If a pair would be split.
    """
    form = modal_form(model)
    groups = [group for group in form.groups if set(group) & set(states)]
    for group in groups:
        if not set(group) <= set(states):
            pair = "/".join(str(state + 1) for state in group)
            raise IdentificationError(f"states {pair} are one complex pair: keep both or none")
    blocks = [_real_block(form, group) for group in groups]
    size = sum(len(group) for group in groups)
    A = np.zeros((size, size))
    at = 0
    for block, _, _ in blocks:
        A[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return with_matrices(
        model,
        A=A,
        B=np.vstack([np.empty((0, model.ninputs)), *(b for _, b, _ in blocks)]),
        C=np.hstack([np.empty((model.noutputs, 0)), *(c for _, _, c in blocks)]),
    )


def _real_block(
    form: ModalForm, group: tuple[int, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    i = group[0]
    lam, b, c = form.eigenvalues[i], form.B[i], form.C[:, i]
    if len(group) == 1:
        return np.array([[lam.real]]), b.real[np.newaxis], c.real[:, np.newaxis]
    # States are real and imaginary part of the modal state; its conjugate doubles the output.
    A = np.array([[lam.real, -lam.imag], [lam.imag, lam.real]])
    return A, np.stack([b.real, b.imag]), 2.0 * np.stack([c.real, -c.imag], axis=1)


def _stable_model(identification: Identification) -> control.StateSpace:
    model = identification.model
    # The hub of an arm that is fitted with friction is free: next to 1 is an integrator.
    A, moved = stabilise(model.A, "mirror" if identification.friction is None else "integrator")
    return with_matrices(model, A=A) if moved else model


class _Update(NamedTuple):
    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    rank: int | None
    condition: float | None


def _updated(
    model: control.StateSpace, records: Sequence[IoData], update: str, *, at_rest: bool
) -> _Update:
    if update == "b":
        driven = _without_feedthrough(model, records)
        inputs = fit_inputs(model.A, model.C, driven, at_rest=at_rest)
        refitted = with_matrices(model, B=inputs.B)
        return _Update(refitted, inputs.x0, inputs.rank, inputs.condition)
    rest = (np.zeros(model.nstates),) * len(records)
    x0 = rest if at_rest else fit_initial_states(model, records)
    if update == "none":
        return _Update(model, x0, None, None)
    outputs = fit_outputs(model, x0, records)
    refitted = with_matrices(model, C=outputs.C)
    return _Update(refitted, x0, outputs.rank, outputs.condition)


def _without_feedthrough(
    model: control.StateSpace, records: Sequence[IoData]
) -> tuple[IoData, ...]:
    if not np.any(model.D):
        return tuple(records)
    return tuple(replace(record, y=record.y - record.u @ model.D.T) for record in records)


def _choose(
    modes: Sequence[Mode], ranking: str, order: int, known_modes_hz: Sequence[float]
) -> tuple[list[Mode], list[str]]:
    notes: list[str] = []
    queue = sorted(modes, key=lambda mode: mode.msv_rank if ranking == "msv" else mode.mrm_rank)
    if ranking == "mrmc":
        flexible, notes = _flexible(modes, known_modes_hz)
        slow_hz = _SLOW * min(known_modes_hz)
        rigid = [mode for mode in queue if mode.frequency_hz < slow_hz and mode not in flexible]
        others = [mode for mode in queue if mode not in flexible and mode not in rigid]
        queue = flexible + rigid + others
    kept: list[Mode] = []
    room = order
    for mode in queue:
        if len(mode.states) <= room:
            kept.append(mode)
            room -= len(mode.states)
    if room:
        pair = next(mode for mode in queue if mode not in kept)
        kept.append(pair)
        notes.append(f"order {order + 1} instead of {order}: only complex pairs are left")
    return sorted(kept, key=lambda mode: mode.states), notes


def _flexible(
    modes: Sequence[Mode], known_modes_hz: Sequence[float]
) -> tuple[list[Mode], list[str]]:
    chosen: list[Mode] = []
    notes = []
    for known_hz in known_modes_hz:
        near = [
            (mode.mrm * np.exp(-0.5 * (distance / _NEAR) ** 2), mode)
            for mode in modes
            if mode.is_pair and mode.damping_ratio < _VIBRATES and mode not in chosen
            for distance in [abs(np.log(mode.frequency_hz / known_hz))]
            if distance < _FARTHEST
        ]
        if near:
            chosen.append(max(near, key=lambda scored: scored[0])[1])
        else:
            notes.append(f"no flexible mode near {known_hz:g} Hz: none was kept for it")
    return chosen, notes


def _check_request(
    model: control.StateSpace,
    records: Sequence[IoData],
    ranking: str,
    order: int,
    known_modes_hz: Sequence[float],
    *,
    update: str,
) -> None:
    if ranking not in ("mrm", "msv", "mrmc"):
        raise IdentificationError(f"ranking must be mrm, msv or mrmc: {ranking!r}")
    if update not in ("b", "c", "none"):
        raise IdentificationError(f"update must be b, c or none: {update!r}")
    if not 1 <= order <= model.nstates:
        raise IdentificationError(
            f"order must lie between 1 and the model's {model.nstates}: {order}; "
            "keep fewer states or identify with a higher order"
        )
    if ranking == "mrmc":
        if len(known_modes_hz) == 0 or min(known_modes_hz) <= 0.0:
            raise IdentificationError(
                "mrmc needs known_modes_hz, the positive frequencies of the flexible modes"
            )
        if order < min(2 * len(known_modes_hz), model.nstates):
            raise IdentificationError(
                f"order {order} is too small for {len(known_modes_hz)} known modes: "
                f"each takes two states"
            )
    channels = (list(records[0].inputs), list(records[0].outputs))
    if channels != (list(model.input_labels), list(model.output_labels)):
        raise IdentificationError(
            f"the record's channels {channels} differ from the model's "
            f"{(list(model.input_labels), list(model.output_labels))}"
        )
