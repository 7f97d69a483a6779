"""From records to a model: the steps of section 2.2.3 in one call."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import control
import numpy as np

from flexarm_ident import orse
from flexarm_ident.errors import DataError, IdentificationError
from flexarm_ident.gram import block_gram
from flexarm_ident.iodata import as_records
from flexarm_ident.modes import mode_table
from flexarm_ident.order import candidate_orders, choose_order, stable_orders, suggest_order
from flexarm_ident.output_fit import fit_inputs
from flexarm_ident.poles import is_stable, stabilise
from flexarm_ident.preprocess import output_scale

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.iodata import IoData
    from flexarm_ident.modes import Mode
    from flexarm_ident.orse import RangeSpace

METHODS = ("orse", "orse_iv", "orse_thesis")
_SMALLEST_BLOCK_ROWS = 2
_LARGE_OFFSET = 1e3
_FULL_SCALE_V = 9.99


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified model and how it came about.

    Attributes
    ----------
    model : control.StateSpace
        Discrete model with named inputs and outputs.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    order : int
        Number of states.
    method : str
        Method that was used.
    block_rows : int
        Block rows of the Hankel matrices, q of (2-18).
    singular_values : ndarray
        Singular values of (2-21), descending.
    fit_error : ndarray, (outputs,)
        Relative simulation error of each output over the records (2-25).
    input_condition : float
        Condition number of the inputs' product matrix U U'.
    fit_condition : float
        Condition number of the regression for B and x0.
    moved_eigenvalues : int
        Number of unstable eigenvalues that were moved inside the unit circle.
    warnings : tuple of str
        What a user should know before trusting the model.
    range_space : RangeSpace
        Base vectors, from which models of other orders follow.
    records : tuple of IoData
        The records that were fitted.
    """

    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    order: int
    method: str
    block_rows: int
    singular_values: FloatArray
    fit_error: FloatArray
    input_condition: float
    fit_condition: float
    moved_eigenvalues: int
    warnings: tuple[str, ...]
    range_space: RangeSpace = field(repr=False)
    records: tuple[IoData, ...] = field(repr=False)

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """Modes with frequency, damping, MSV and MRM over the records."""
        return mode_table(self.model, self.records, output_scale(self.records))

    @cached_property
    def stable_orders(self) -> tuple[int, ...]:
        """Orders whose model is stable before any eigenvalue is moved (Tables 2-1 to 2-4)."""
        return stable_orders(self.range_space, candidate_orders(self.range_space))

    @property
    def suggested_order(self) -> int:
        """Order before the widest gap of the singular values (2-22)."""
        return suggest_order(self.singular_values, candidate_orders(self.range_space)[-1])


def identify(
    data: IoData | Sequence[IoData],
    *,
    order: int | None = None,
    block_rows: int = 40,
    method: str = "orse",
    stable: bool = True,
    feedthrough: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Identification:
    """Identify a discrete state-space model from one or several records.

    Parameters
    ----------
    data : IoData or sequence of IoData
        Records of one rig; several are fitted by one model, each with its own initial state.
    order : int, optional
        Number of states, less than `block_rows`. By default the smallest of 7 to 36 whose model is
        stable and simulates the records within 2 % of the best.
    block_rows : int
        Block rows of the Hankel matrices, q of (2-18).
    method : {'auto', 'orse', 'orse_iv', 'orse_thesis'}
        ORSE with outputs scaled by their innovation ('orse'), with past data as instruments
        ('orse_iv'), or with the thesis's own scaling ('orse_thesis'). 'auto' takes 'orse_iv' for
        closed-loop records, in which noise reaches the input, and 'orse' for others.
    stable : bool
        Move unstable eigenvalues inside the unit circle before B is fitted (section 3.2).
    feedthrough : bool
        Fit D. The rig has none: a command acts after the sample it answers.
    progress : callable, optional
        Called with the name of the stage and the part of it that is done.

    Returns
    -------
    Identification
        The model, the records' initial states and what there is to say about them.

    Raises
    ------
    IdentificationError
        If the data or the request do not allow an identification.
    """
    records = as_records(data)
    report = progress or _silent
    if method == "auto":
        method = "orse_iv" if any(record.closed_loop for record in records) else "orse"
    _check_request(records, order, block_rows, method)
    report("gram", 0.0)
    space = _range_space(records, block_rows, method)
    report("range space", 1.0)
    if order is None:
        order = choose_order(space, records, feedthrough=feedthrough, progress=progress)
    raw = orse.state_matrices(space, order)
    A, moved = stabilise(raw.A) if stable else (raw.A, 0)
    fit = fit_inputs(A, raw.C, records, feedthrough=feedthrough)
    report("fit", 1.0)
    first = records[0]
    model = control.ss(
        A, fit.B, raw.C, fit.D, first.dt_s, inputs=list(first.inputs), outputs=list(first.outputs)
    )
    notes = _data_warnings(records, method) + _input_warnings(space)
    if moved:
        notes.append(f"{moved} unstable eigenvalues of order {order} were moved inside the circle")
    elif not is_stable(A):
        notes.append(f"the model of order {order} is unstable")
    return Identification(
        model=model,
        x0=fit.x0,
        order=order,
        method=method,
        block_rows=block_rows,
        singular_values=space.singular_values,
        fit_error=fit.error,
        input_condition=space.condition,
        fit_condition=fit.condition,
        moved_eigenvalues=moved,
        warnings=tuple(notes),
        range_space=space,
        records=records,
    )


def _silent(_stage: str, _fraction: float) -> None:
    pass


def _range_space(records: Sequence[IoData], block_rows: int, method: str) -> RangeSpace:
    if method == "orse_iv":
        return orse.past_instruments(block_gram(records, 2 * block_rows))
    gram = block_gram(records, block_rows)
    if method == "orse_thesis":
        return orse.plain(gram, output_scale(records))
    return orse.innovation_scaled(gram)


def _check_request(
    records: Sequence[IoData], order: int | None, block_rows: int, method: str
) -> None:
    if method not in METHODS:
        raise IdentificationError(f"method must be one of auto, {', '.join(METHODS)}: {method!r}")
    if block_rows < _SMALLEST_BLOCK_ROWS:
        raise IdentificationError(f"block_rows must be 2 or more: {block_rows}")
    outputs = records[0].y.shape[1]
    largest = min(block_rows - 1, (block_rows - 1) * outputs)
    if order is not None and not 1 <= order <= largest:
        raise IdentificationError(
            f"order must lie between 1 and {largest} for block_rows = {block_rows}: {order}"
        )
    shifts = 2 * block_rows if method == "orse_iv" else block_rows
    needed = shifts * (records[0].u.shape[1] + outputs + 1)
    for record in records:
        if len(record) < needed:
            raise DataError(
                f"{record.label}: {len(record)} samples are too few, {block_rows} block rows need "
                f"at least {needed}: record longer or lower block_rows"
            )
    for channel, name in enumerate(records[0].inputs):
        if all(np.ptp(record.u[:, channel]) == 0.0 for record in records):
            raise DataError(
                f"{records[0].label}: input {name} is constant, it excites nothing: "
                "record with a changing input"
            )


def _data_warnings(records: Sequence[IoData], method: str) -> list[str]:
    notes = []
    if any(record.closed_loop for record in records):
        notes.append(
            "closed-loop data: the controller feeds noise back into the input, so "
            + ("plain ORSE is biased" if method == "orse_thesis" else "a small bias remains")
        )
    for record in records:
        names = (*record.outputs, *record.inputs)
        lowest = np.hstack([record.y.min(axis=0), record.u.min(axis=0)])
        highest = np.hstack([record.y.max(axis=0), record.u.max(axis=0)])
        for name, low, high in zip(names, lowest, highest, strict=True):
            peak = max(-low, high)
            if abs(low + high) > _LARGE_OFFSET * (high - low):
                notes.append(f"{record.label}: {name} is almost all offset: remove its bias first")
            if name.endswith("_v") and peak >= _FULL_SCALE_V:
                notes.append(f"{record.label}: {name} reaches {peak:.2f} V and may be saturated")
    return notes


def _input_warnings(space: RangeSpace) -> list[str]:
    if space.condition < orse.SINGULAR_CONDITION:
        return []
    note = (
        f"the input excites few frequencies: U U' has the condition number {space.condition:.0e}, "
        "a pseudo-inverse was used and modes outside its band are not to be trusted"
    )
    return [note]
