"""Second opinion on method and order: models weighed by free simulation, with parsimony.

The one-step errors, by which `order.choose_order` goes, say little about the simulation where the
noise is coloured by friction: the order is too small then. Models of every estimator that the data
allow and of several orders are therefore fitted and simulated freely, and judged by their mean
relative error (2-25), as it is expected of other data. The first choice stays when its error
exceeds the smallest by at most 3 %. Otherwise the smallest order is taken that is as good as the
best model: its error exceeds the smallest by at most 3 %, and its squared error that of the best
model by at most two standard errors. These are taken over parts of the records, both models
compared part by part. The second condition decides for records with much noise, where 3 % of the
error would hide a mode, the first for records whose errors come in bursts.

With few data a model of high order follows their noise beyond what Akaike's factor expects. There
each model is fitted without a block of the records in turn as well, see `cross_validation`. One
that misses these blocks by more than twice as much as another does, or is no better than their mean
where another is, is not chosen.

Free simulation does not show the bias of a model that was identified under feedback: it fits the
noise that the controller has brought into the input. And it rewards a model of high order that
imitates friction, at the cost of its modes. Where the first choice is for feedback or friction,
only such estimators are weighed, and it stays up to 35 %.

Breiman, Friedman, Olshen, Stone, "Classification and Regression Trees", Wadsworth (1984), for the
rule of one standard error.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import count, product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.errors import DataError, FlexarmError, IdentificationError
from flexarm_ident.estimation.candidates import candidate
from flexarm_ident.estimation.cross_validation import cross_validate, without_blocks
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.subspace.choice import estimate_from
from flexarm_ident.subspace.gram import block_gram
from flexarm_ident.subspace.methods import METHODS, Data
from flexarm_ident.subspace.order import largest_order

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flexarm_core.arrays import Progress
    from flexarm_ident.diagnostics.uncertainty import Jackknife
    from flexarm_ident.estimation.candidates import Candidate
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.choice import Selection
    from flexarm_ident.subspace.methods import Method
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
_TOLERANCE_IN_FEEDBACK = 1.35
_STANDARD_ERRORS = 2.0
# Ratio of the expected to the plain error above which it can decide.
_FEW_DATA = 1.02
# Error on left-out blocks in units of the smallest. Models differ by less where a block holds what
# the others do not, as with a sweep.
_MISSES = 2.0
# A smaller relative error is rounding.
_SMALLEST_ERROR = 1e-6


class Choice(NamedTuple):
    """Estimator with its result and the reason for it, and the order of the model."""

    selection: Selection
    order: int


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
        tolerance = _TOLERANCE_IN_FEEDBACK if row.consistent_under_feedback else TOLERANCE
        if not self._candidates:
            return False
        admitted = self._admitted()
        found = self._found_first
        error = found.expected_error if found in admitted else np.inf
        smallest = admitted[0].expected_error
        return bool(error <= tolerance * max(smallest, _SMALLEST_ERROR))

    def choice(self) -> Choice:
        """Return the first choice where it stays, else the most parsimonious model."""
        if not self._candidates:
            return self._first
        admitted = self._admitted()
        first, best, is_few = self._first, admitted[0], self._is_few
        words = "in simulation" + is_few * ", as expected of other data"

        def told(made: Candidate | None) -> str:
            if made is None:
                return "no result"
            return f"{made.expected_error if is_few else made.error:.3g}"

        error = told(self._found_first)
        smallest = f"the best of {len(self._candidates)} models {told(best)} ({best.name})"
        if self.first_stays:
            reason = f"{first.selection.reason}: {error} {words}, {smallest}"
            return Choice(first.selection._replace(reason=reason), first.order)
        chosen = most_parsimonious(admitted, best)
        reason = (
            f"{chosen.name} was chosen: {told(chosen)} {words}, "
            f"{error} by {first.selection.method} of order {first.order}, which "
            f"the one-step errors call for, {smallest}{self._refused(admitted)}"
        )
        return Choice(chosen.selection._replace(reason=reason), chosen.order)

    @property
    def _found_first(self) -> Candidate | None:
        return self._candidates.get((self._first.selection.method, self._first.order))

    @property
    def _best(self) -> Candidate:
        return min(self._candidates.values(), key=lambda each: each.expected_error)

    @property
    def _is_few(self) -> bool:
        pair = (self._best, self._found_first)
        return any(each.inflation > _FEW_DATA for each in pair if each)

    def _admitted(self) -> list[Candidate]:
        """Return the models that may be chosen, the best first.

        With few data that is the best one that meets left-out blocks, the first choice and those
        that are nearly as good, if they meet them as well.
        """
        made = sorted(self._candidates.values(), key=lambda each: each.expected_error)
        if not self._is_few:
            return made
        known = [self._error_left_out(each) for each in made if each.order in COARSE]
        smallest = min(known, default=np.inf)
        most = _MISSES * smallest if smallest >= 1.0 else min(_MISSES * smallest, 1.0)
        best = next((each for each in made if self._error_left_out(each) <= most), None)
        if best is None:
            return made
        rivals = [each for each in made[made.index(best) :] if within_tolerance(each, best)]
        first = self._found_first
        if first is not None and first not in rivals:
            rivals.append(first)
        return [each for each in rivals if self._error_left_out(each) <= most]

    def _error_left_out(self, made: Candidate) -> float:
        """Return the error on left-out blocks, infinite where there is none."""
        selection, records, feedthrough = made.selection, self._records, self._feedthrough
        row, key = METHODS[selection.method], (selection.method, made.order)
        if key in self._left_out:
            return self._left_out[key]
        if row.name not in self._blocks:
            self._blocks[row.name] = None
            with suppress(FlexarmError):  # too short for blocks
                self._blocks[row.name] = without_blocks(
                    *(records, selection.gram.block_rows),
                    lambda gram: row.build(Data(gram, records, feedthrough)),
                )
        blocks, error = self._blocks[row.name], np.inf
        if blocks is None:
            return error
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

    def _refused(self, admitted: Sequence[Candidate]) -> str:
        """Return what is reported of better models that miss left-out blocks."""
        best = self._best
        if best in admitted:
            return ""
        return f"; {best.name} has {best.expected_error:.3g}, but misses what its fit leaves out"


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


def most_parsimonious(candidates: Sequence[Candidate], best: Candidate) -> Candidate:
    """Return the candidate of the smallest order that is as good as the best one."""
    by_order = sorted(candidates, key=lambda each: (each.order, each.expected_error))
    return next(
        each for each in by_order if within_tolerance(each, best) and within_scatter(each, best)
    )


def within_tolerance(one: Candidate, best: Candidate) -> bool:
    """Return whether an error exceeds the best's by at most 3 %."""
    return one.expected_error <= TOLERANCE * max(best.expected_error, _SMALLEST_ERROR)


def within_scatter(one: Candidate, best: Candidate) -> bool:
    """Return whether a squared error exceeds the best's by at most two standard errors."""
    floor = _SMALLEST_ERROR**2
    ours, bests = (each.inflation**2 * each.parts for each in (one, best))
    weight = 1.0 / np.maximum(bests.sum(axis=0), floor)
    excess = np.sum(weight * (ours - bests), axis=1)
    scatter = np.sqrt(len(excess)) * np.std(excess, ddof=1)
    return bool(excess.sum() <= _STANDARD_ERRORS * scatter + floor * weight.sum())
