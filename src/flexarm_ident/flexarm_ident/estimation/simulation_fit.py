"""Models fitted by simulation error, which replace a subspace model that simulates worse.

A subspace model is linear and without friction. It is the start of two refinements: an arm with dry
friction, where the data have its structure and show friction, or a change of all its matrices. Both
are judged by a free simulation of all records where their sensors worked, and taken only when they
simulate better. A model whose errors are noise is refined by maximum likelihood instead, which is
judged by the likelihood.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import FlexarmError, IdentificationError
from flexarm_ident.arm.fit import NO_BETTER, fit_arm
from flexarm_ident.arm.notes import choice, levels_text, notes
from flexarm_ident.estimation.weighing import TOLERANCE, WEIGHED_SAMPLES, fitted
from flexarm_ident.fitting.refinement import refine_model
from flexarm_ident.fitting.stable_fit import fit_stable
from flexarm_ident.fitting.validation import mean_error, relative_errors
from flexarm_ident.friction.direction_test import recurs_with_direction
from flexarm_ident.friction.joint_fit import fit_joints
from flexarm_ident.friction.layout import arm_layout, joints
from flexarm_ident.friction.levels import estimate_coulomb, net_record
from flexarm_ident.likelihood.maximum_likelihood import maximise_likelihood
from flexarm_ident.models.modes import is_defective, modal_form
from flexarm_ident.models.state_space import is_stable, simulate
from flexarm_ident.records.iodata import IoData
from flexarm_ident.records.signals import live_samples
from flexarm_ident.subspace.methods import METHODS, estimate
from flexarm_ident.subspace.order import largest_order

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import control

    from flexarm_core.arrays import FloatArray, Progress
    from flexarm_ident.estimation.identification import Identification
    from flexarm_ident.friction.joint_fit import Start
    from flexarm_ident.friction.layout import ArmLayout
    from flexarm_ident.friction.levels import CoulombEstimate
    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.methods import Selection

ARM = "arm"
"""Method of a model that is an arm with dry friction."""
INTEGRATES = "the model integrates: an eigenvalue near 1 was set to 1"
"""Note on a model with an integrator."""
# Orders of the starts of a fit with friction at the joints, and an estimator that friction
# misleads least.
_START_METHOD, _FEWEST_STATES, _MOST_STATES = "pbsid", 4, 18
# Samples of all records together up to which the likelihood is maximised.
_LIKELY_SAMPLES = 100_000
# The same where there are no holes and it was asked for: in the frequency domain.
_LIKELY_WHOLE_SAMPLES = 1_000_000
_NOT_REFINED = "a change of all its matrices simulates the records no better: it was not refined"
_MISSES_NOISE = ", and what its simulation misses is noise"
# Distance from 1 at which the likelihood's search keeps an eigenvalue, and more.
_NEXT_TO_ONE = 1e-6


def is_compensated(records: Sequence[IoData]) -> bool:
    """Return whether a recorded signal compensates friction, as in the thesis (section 2.4.3)."""
    return any(
        record.compensation is not None and bool(np.any(record.compensation)) for record in records
    )


def with_friction(
    found: Identification, *, replaceable: bool, progress: Progress | None = None
) -> Identification:
    """Look for dry friction and take an arm with friction where it simulates better.

    A linear model with friction at its joints is tried first (`fit_joints`), on one record in which
    more than noise is missed. It stays when it simulates better what was left out of its fit.

    Else an arm is tried, and the test has three parts. The data have the channels of a flexible arm
    (`arm_layout`) and no recorded compensation. A Coulomb level exceeds its own scatter
    (`estimate_coulomb`), or the likelihood has been tried and shows that a linear model misses more
    than noise. An arm fitted with friction shows it (`ArmFit.has_friction`) and simulates the
    records with a smaller sum of squared relative errors than the subspace model. Where a linear
    model passes for missing nothing but noise, only a significant level, or errors that recur with
    the direction of motion (`direction_test`), are a reason to fit an arm, which takes a hundred
    times as long.

    Parameters
    ----------
    found : Identification
        Subspace model.
    replaceable : bool
        Whether the model may be replaced: method and order were left open.
    progress : callable, optional
        Called with the stage "friction" and the completed part.

    Returns
    -------
    Identification
        With an estimate of the Coulomb levels where the data allow one; with the arm and its
        friction where that is better; with a note where friction was found but is not modelled.
    """
    if replaceable and (jointed := _with_joints(found, progress)) is not None:
        return jointed
    layout = None if is_compensated(found.records) else _layout(found)
    return _with_arm_or_note(found, layout, replaceable=replaceable, progress=progress)


def _with_arm_or_note(
    found: Identification,
    layout: ArmLayout | None,
    *,
    replaceable: bool,
    progress: Progress | None,
) -> Identification:
    """Return an arm with friction, or what was found of friction as levels and a note."""
    records = found.records
    if layout is None:
        return found
    try:
        coulomb = estimate_coulomb(records, layout.slipping)
    except IdentificationError:
        return found  # too few slipping samples
    found = replace(found, coulomb=coulomb)
    recurs = found.likelihood is not None and recurs_with_direction(
        found.likelihood, records, layout.slipping
    )
    # Smoothing can hide a low level under a fast law; that the likelihood fails shows it.
    hidden = found.likelihood is None and (coulomb.possible or may_be_likely(records))
    if not (coulomb.present or recurs or hidden):
        return found
    if recurs:
        found = replace(found, choice=found.choice.removesuffix(_MISSES_NOISE))
    obstacle = _obstacle(layout, replaceable=replaceable)
    if not obstacle:
        try:
            return _with_arm(found, layout, progress)
        except IdentificationError as error:
            obstacle = str(error)
    if coulomb.present:
        what = f"dry friction was found, {levels_text(coulomb)}, but"
    elif recurs:
        what = "the errors recur with the direction of motion, as with dry friction, but it"
    else:
        return found
    return replace(found, notes=(*found.notes, f"{what} is not in the model: {obstacle}"))


def _with_arm(
    found: Identification, layout: ArmLayout, progress: Progress | None
) -> Identification:
    """Return the arm with friction in the place of a linear model.

    Raises
    ------
    IdentificationError
        If there is none that is better.
    """
    records = found.records
    start_error = _errors(_simulated(found.model, found.x0, records), records)
    fit = fit_arm(records, layout.drives, error_to_beat=start_error, progress=progress)
    if not (fit.has_friction and _better(fit.error, start_error)):
        raise IdentificationError(NO_BETTER)
    return replace(
        found,
        model=fit.model,
        x0=fit.x0,
        order=fit.model.nstates,
        method=ARM,
        fit_error=fit.error,
        start_error=start_error,
        friction=fit.friction,
        likelihood=None,
        moved_eigenvalues=0,
        notes=notes(fit),
        choice=choice(fit, start_error, found.choice),
    )


def _with_joints(found: Identification, progress: Progress | None) -> Identification | None:
    """Return the linear model with friction at its joints, or None where it is not better.

    That is judged by the last part of the record, which has no part in the fit that is compared.
    """
    records, coulomb = found.records, _joint_levels(found)
    if coulomb is None:
        return None
    levels = np.maximum(coulomb.levels, coulomb.deviations)
    fit = fit_joints(
        *(found.model, _joint_starts(found, coulomb), records[0], coulomb.drives, levels),
        progress=progress,
    )
    start_error = _errors(_simulated(found.model, found.x0, records), records)
    if fit is None or not (fit.is_better and _better(fit.error, start_error)):
        return None
    where = ", ".join(drive.input for drive in coulomb.drives)
    left_out, linear = fit.left_out_means
    reason = (
        f"dry friction at {where} was fitted with the linear model: "
        f"{mean_error(fit.error):.3g} in simulation instead of "
        f"{mean_error(start_error):.3g}, and over the last part of the record, which the compared "
        f"fit left out, {left_out:.3g} instead of {linear:.3g} (geometric means over the outputs); "
        f"of the linear ones, {found.choice}"
    )
    return replace(
        found,
        model=fit.model,
        x0=(fit.x0,),
        order=fit.model.nstates,
        method=ARM,
        fit_error=fit.error,
        start_error=start_error,
        friction=fit.friction,
        coulomb=coulomb,
        moved_eigenvalues=0,
        notes=(),
        choice=reason,
    )


def _joint_starts(found: Identification, coulomb: CoulombEstimate) -> Iterator[Iterator[Start]]:
    """Yield linear models of rising order, with their initial states, as far as the data allow.

    The first of each order is that of the record without the friction that is seen in it.
    """
    whole = found.records[0]
    with suppress(FlexarmError):
        selections = [
            (
                record,
                estimate([record], [record], _START_METHOD, found.block_rows, feedthrough=False),
            )
            for record in (net_record(whole, coulomb), whole)
        ]
        most = min(_MOST_STATES, *(largest_order(each.space) for _, each in selections))
        for order in range(_FEWEST_STATES, 1 + most, 2):
            yield _of_order(order, selections)


def _of_order(order: int, selections: Sequence[tuple[IoData, Selection]]) -> Iterator[Start]:
    for record, selection in selections:
        with suppress(FlexarmError):
            start = fitted(
                *(selection, order, [record]),
                stable=True,
                feedthrough=False,
                noise_weighted=METHODS[_START_METHOD].noise_weighted,
            )
            if not is_defective(modal_form(start.model).vectors):
                yield start.model, start.fit.x0[0]


def _joint_levels(found: Identification) -> CoulombEstimate | None:
    """Return levels to start a fit of joints from, or None where there can be no such fit."""
    records = found.records
    linear = is_stable(found.model.A) and found.likelihood is None
    whole = len(records) == 1 and bool(records[0].usable.all()) and not is_compensated(records)
    drives = joints(records) if linear and whole else None
    if drives is None or is_defective(modal_form(found.model).vectors):
        return None
    try:
        return estimate_coulomb(records, drives)
    except IdentificationError:  # too few slipping samples
        return None


def may_be_likely(records: Sequence[Source]) -> bool:
    """Return whether `likely` is worth its time: where records are in memory, short, without holes.

    For others it takes several times as long as the choice among estimators.
    """
    if sum(map(len, records)) > _LIKELY_SAMPLES:
        return False
    return all(isinstance(record, IoData) and record.usable.all() for record in records)


def likely(found: Identification, *, progress: Progress | None = None) -> Identification | None:
    """Return the model of maximum likelihood, or None where it is not that of the records.

    It must simulate the records as well as the start does, and as well as its own dynamics can with
    other inputs, or as an integrator. Its errors must be noise: then there is nothing left in the
    data that another model could know. The records are such that `may_be_likely`.

    Parameters
    ----------
    found : Identification
        Subspace model.
    progress : callable, optional
        Called with the stage "refinement" and the completed part.
    """
    if not is_stable(found.model.A):
        return None
    at_once = not METHODS[found.method].consistent_under_feedback
    better = _most_likely(found, order_open=True, at_once=at_once, progress=progress)
    if better is None:
        return None
    # Slow drift of a free hub passes for coloured noise, but not for a good simulation.
    row = METHODS[found.method]
    same_dynamics = fit_stable(
        *(better.model.A, better.model.C, found.records, row.ways),
        feedthrough=bool(np.any(found.model.D)),
        noise_weighted=False,
    )
    possible = min(mean_error(found.fit_error), mean_error(same_dynamics.fit.error))
    # The likelihood weights outputs by their noise, so that their mean error may rise.
    if mean_error(better.fit_error) > TOLERANCE * possible:
        return None
    reason = f"{found.choice}; maximum likelihood made it order {better.order}{_MISSES_NOISE}"
    # Eigenvalues that were moved are the start's, and not in this model.
    kept = (INTEGRATES,) if INTEGRATES in found.notes and _integrates(better.model) else ()
    return replace(better, choice=reason, notes=kept)


def refined(
    found: Identification, *, order_open: bool, progress: Progress | None = None
) -> Identification:
    """Refine a linear model by maximum likelihood where its errors are noise.

    Otherwise it is refined by its simulation error over the leading parts of its records.

    Parameters
    ----------
    found : Identification
        Subspace model.
    order_open : bool
        Whether the likelihood may leave out modes.
    progress : callable, optional
        Called with the stage "refinement" and the completed part.

    Returns
    -------
    Identification
        The refined model, or the start when it simulates all records no worse, with a note.
    """
    better = _most_likely(found, order_open=order_open, at_once=False, progress=progress)
    if better is not None:
        return better
    records = found.records
    start_error = _errors(_simulated(found.model, found.x0, records), records)
    most = -(-WEIGHED_SAMPLES // len(records))
    heads = [record.head(most) for record in records]
    lower = refine_model(found.model, found.x0, heads, progress=progress)
    error = _errors(_simulated(lower.model, lower.x0, records), records)
    if not _better(error, start_error):
        return replace(found, notes=(*found.notes, _NOT_REFINED))
    note = "refined by the simulation error, as the errors recur with the input and are not noise"
    return replace(
        found,
        model=lower.model,
        x0=lower.x0,
        fit_error=error,
        start_error=start_error,
        notes=(*found.notes, note),
    )


def _most_likely(
    found: Identification, *, order_open: bool, at_once: bool, progress: Progress | None
) -> Identification | None:
    records = found.records
    whole = all(record.usable.all() for record in records)
    if sum(map(len, records)) > (_LIKELY_WHOLE_SAMPLES if whole else _LIKELY_SAMPLES):
        return None
    fit = maximise_likelihood(
        *(found.model, found.x0, records),
        order_open=order_open,
        at_once=at_once,
        progress=progress,
    )
    if fit is None:
        return None
    return replace(
        found,
        model=fit.model,
        x0=fit.x0,
        order=fit.model.nstates,
        fit_error=fit.error,
        start_error=found.fit_error,
        likelihood=fit,
        moved_eigenvalues=0,
        notes=(*found.notes, _likely_note(found.order, fit.model.nstates)),
    )


def _likely_note(before: int, after: int) -> str:
    note = "refined by maximum likelihood, as the errors pass for noise"
    if after == before:
        return note
    return f"{note}; order {after} instead of {before}, as what was left out followed the noise"


def _integrates(model: control.StateSpace) -> bool:
    return bool(np.abs(np.linalg.eigvals(model.A) - 1.0).min() < _NEXT_TO_ONE)


def _layout(found: Identification) -> ArmLayout | None:
    """Return the roles of the channels; a simulation shows them where noise hides them."""
    records = found.records
    layout = arm_layout(records)
    if layout is not None:
        return layout
    simulated = _simulated(found.model, found.x0, records)
    if not all(np.isfinite(y).all() for y in simulated):
        return None
    return arm_layout([replace(each, y=y) for each, y in zip(records, simulated, strict=True)])


def _obstacle(layout: ArmLayout, *, replaceable: bool) -> str:
    """Return why no arm can be fitted; empty when one can."""
    if not replaceable:
        return "the method or the order was given"
    if layout.speeds:
        speeds = ", ".join(drive.output for drive in layout.speeds)
        return (
            f"{speeds} measures a speed, which the arm with friction does not have; record the "
            "compensation, or leave that output out"
        )
    return ""


def _simulated(
    model: control.StateSpace, x0: Sequence[FloatArray], records: Sequence[IoData]
) -> list[FloatArray]:
    return [simulate(model, record.u, start) for record, start in zip(records, x0, strict=True)]


def _errors(simulated: Sequence[FloatArray], records: Sequence[IoData]) -> FloatArray:
    """Return the errors (2-25) where the sensors worked."""
    live = np.vstack([live_samples(record) for record in records])
    measured = live * np.vstack([record.y for record in records])
    return relative_errors(measured, live * np.vstack(simulated))


def _better(error: FloatArray, start: FloatArray) -> bool:
    return bool(np.nansum(error**2) < np.nansum(start**2))
