"""Choice of method and order: models weighed by their simulation errors, with parsimony.

The one-step errors, by which `order.choose_order` goes, say little about the simulation where the
noise is coloured by friction: the order is too small then. Models of every estimator that the data
allow and of several orders are therefore fitted and simulated freely. Two errors count. One is over
the data of the fit, as it is expected of other data (Akaike's final prediction error). The other is
over blocks that the fit left out (`cross_validation`), where a model misses that follows the noise
of its data, or a drift. Left-out blocks alone mislead: a sweep has other resonances in each. The
score is the geometric mean of the two, the first with twice the weight, and the smallest order is
taken whose score exceeds the smallest by at most 3 %.

Free simulation does not show the bias of a model that was identified under feedback: it fits the
noise that the controller has brought into the input. And it rewards a model of high order that
imitates friction, at the cost of its modes. Where the first choice is for feedback or friction,
only such estimators are weighed, and it stays up to 35 %.

Stone, "Cross-validatory choice and assessment of statistical predictions", Journal of the Royal
Statistical Society B 36 (1974).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import count, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import DataError, FlexarmError, IdentificationError
from flexarm_ident.estimation.cross_validation import cross_validate, without_blocks
from flexarm_ident.fitting.stable_fit import fit_stable
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.models.state_space import simulate, state_space
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.methods import METHODS, Data, estimate_from
from flexarm_ident.subspace.order import largest_order

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.diagnostics.uncertainty import Jackknife
    from flexarm_ident.fitting.output_fit import OutputFit
    from flexarm_ident.models.state_space import Way
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.methods import Method, Selection
    from flexarm_ident.subspace.subspace_protocol import Subspace

LADDER = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 18, 21, 24, 28, 32, 36)
"""Orders to weigh. Few models of high order differ by one state."""
COARSE = (6, 10, 14, 18, 24, 32)
"""Orders to begin with: the others are weighed only if the first choice is not as good."""
WEIGHED_SAMPLES = 20_000
"""Samples of all records together that models are weighed by."""
# Of a longer record several pieces: a sweep reaches its resonances late.
_PIECES = 4
_RECORDS = 8
# Errors in units of the smallest.
TOLERANCE = 1.03
TOLERANCE_IN_FEEDBACK = 1.35
_STANDARD_ERRORS = 2.0
# Weight of the expected error beside that on left-out blocks.
_WEIGHT = 2.0
# Blocks are left out where the expected error is less in units of the smallest.
_HOPELESS = 2.0
# A smaller relative error is rounding.
_SMALLEST_ERROR = 1e-6
_PARTS = 8


class WeighedModel(NamedTuple):
    """Row of the table of what was weighed.

    `error` is the mean relative simulation error over the data of the fit, `left_out` that over
    blocks that the fit left out, NaN where they were not asked for or cannot be made. `score` is
    infinite for a model that was not considered further.
    """

    method: str
    order: int
    error: float
    left_out: float
    score: float
    chosen: bool


class Choice(NamedTuple):
    """Estimator with its result and the reason for it, the order, and what both were chosen from.

    `weighed` has the best score first, and is empty where nothing was weighed.
    """

    selection: Selection
    order: int
    weighed: tuple[WeighedModel, ...] = ()


def weigh(
    first: Choice,
    records: Sequence[Source],
    excerpts: Sequence[IoData],
    *,
    block_rows: int,
    stable: bool,
    feedthrough: bool,
    progress: Progress,
) -> Choice:
    """Return the first choice, or another one whose model simulates better.

    Parameters
    ----------
    first : Choice
        Choice by one-step errors.
    records : sequence of Source
        Records of one rig.
    excerpts : sequence of IoData
        The records themselves, or leading parts that fit into memory.
    block_rows : int
        Block rows q of (2-18).
    stable : bool
        Whether unstable eigenvalues are moved; otherwise models that cannot be simulated are not
        weighed.
    feedthrough : bool
        Whether D is fitted.
    progress : callable
        Called with the stage "order" and its completed part.
    """
    weighed = Weighed(first, spread(excerpts), stable=stable, feedthrough=feedthrough)
    weighed.add(first.selection, first.order)
    selections = [first.selection]
    grams = {first.selection.gram.block_rows: first.selection.gram}
    for row in _others(METHODS[first.selection.method]):
        needed = row.shifts(block_rows)
        with suppress(FlexarmError):  # the data do not suffice for it
            if needed not in grams:
                grams[needed] = block_gram(records, needed)
            selections.append(
                estimate_from(grams[needed], excerpts, row.name, feedthrough=feedthrough)
            )
    steps, total = count(1), (len(COARSE) + len(LADDER)) * len(selections)
    for orders in (COARSE, LADDER):
        for order, selection in product(orders, selections):
            if order <= largest_order(selection.space):
                weighed.add(selection, order)
            progress("order", next(steps) / total)
        if weighed.first_stays:
            break
    progress("order", 1.0)
    return weighed.choice()


def _others(row: Method) -> list[Method]:
    """Return the estimators to weigh beside one."""
    return [
        each
        for each in METHODS.values()
        if each is not row
        and each.weighed
        and (each.consistent_under_feedback or not row.consistent_under_feedback)
    ]


class Weighed:
    """Models that have been fitted so far, the first choice among them, and the choice from them.

    Parameters
    ----------
    first : Choice
        Choice by one-step errors.
    records : sequence of IoData
        Records to fit and to simulate.
    stable : bool
        Whether unstable eigenvalues are moved.
    feedthrough : bool
        Whether D is fitted.
    """

    def __init__(
        self, first: Choice, records: Sequence[IoData], *, stable: bool, feedthrough: bool
    ) -> None:
        self._first, self._records = first, records
        self._stable, self._feedthrough = stable, feedthrough
        self._candidates: dict[tuple[str, int], Candidate] = {}
        self._blocks: dict[str, Jackknife[Subspace] | None] = {}
        self._left_out: dict[tuple[str, int], float] = {}

    def add(self, selection: Selection, order: int) -> None:
        """Fit a model, unless that has been done; one that cannot be simulated is left out."""
        if (selection.method, order) in self._candidates:
            return
        with suppress(IdentificationError):  # too unstable to simulate
            made = candidate(
                selection,
                order,
                self._records,
                stable=self._stable,
                feedthrough=self._feedthrough,
            )
            if np.isfinite(made.expected_error):
                self._candidates[selection.method, order] = made

    @property
    def first_stays(self) -> bool:
        """Whether the first choice is as good as the best of the others, or nearly so."""
        row = METHODS[self._first.selection.method]
        tolerance = TOLERANCE_IN_FEEDBACK if row.consistent_under_feedback else TOLERANCE
        found = self._found_first
        return found is not None and within_tolerance(
            self.score(found), self.score(self._best), tolerance
        )

    def choice(self) -> Choice:
        """Return the first choice where it stays, else the most parsimonious model."""
        if not self._candidates:
            return self._first
        first, best = self._first, self._best
        if self.first_stays:
            selection, order = first.selection, first.order
            reason = (
                f"{selection.reason}: {self._figures(self._found_first)}; best of "
                f"{len(self._candidates)} models: {self._figures(best)} ({best.name})"
            )
        else:
            scored = [(each, self.score(each)) for each in self._candidates.values()]
            chosen = most_parsimonious(scored)
            selection, order = chosen.selection, chosen.order
            reason = (
                f"{chosen.name} was chosen of {len(scored)} models: {self._figures(chosen)}; "
                f"{first.selection.method} of order {first.order}, which the one-step errors call "
                f"for, has {self._figures(self._found_first)}"
            )
        table = self._table((selection.method, order))
        return Choice(selection._replace(reason=reason), order, table)

    def _table(self, taken: tuple[str, int]) -> tuple[WeighedModel, ...]:
        rows = [
            WeighedModel(
                *(*key, made.error, self._left_out.get(key, np.nan), self.score(made)),
                chosen=key == taken,
            )
            for key, made in self._candidates.items()
        ]
        return tuple(sorted(rows, key=lambda row: (row.score, row.error)))

    def score(self, made: Candidate) -> float:
        """Return the weighted geometric mean of the expected error and that on left-out blocks.

        It is the expected error itself where the records are too short for blocks, and infinite
        where the model without a block cannot be simulated or the expected error is hopeless.
        """
        smallest = min(each.expected_error for each in self._candidates.values())
        expected = made.expected_error
        if expected > _HOPELESS * max(smallest, _SMALLEST_ERROR):
            return np.inf
        left_out = self._error_left_out(made)
        if left_out is None:
            return expected
        return float((expected**_WEIGHT * left_out) ** (1.0 / (1.0 + _WEIGHT)))

    @property
    def _found_first(self) -> Candidate | None:
        return self._candidates.get((self._first.selection.method, self._first.order))

    @property
    def _best(self) -> Candidate:
        return min(self._candidates.values(), key=self.score)

    def _figures(self, made: Candidate | None) -> str:
        if made is None:
            return "no result"
        left_out = self._error_left_out(made)
        beside = "" if left_out is None else f", {left_out:.3g} on left-out blocks"
        return f"{made.error:.3g} in simulation{beside}"

    def _error_left_out(self, made: Candidate) -> float | None:
        """Return the error on left-out blocks, None for records too short for blocks."""
        selection, records, feedthrough = made.selection, self._records, self._feedthrough
        row, key = METHODS[selection.method], (selection.method, made.order)
        if key in self._left_out:
            return self._left_out[key]
        if row.name not in self._blocks:
            self._blocks[row.name] = None
            with suppress(FlexarmError):  # too short for blocks
                self._blocks[row.name] = without_blocks(
                    *(records, selection.gram.block_rows),
                    lambda gram: row.build(Data(gram, records, feedthrough, LADDER[-1])),
                )
        blocks, error = self._blocks[row.name], np.inf
        if blocks is None:
            return None
        with suppress(FlexarmError):  # too unstable to simulate
            found = cross_validate(
                *(records, blocks, lambda space: space.matrices(made.order)),
                row.ways if self._stable else (),
                feedthrough=feedthrough,
                noise_weighted=False,
            )
            error = mean_error(found.error)
        self._left_out[key] = error
        return error


def spread(records: Sequence[IoData]) -> list[IoData]:
    """Return the records, of long ones pieces over their whole length as records of their own."""
    total = sum(len(record) for record in records)
    if total <= WEIGHED_SAMPLES:
        return list(records)
    several = records[:: -(-len(records) // _RECORDS)]
    total = sum(len(record) for record in several)
    pieces: list[IoData] = []
    for record in several:
        count = max(1, round(_PIECES * len(record) / total))
        samples = min(len(record), WEIGHED_SAMPLES * len(record) // (total * count))
        for first in np.linspace(0, len(record) - samples, count).astype(int).tolist():
            with suppress(DataError):  # in a long hole
                pieces.append(record.rows(slice(first, first + samples)))
    return pieces or list(records)


def most_parsimonious(scored: Sequence[tuple[Candidate, float]]) -> Candidate:
    """Return the candidate of the smallest order whose score is as good as the smallest."""
    smallest = min(score for _, score in scored)
    by_order = sorted(scored, key=lambda each: (each[0].order, each[1]))
    return next(each for each, score in by_order if within_tolerance(score, smallest))


def within_tolerance(error: float, smallest: float, tolerance: float = TOLERANCE) -> bool:
    """Return whether an error exceeds the smallest by at most 3 %, or another tolerance."""
    return error <= tolerance * max(smallest, _SMALLEST_ERROR)


def within_scatter(one: Candidate, best: Candidate) -> bool:
    """Return whether a squared error exceeds the best's by at most two standard errors."""
    floor = _SMALLEST_ERROR**2
    ours, bests = (each.inflation**2 * each.parts for each in (one, best))
    weight = 1.0 / np.maximum(bests.sum(axis=0), floor)
    excess = np.sum(weight * (ours - bests), axis=1)
    scatter = np.sqrt(len(excess)) * np.std(excess, ddof=1)
    return bool(excess.sum() <= _STANDARD_ERRORS * scatter + floor * weight.sum())


class Fitted(NamedTuple):
    """Model of one order with its fit, and how many eigenvalues were moved in which way."""

    model: control.StateSpace
    fit: OutputFit
    moved: int
    way: Way | None


@dataclass(frozen=True, eq=False)
class Candidate:
    """Model of one estimator and order, fitted to some records.

    Attributes
    ----------
    selection : Selection
        Estimator and its result.
    fitted : Fitted
        Model and fit.
    records : sequence of IoData
        The records.
    """

    selection: Selection
    fitted: Fitted
    records: Sequence[IoData]

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.fitted.model.nstates)

    @property
    def name(self) -> str:
        """Estimator and order in messages."""
        return f"{self.selection.method} of order {self.order}"

    @property
    def error(self) -> float:
        """Mean of the outputs' relative errors (2-25)."""
        return mean_error(self.fitted.fit.error)

    @cached_property
    def inflation(self) -> float:
        """Factor from the error to that expected of other data, infinite for too few of them.

        Akaike, "Fitting autoregressive models for prediction", Annals of the Institute of
        Statistical Mathematics 21 (1969): the final prediction error.
        """
        states, model = self.order, self.fitted.model
        parameters = states * (model.ninputs + model.noutputs + len(self.records))
        values = model.noutputs * sum(int(record.usable.sum()) for record in self.records)
        part = parameters / values
        return float(np.sqrt((1.0 + part) / (1.0 - part))) if part < 1.0 else np.inf

    @property
    def expected_error(self) -> float:
        """Mean relative error that is expected of other data."""
        return self.inflation * self.error

    @cached_property
    def parts(self) -> FloatArray:
        """Squared relative errors over parts of the records, (parts, outputs)."""
        model, starts = self.fitted.model, self.fitted.fit.x0
        missed = [
            (record.y - simulate(model, record.u, start))[record.usable]
            for record, start in zip(self.records, starts, strict=True)
        ]
        power = np.sum([np.sum(record.y[record.usable] ** 2, axis=0) for record in self.records], 0)
        parts = [np.sum(part**2, axis=0) for part in np.array_split(np.vstack(missed), _PARTS)]
        return np.asarray(parts / np.where(power > 0.0, power, 1.0))


def candidate(
    selection: Selection, order: int, records: Sequence[IoData], *, stable: bool, feedthrough: bool
) -> Candidate:
    """Return the model of one estimator and order, fitted by the errors that it is weighed by.

    Raises
    ------
    IdentificationError
        If the model is so unstable that its response overflows.
    """
    model = fitted(
        selection, order, records, stable=stable, feedthrough=feedthrough, noise_weighted=False
    )
    return Candidate(selection, model, records)


def fitted(
    found: Selection,
    order: int,
    records: Sequence[Source],
    *,
    stable: bool,
    feedthrough: bool,
    noise_weighted: bool,
) -> Fitted:
    """Return the model of one order, with B, D and the initial states fitted to records.

    Without `noise_weighted` the fit minimises the errors by which models are weighed.

    Raises
    ------
    IdentificationError
        If the model is so unstable that its response overflows.
    """
    raw = found.space.matrices(order)
    method = METHODS[found.method]
    A, fit, moved, way = fit_stable(
        *(raw.A, raw.C, records, method.ways if stable else ()),
        feedthrough=feedthrough,
        noise_weighted=noise_weighted,
        at_rest=method.at_rest,
    )
    first = records[0]
    model = state_space(
        A, fit.B, raw.C, fit.D, first.dt_s, inputs=first.inputs, outputs=first.outputs
    )
    return Fitted(model, fit, moved, way)
