"""From records to a model: the steps of section 2.2.3 in one call."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import control
import numpy as np

from flexarm_ident import orse
from flexarm_ident.arrays import column_range
from flexarm_ident.errors import DataError, IdentificationError
from flexarm_ident.feedback import feedback_test
from flexarm_ident.gram import block_gram
from flexarm_ident.iodata import as_records
from flexarm_ident.modes import mode_table
from flexarm_ident.order import candidate_orders, choose_order, stable_orders, suggest_order
from flexarm_ident.output_fit import fit_inputs
from flexarm_ident.poles import is_stable, stabilise
from flexarm_ident.predictor import predictor_space
from flexarm_ident.preprocess import output_scale
from flexarm_ident.quality import assess
from flexarm_ident.stabilisation import stabilisation, subspace_matrices
from flexarm_ident.uncertainty import jackknife, mode_uncertainty

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.gram import BlockGram
    from flexarm_ident.iodata import IoData
    from flexarm_ident.modes import Mode
    from flexarm_ident.orse import Subspace
    from flexarm_ident.quality import DataWarning
    from flexarm_ident.stabilisation import Stabilisation
    from flexarm_ident.uncertainty import ModeUncertainty

METHODS = ("orse", "orse_iv", "pbsid", "orse_thesis")
_SMALLEST_BLOCK_ROWS = 2


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
    notes : tuple of str
        What the estimation itself had to do about the model.
    gram : BlockGram
        Products of the data.
    subspace : Subspace
        What models of other orders follow from.
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
    notes: tuple[str, ...]
    gram: BlockGram = field(repr=False)
    subspace: Subspace = field(repr=False)
    records: tuple[IoData, ...] = field(repr=False)

    @cached_property
    def data_warnings(self) -> tuple[DataWarning, ...]:
        """What the records cannot carry, each with its name and figures."""
        return assess(self.records, self.gram, feedthrough=bool(np.any(self.model.D)))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know before trusting the model."""
        return (*(warning.text for warning in self.data_warnings), *self.notes)

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """Modes with frequency, damping, MSV and MRM over the records."""
        return mode_table(self.model, self.records, output_scale(self.records))

    @cached_property
    def mode_uncertainty(self) -> tuple[ModeUncertainty, ...]:
        """Standard deviations of `modes`, in their order; empty when the records are too short."""

        def estimate(gram: BlockGram) -> orse.StateMatrices:
            feedthrough = bool(np.any(self.model.D))
            space = _subspace(gram, self.records, self.method, feedthrough=feedthrough)
            return space.matrices(self.order)

        try:
            found = jackknife(self.records, self.gram.block_rows, estimate)
        except DataError:
            return ()
        return mode_uncertainty(found, self.model)

    @cached_property
    def diagram(self) -> Stabilisation:
        """Stabilisation diagram: which modes come back over the orders."""
        space = self.subspace
        return stabilisation(subspace_matrices(space), space.output_scale, self.model.dt)

    @cached_property
    def stable_orders(self) -> tuple[int, ...]:
        """Orders whose model is stable before any eigenvalue is moved (Tables 2-1 to 2-4)."""
        return stable_orders(self.subspace, candidate_orders(self.subspace))

    @property
    def suggested_order(self) -> int:
        """Order before the widest gap of the singular values (2-22)."""
        return suggest_order(self.singular_values, candidate_orders(self.subspace)[-1])


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
    method : {'auto', 'orse', 'orse_iv', 'pbsid', 'orse_thesis'}
        ORSE with outputs scaled by their innovation ('orse'), with past data as instruments
        ('orse_iv'), or with the thesis's own scaling ('orse_thesis'); PBSID-opt ('pbsid'). 'auto'
        takes 'orse_iv' where noise reaches the input, known from the record or found by a test for
        feedback, and 'orse' elsewhere.
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
    _check_request(records, order, block_rows, method)
    report("gram", 0.0)
    if method == "auto":
        method = _automatic(records, block_rows, feedthrough=feedthrough)
    gram = block_gram(records, 2 * block_rows if method == "orse_iv" else block_rows)
    space = _subspace(gram, records, method, feedthrough=feedthrough)
    report("range space", 1.0)
    if order is None:
        order = choose_order(space, records, feedthrough=feedthrough, progress=progress)
    raw = space.matrices(order)
    A, moved = stabilise(raw.A) if stable else (raw.A, 0)
    fit = fit_inputs(A, raw.C, records, feedthrough=feedthrough)
    report("fit", 1.0)
    first = records[0]
    model = control.ss(
        A, fit.B, raw.C, fit.D, first.dt_s, inputs=list(first.inputs), outputs=list(first.outputs)
    )
    notes = []
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
        notes=tuple(notes),
        gram=gram,
        subspace=space,
        records=records,
    )


def _silent(_stage: str, _fraction: float) -> None:
    pass


def _automatic(records: Sequence[IoData], block_rows: int, *, feedthrough: bool) -> str:
    """Choose past instruments where noise reaches the input, else the innovation scaling."""
    if any(record.closed_loop for record in records):
        return "orse_iv"
    gram = block_gram(records, block_rows)
    return "orse_iv" if feedback_test(records, gram, feedthrough=feedthrough).detected else "orse"


def _subspace(
    gram: BlockGram, records: Sequence[IoData], method: str, *, feedthrough: bool
) -> Subspace:
    if method == "orse_iv":
        return orse.past_instruments(gram)
    if method == "pbsid":
        return predictor_space(gram, feedthrough=feedthrough)
    if method == "orse_thesis":
        return orse.plain(gram, output_scale(records))
    return orse.innovation_scaled(gram)


def _check_request(
    records: Sequence[IoData], order: int | None, block_rows: int, method: str
) -> None:
    if method not in ("auto", *METHODS):
        raise IdentificationError(f"method must be one of auto, {', '.join(METHODS)}: {method!r}")
    if block_rows < _SMALLEST_BLOCK_ROWS:
        raise IdentificationError(f"block_rows must be 2 or more: {block_rows}")
    outputs = records[0].y.shape[1]
    largest = min(block_rows - 1, (block_rows - 1) * outputs)
    if order is not None and not 1 <= order <= largest:
        raise IdentificationError(
            f"order must lie between 1 and {largest} for block_rows = {block_rows}: {order}"
        )
    shifts = block_rows if method in ("orse", "orse_thesis") else 2 * block_rows
    needed = shifts * (records[0].u.shape[1] + outputs + 1)
    for record in records:
        if len(record) < needed:
            raise DataError(
                f"{record.label}: {len(record)} samples are too few, {block_rows} block rows need "
                f"at least {needed}: record longer or lower block_rows"
            )
    lowest, highest = zip(*(column_range(record.u) for record in records), strict=True)
    constant = np.all(np.equal(lowest, highest), axis=0)
    for name, is_constant in zip(records[0].inputs, constant, strict=True):
        if is_constant:
            raise DataError(
                f"{records[0].label}: input {name} is constant, it excites nothing: "
                "record with a changing input"
            )
