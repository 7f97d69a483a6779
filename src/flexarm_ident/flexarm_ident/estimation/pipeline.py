"""Pipeline from records to a model: the steps of section 2.2.3 in one call."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flexarm_core.labels import counted
from flexarm_ident.estimation.identification import Identification
from flexarm_ident.estimation.simulation_fit import refined, with_friction
from flexarm_ident.estimation.streaming import excerpt
from flexarm_ident.fitting.output_fit import fit_inputs
from flexarm_ident.models.state_space import is_stable, stabilise, state_space
from flexarm_ident.records.iodata import IoData, as_records
from flexarm_ident.subspace.choice import estimate, select_method
from flexarm_ident.subspace.methods import AUTO, METHODS
from flexarm_ident.subspace.order import choose_order
from flexarm_ident.subspace.request_check import check_request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import Progress
    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.choice import Selection


def identify(
    data: IoData | Sequence[Source],
    *,
    order: int | None = None,
    block_rows: int = 40,
    method: str = "orse",
    stable: bool = True,
    feedthrough: bool = False,
    friction: bool = False,
    refine: bool = False,
    progress: Progress | None = None,
) -> Identification:
    """Identify a discrete state-space model from one or several records.

    Records that do not fit into memory are read a few times, in chunks: products for A and C,
    products for B and x0, and the residual when the error is too small to follow from products.
    Their method and order, if left open, and the modes' weights come from their leading parts,
    `streaming.EXCERPT_SAMPLES` long. They have neither friction nor refinement.

    Parameters
    ----------
    data : IoData or sequence of Source
        Records of one rig, in memory or read in chunks such as `BagStream`; several are fitted by
        one model, each with its own initial state.
    order : int, optional
        Number of states, less than `block_rows`. By default one of 7 to 36 by an information
        criterion, see `choose_order`.
    block_rows : int
        Block rows of the Hankel matrices, q of (2-18).
    method : str
        A name in `METHODS`, or 'auto' for a choice from the data, see `choice`.
    stable : bool
        Move unstable eigenvalues into the unit circle before B is fitted (section 3.2).
    feedthrough : bool
        Fit D. The rig has none: a command acts after the sample it answers.
    friction : bool
        Look for dry friction. With `method` 'auto' and `order` open, an arm with friction may
        replace the model; see `with_friction` for the test.
    refine : bool
        Refine a model without friction by its simulation error, which never increases.
    progress : callable, optional
        Called with the name of the stage and its completed part.

    Returns
    -------
    Identification
        The model, the records' initial states and the diagnostics.

    Raises
    ------
    IdentificationError
        If the data or the request do not allow an identification.
    """
    records: Sequence[Source] = [data] if isinstance(data, IoData) else data
    excerpts = as_records([excerpt(record) for record in records])
    report = progress or _silent
    check_request(records, order, block_rows, method)
    report("gram", 0.0)
    if method == AUTO:
        closed_loop = any(record.closed_loop for record in excerpts)
        chosen = select_method(
            records, block_rows, closed_loop=closed_loop, order=order, feedthrough=feedthrough
        )
    else:
        chosen = estimate(records, excerpts, method, block_rows, feedthrough=feedthrough)
    report("range space", 1.0)
    states = order or choose_order(
        chosen.gram.leading(block_rows),
        chosen.space,
        excerpts,
        stable=stable,
        feedthrough=feedthrough,
        progress=progress,
    )
    linear = _linear_model(
        chosen, states, records, block_rows=block_rows, stable=stable, feedthrough=feedthrough
    )
    report("fit", 1.0)
    found = replace(linear, records=excerpts)
    if not all(isinstance(record, IoData) for record in records):
        return found
    if friction:
        replaceable = method == AUTO and order is None and not feedthrough
        found = with_friction(found, replaceable=replaceable, progress=progress)
    if refine and found.friction is None:
        found = refined(found, progress=progress)
    return found


def _linear_model(
    chosen: Selection,
    order: int,
    records: Sequence[Source],
    *,
    block_rows: int,
    stable: bool,
    feedthrough: bool,
) -> Identification:
    """Return the model of one order, without the records."""
    raw = chosen.space.matrices(order)
    A, moved = stabilise(raw.A) if stable else (raw.A, 0)
    fit = fit_inputs(
        A,
        raw.C,
        records,
        feedthrough=feedthrough,
        noise_weighted=METHODS[chosen.method].noise_weighted,
    )
    first = records[0]
    model = state_space(
        A, fit.B, raw.C, fit.D, first.dt_s, inputs=first.inputs, outputs=first.outputs
    )
    notes = []
    if moved:
        verb = "was" if moved == 1 else "were"
        subject = counted(moved, "unstable eigenvalue")
        notes.append(f"{subject} of order {order} {verb} moved into the unit circle")
    elif not is_stable(A):
        notes.append(f"the model of order {order} is unstable")
    return Identification(
        model=model,
        x0=fit.x0,
        order=order,
        method=chosen.method,
        block_rows=block_rows,
        singular_values=chosen.space.singular_values,
        fit_error=fit.error,
        input_condition=chosen.space.condition,
        fit_rank=fit.rank,
        fit_condition=fit.condition,
        moved_eigenvalues=moved,
        notes=tuple(notes),
        gram=chosen.gram,
        subspace=chosen.space,
        records=(),
        samples=tuple(len(record) for record in records),
        choice=chosen.reason,
    )


def _silent(_stage: str, _fraction: float) -> None:
    pass
