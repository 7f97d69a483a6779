"""Identification of records that need not fit into memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import control

from flexarm_ident import orse
from flexarm_ident.errors import DataError, IdentificationError
from flexarm_ident.gram import block_gram
from flexarm_ident.output_fit import fit_inputs
from flexarm_ident.poles import stabilise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.arrays import FloatArray
    from flexarm_ident.source import Source


@dataclass(frozen=True, eq=False)
class StreamIdentification:
    """A model identified from streamed records.

    Attributes
    ----------
    model : control.StateSpace
        Discrete model with named inputs and outputs.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    singular_values : ndarray
        Singular values of (2-21), descending.
    fit_error : ndarray, (outputs,)
        Relative simulation error of each output over the records (2-25).
    input_condition, fit_condition : float
        Condition numbers of U U' and of the regression for B and x0.
    moved_eigenvalues : int
        Number of unstable eigenvalues that were moved inside the unit circle.
    """

    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    singular_values: FloatArray
    fit_error: FloatArray
    input_condition: float
    fit_condition: float
    moved_eigenvalues: int


def identify_stream(
    records: Sequence[Source],
    *,
    order: int,
    block_rows: int = 40,
    method: str = "orse",
    feedthrough: bool = False,
) -> StreamIdentification:
    """Identify a model as `identify` does, from records that are read in chunks.

    Two or three passes are made over each record: products for A and C, products for B and x0,
    and the residual when the error is too small to follow from products. Memory does not depend
    on the records' length.

    Parameters
    ----------
    records : sequence of Source
        Records of one rig, such as `BagStream`.
    order : int
        Number of states.
    block_rows : int
        Block rows of the Hankel matrices, q of (2-18).
    method : {'orse', 'orse_iv'}
        Without or with past data as instruments.
    feedthrough : bool
        Fit D.

    Returns
    -------
    StreamIdentification
        The model.

    Raises
    ------
    IdentificationError
        If the data or the request do not allow an identification.
    """
    if not records:
        raise DataError("no record given")
    if method == "orse":
        space = orse.innovation_scaled(block_gram(records, block_rows))
    elif method == "orse_iv":
        space = orse.past_instruments(block_gram(records, 2 * block_rows))
    else:
        raise IdentificationError(f"method must be orse or orse_iv for streams: {method!r}")
    raw = space.matrices(order)
    A, moved = stabilise(raw.A)
    fit = fit_inputs(A, raw.C, records, feedthrough=feedthrough)
    first = records[0]
    model = control.ss(
        A, fit.B, raw.C, fit.D, first.dt_s, inputs=list(first.inputs), outputs=list(first.outputs)
    )
    return StreamIdentification(
        model,
        fit.x0,
        space.singular_values,
        fit.error,
        space.condition,
        fit.condition,
        moved,
    )
