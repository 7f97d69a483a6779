"""From records to a model: the steps of section 2.2.3 in one call."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_ident.estimation.identification import Identification, subspace
from flexarm_ident.estimation.simulation_fit import refined, with_friction
from flexarm_ident.fitting.output_fit import fit_inputs
from flexarm_ident.models.poles import is_stable, stabilise
from flexarm_ident.models.state_space import state_space
from flexarm_ident.records.iodata import as_records
from flexarm_ident.subspace.choice import select_method
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.order import choose_order
from flexarm_ident.subspace.request_check import check_request, shifts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_ident.estimation.progress import Progress
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.orse import Subspace


def identify(
    data: IoData | Sequence[IoData],
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

    Parameters
    ----------
    data : IoData or sequence of IoData
        Records of one rig; several are fitted by one model, each with its own initial state.
    order : int, optional
        Number of states, less than `block_rows`. By default one of 7 to 36 by a criterion of
        information, see `choose_order`.
    block_rows : int
        Block rows of the Hankel matrices, q of (2-18).
    method : {'auto', 'orse', 'orse_iv', 'pbsid', 'orse_thesis'}
        ORSE with outputs scaled by their innovation ('orse'), with past data as instruments
        ('orse_iv'), or with the thesis's own scaling ('orse_thesis'); PBSID-opt ('pbsid'). 'auto'
        takes 'pbsid' where noise reaches the input, 'orse_iv' where it is coloured, and 'orse'
        elsewhere; see `selection` for the tests.
    stable : bool
        Move unstable eigenvalues inside the unit circle before B is fitted (section 3.2).
    feedthrough : bool
        Fit D. The rig has none: a command acts after the sample it answers.
    friction : bool
        Look for dry friction, and with `method` 'auto' and `order` open take an arm with friction
        where the data call for one; see `with_friction` for the test.
    refine : bool
        Refine a model without friction by its simulation error; it never gets worse.
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
    found = identify_records(
        records,
        records,
        order=order,
        block_rows=block_rows,
        method=method,
        stable=stable,
        feedthrough=feedthrough,
        progress=progress,
    )
    if friction:
        replaceable = method == "auto" and order is None and not feedthrough
        found = with_friction(found, replaceable=replaceable, progress=progress)
    if refine and found.friction is None:
        found = refined(found, progress=progress)
    return found


def identify_records(
    records: Sequence[Source],
    excerpts: Sequence[IoData],
    *,
    order: int | None,
    block_rows: int,
    method: str,
    stable: bool,
    feedthrough: bool,
    progress: Progress | None,
) -> Identification:
    """Identify a subspace model: what `identify` and `identify_stream` have in common.

    Parameters
    ----------
    records : sequence of Source
        Records of one rig, in memory or read in chunks.
    excerpts : sequence of IoData
        The records themselves, or leading parts that fit into memory. Method and order are chosen
        by them, and they stand in the result.
    order, block_rows, method, stable, feedthrough, progress
        As in `identify`.

    Returns
    -------
    Identification
        The model.
    """
    report = progress or _silent
    check_request(records, order, block_rows, method)
    report("gram", 0.0)
    choice = ""
    space: Subspace
    if method == "auto":
        closed_loop = any(record.closed_loop for record in excerpts)
        method, choice, gram, space = select_method(
            records, block_rows, closed_loop=closed_loop, order=order, feedthrough=feedthrough
        )
    else:
        gram = block_gram(records, shifts(method, block_rows))
        space = subspace(gram, excerpts, method, feedthrough=feedthrough)
    report("range space", 1.0)
    if order is None:
        order = choose_order(
            gram.leading(block_rows),
            space,
            excerpts,
            stable=stable,
            feedthrough=feedthrough,
            progress=progress,
        )
    raw = space.matrices(order)
    A, moved = stabilise(raw.A) if stable else (raw.A, 0)
    fit = fit_inputs(
        A, raw.C, records, feedthrough=feedthrough, noise_weighted=method != "orse_thesis"
    )
    report("fit", 1.0)
    first = records[0]
    model = state_space(
        A, fit.B, raw.C, fit.D, first.dt_s, inputs=first.inputs, outputs=first.outputs
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
        fit_rank=fit.rank,
        fit_condition=fit.condition,
        moved_eigenvalues=moved,
        notes=tuple(notes),
        gram=gram,
        subspace=space,
        records=tuple(excerpts),
        samples=tuple(len(record) for record in records),
        choice=choice,
    )


def _silent(_stage: str, _fraction: float) -> None:
    pass
