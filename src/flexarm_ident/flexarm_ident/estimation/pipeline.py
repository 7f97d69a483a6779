"""Pipeline from records to a model: the steps of section 2.2.3 in one call."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import IdentificationError
from flexarm_core.labels import counted
from flexarm_ident.diagnostics.instability import FAR_OUTSIDE, short_samples
from flexarm_ident.estimation.identification import Identification
from flexarm_ident.estimation.simulation_fit import (
    INTEGRATES,
    likely,
    may_be_likely,
    refined,
    with_friction,
)
from flexarm_ident.estimation.weighing import (
    Choice,
    candidate,
    fitted,
    spread,
    weigh,
    within_scatter,
    within_tolerance,
)
from flexarm_ident.fitting.blas import one_thread
from flexarm_ident.fitting.validation import Dmv, mean_error
from flexarm_ident.models.state_space import INTEGRATING, BlockSimulation, is_stable
from flexarm_ident.records.iodata import IoData, as_records
from flexarm_ident.records.preprocess import ZERO_MEAN_OUTPUTS, preprocess
from flexarm_ident.records.signals import check_magnitude
from flexarm_ident.subspace.feedback import reaches_inputs
from flexarm_ident.subspace.methods import AUTO, METHODS, estimate, select_method
from flexarm_ident.subspace.order import choose_order, order_above
from flexarm_ident.subspace.request_check import (
    check_channels,
    check_request,
    check_types,
    suitable_block_rows,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.records.source import Source

EXCERPT_SAMPLES = 65_536
"""Samples of a record that are held in memory."""
_CHUNK = 16_384


@one_thread()
def identify(
    data: IoData | Sequence[Source],
    *,
    order: int | None = None,
    singular_value_threshold: float | None = None,
    block_rows: int | None = None,
    method: str = AUTO,
    stable: bool = True,
    feedthrough: bool | None = None,
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
        Number of states, less than the block rows. By default one of 7 to 36 by an information
        criterion, see `choose_order`; with 'auto' one of 1 to 36 where free simulation calls for
        another, see `weighing`.
    singular_value_threshold : float, optional
        Threshold of (2-22) in units of the largest singular value, which sets an order that is left
        open.
    block_rows : int, optional
        Block rows of the Hankel matrices, q of (2-18). By default `request_check.BLOCK_ROWS`, more
        for a higher order, and fewer where the records are too short for as many.
    method : str
        A name in `METHODS`, or 'auto' for a choice from the data, see `methods` and `weighing`.
    stable : bool
        Move unstable eigenvalues into the unit circle before B is fitted (section 3.2).
    feedthrough : bool, optional
        Fit D. By default where the records call for it, see `calls_for_feedthrough`.
    friction : bool
        Look for dry friction. With `method` 'auto' and `order` open, an arm with friction may
        replace the model; see `with_friction` for the test.
    refine : bool
        Refine a model without friction, see `simulation_fit.refined`.
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
    check_types(
        *(data, order),
        {"stable": stable, "friction": friction, "refine": refine, "feedthrough": feedthrough},
    )
    records: Sequence[Source] = [data] if isinstance(data, IoData) else data
    excerpts = tuple(as_records([excerpt(record) for record in records]))
    report = progress or _silent
    if block_rows is None:
        block_rows = suitable_block_rows(records, order, method)
    check_request(records, order, block_rows, method)
    check_channels(excerpts)
    report("Hankel matrices", 0.0)

    fit = _Fit(
        records, excerpts, method, order, singular_value_threshold, block_rows, stable, report
    )
    chosen, found = fit.model(feedthrough=feedthrough is True)
    if feedthrough is None and _is_open_loop(chosen, excerpts):
        found = fit.with_feedthrough(chosen, found)
    report("fit", 1.0)
    if not fit.in_memory:
        return found
    if friction:
        replaceable = method == AUTO and order is None and feedthrough is not True
        found = with_friction(found, replaceable=replaceable, progress=progress)
    if refine and found.friction is None and found.likelihood is None:
        order_open = order is None and singular_value_threshold is None
        found = refined(found, order_open=order_open, progress=progress)
    return found


class _Fit(NamedTuple):
    """Records with what was asked for; `excerpts` are in memory."""

    records: Sequence[Source]
    excerpts: tuple[IoData, ...]
    method: str
    order: int | None
    threshold: float | None
    block_rows: int
    stable: bool
    progress: Progress

    @property
    def in_memory(self) -> bool:
        """Whether the excerpts are the records themselves."""
        return all(isinstance(record, IoData) for record in self.records)

    def model(self, *, feedthrough: bool) -> tuple[Choice, Identification]:
        """Return the choice of what was left open, and its model.

        Where the likelihood shows that nothing is left in the data but noise, no other estimator
        is weighed.
        """
        first, likeliest = self._likeliest(feedthrough=feedthrough)
        if likeliest is not None:
            return first, likeliest
        if not self._is_open:
            return first, self._linear(first, feedthrough=feedthrough)
        return self._weighed(first, feedthrough=feedthrough)

    def _weighed(self, first: Choice, *, feedthrough: bool) -> tuple[Choice, Identification]:
        """Return the choice among all estimators and orders, and its model."""
        chosen = weigh(
            *(first, self.records, self.excerpts),
            block_rows=self.block_rows,
            stable=self.stable,
            feedthrough=feedthrough,
            progress=self.progress,
        )
        linear = self._linear(chosen, feedthrough=feedthrough)
        other = (chosen.selection.method, chosen.order) != (first.selection.method, first.order)
        asked = other and may_be_likely(self.records)
        return chosen, (likely(linear, progress=self.progress) if asked else None) or linear

    def with_feedthrough(self, chosen: Choice, found: Identification) -> Identification:
        """Return the model with D where the records of an open loop call for it.

        They do where it leaves nothing but noise, which the model without it does not, or where it
        improves the simulation, see `calls_for_feedthrough`.
        """
        first = None
        if self._is_open and found.likelihood is None:
            first, likeliest = self._likeliest(feedthrough=True)
            if likeliest is not None:
                return likeliest
        if not calls_for_feedthrough(chosen, self.excerpts, stable=self.stable):
            return found
        if first is None:
            return self.model(feedthrough=True)[1]
        return self._weighed(first, feedthrough=True)[1]

    @property
    def _is_open(self) -> bool:
        """Whether method and order are to be chosen."""
        return self.method == AUTO and self.order is None and self.threshold is None

    def _likeliest(self, *, feedthrough: bool) -> tuple[Choice, Identification | None]:
        """Return the choice by one-step errors, and its model of maximum likelihood if it fits."""
        first = self._first_choice(feedthrough=feedthrough)
        if not (self._is_open and may_be_likely(self.records)):
            return first, None
        linear = self._linear(first, feedthrough=feedthrough)
        return first, likely(linear, progress=self.progress)

    def _first_choice(self, *, feedthrough: bool) -> Choice:
        """Return estimator and order, by one-step errors where they are left open."""
        known = any(record.closed_loop for record in self.excerpts)
        selection = (
            select_method(
                *(self.records, self.block_rows),
                closed_loop=known,
                order=self.order,
                feedthrough=feedthrough,
            )
            if self.method == AUTO
            else estimate(
                *(self.records, self.excerpts, self.method, self.block_rows),
                feedthrough=feedthrough,
            )
        )
        self.progress("subspace", 1.0)
        order = self.order
        if order is None and self.threshold is not None:
            order = order_above(self.threshold, selection.space)
        if order is not None:
            return Choice(selection, order)
        gram = selection.gram.leading(self.block_rows)
        states = choose_order(
            *(gram, selection.space, self.excerpts), stable=self.stable, feedthrough=feedthrough
        )
        if self.method != AUTO:
            self.progress("order", 1.0)
            return Choice(selection, states)
        reason = f"{selection.reason}; order {states} by the one-step errors"
        return Choice(selection._replace(reason=reason), states)

    def _linear(self, chosen: Choice, *, feedthrough: bool) -> Identification:
        linear = _linear_model(
            *(chosen, self.records),
            block_rows=self.block_rows,
            stable=self.stable,
            feedthrough=feedthrough,
        )
        return replace(linear, records=self.excerpts)


def _linear_model(
    chosen: Choice,
    records: Sequence[Source],
    *,
    block_rows: int,
    stable: bool,
    feedthrough: bool,
) -> Identification:
    """Return the model of the chosen order, without the records."""
    selection, order, weighed = chosen
    model, fit, moved, way = fitted(
        selection,
        order,
        records,
        stable=stable,
        feedthrough=feedthrough,
        noise_weighted=METHODS[selection.method].noise_weighted,
    )
    notes = []
    if moved:
        verb = "was" if moved == 1 else "were"
        subject = counted(moved, "unstable eigenvalue")
        notes.append(
            f"{subject} of order {order} {verb} moved into the unit circle"
            f"{_far_outside(selection.space.matrices(order).A)}"
        )
    elif not stable and not is_stable(model.A):
        notes.append(f"the model of order {order} is unstable")
    if way in INTEGRATING:
        notes.append(INTEGRATES)
    return Identification(
        model=model,
        x0=fit.x0,
        order=order,
        method=selection.method,
        block_rows=block_rows,
        singular_values=selection.space.singular_values,
        fit_error=fit.error,
        stable=stable,
        moved_eigenvalues=moved,
        notes=tuple(notes),
        gram=selection.gram,
        subspace=selection.space,
        records=(),
        samples=tuple(len(record) for record in records),
        choice=selection.reason,
        weighed=weighed,
    )


def _far_outside(A: FloatArray) -> str:
    """Return what to do where an eigenvalue is that far outside that the plant may be unstable."""
    largest = float(np.abs(np.linalg.eigvals(A)).max())
    if largest < FAR_OUTSIDE:
        return ""
    return (
        f", the largest of magnitude {largest:.4f}: a plant that is unstable itself keeps its own "
        f"with stable=False (--keep-unstable), on a record of {short_samples(A)} samples or so"
    )


def _silent(_stage: str, _fraction: float) -> None:
    pass


def calls_for_feedthrough(chosen: Choice, records: Sequence[IoData], *, stable: bool) -> bool:
    """Return whether D improves the simulation of records of an open loop.

    Two models of the same A and C are fitted, with and without D, and simulated freely; D is taken
    when the model without it is worse by more than 3 % and by more than two standard errors, part
    by part.

    Parameters
    ----------
    chosen : Choice
        Estimator and order without D.
    records : sequence of IoData
        The records themselves, or leading parts that fit into memory.
    stable : bool
        Whether unstable eigenvalues are moved.
    """
    selection, order, _ = chosen
    pieces = spread(records)
    try:
        without, direct = (
            candidate(selection, order, pieces, stable=stable, feedthrough=feedthrough)
            for feedthrough in (False, True)
        )
    except IdentificationError:  # too unstable to simulate
        return False
    errors = without.expected_error, direct.expected_error
    return not (within_tolerance(*errors) or within_scatter(without, direct))


def _is_open_loop(chosen: Choice, records: Sequence[IoData]) -> bool:
    """Return whether D can be told from a controller that answers within the sample."""
    declared = any(record.closed_loop for record in records)
    return not declared and not reaches_inputs(chosen.selection.gram)


class Part:
    """Leading samples of a source, with a constant subtracted from each output.

    Parameters
    ----------
    source : Source
        The source, whose names, period and notices stay.
    samples : int
        Number of samples, at most that of the source.
    bias : ndarray, (outputs,)
        Constants to subtract.
    """

    def __init__(self, source: Source, samples: int, bias: FloatArray) -> None:
        self.source, self.samples, self.bias = source, samples, bias
        self.inputs, self.outputs = source.inputs, source.outputs
        self.dt_s, self.label = source.dt_s, source.label
        self.closed_loop, self.notices = source.closed_loop, source.notices
        self.whole_samples = source.whole_samples

    def __len__(self) -> int:
        return self.samples

    def head(self, samples: int) -> IoData:
        """Return the first `samples` samples as a record in memory."""
        first = self.source.head(min(samples, self.samples))
        return replace(first, y=first.y - self.bias)

    def chunks(self, samples: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Return u and y from the start, `samples` rows each, as `Samples.chunks` says."""
        left = self.samples
        for u, y in self.source.chunks(samples):
            yield u[:left], y[:left] - self.bias
            left -= len(u)
            if left <= 0:
                return


def leading(source: Source, samples: int) -> Part:
    """Return the first `samples` samples of a source, or all if there are fewer."""
    return Part(source, min(samples, len(source)), np.zeros(len(source.outputs)))


def excerpt(source: Source) -> IoData:
    """Return the first samples of a source as a record in memory; a record itself is unchanged."""
    return source if isinstance(source, IoData) else source.head(EXCERPT_SAMPLES)


def without_bias(source: Source) -> Part:
    """Remove the outputs' biases from a source as `preprocess` does by default (section 2.5).

    The inputs must not contain Coulomb compensation.
    """
    first = excerpt(source)
    check_magnitude(first)
    prepared = preprocess(first, zero_mean=())
    bias = first.y[0] - prepared.y[0]
    # An offset of an input stays.
    notices = [
        each for each in prepared.notices[len(first.notices) :] if each.channel in source.outputs
    ]
    total, count = np.zeros(len(source.outputs)), 0
    for _, y in source.chunks(_CHUNK):
        total += np.nansum(y, axis=0)
        count += int(np.count_nonzero(~np.isnan(y[:, 0])))
    gauges = np.isin(source.outputs, ZERO_MEAN_OUTPUTS)
    part = Part(source, len(source), np.where(gauges, total / max(count, 1), bias))
    part.notices = (*source.notices, *notices)
    return part


def validate_stream(model: control.StateSpace, record: Source, x0: FloatArray) -> Dmv:
    """Compare measured outputs with a free simulation in chunks, as `validate_dmv` does.

    The simulation starts from x0, (states,). Its first `EXCERPT_SAMPLES` outputs are kept.
    """
    run = BlockSimulation(model.A, model.B, model.C, model.D, x0)
    missed, power, total, count = np.zeros((4, model.noutputs))
    shown: list[FloatArray] = []
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for u, y in record.chunks(_CHUNK):
            simulated = run.advance(u)
            missed += np.nansum((y - simulated) ** 2, axis=0)
            power += np.nansum(y**2, axis=0)
            total += np.nansum(y, axis=0)
            count += np.count_nonzero(~np.isnan(y), axis=0)
            if len(shown) * _CHUNK < EXCERPT_SAMPLES:
                shown.append(simulated)
        delta = np.sqrt(missed / power)
        about_mean = np.sqrt(power / (power - total**2 / count))
    delta = np.where(power > 0.0, np.where(np.isfinite(delta), delta, np.inf), np.nan)
    shown_y = np.concatenate(shown)[:EXCERPT_SAMPLES]
    return Dmv(delta, mean_error(delta), delta * about_mean, shown_y, x0)
