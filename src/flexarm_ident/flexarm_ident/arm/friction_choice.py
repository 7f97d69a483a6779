"""Choice of friction model: Coulomb and viscous, with the Stribeck effect, with the load.

A model with another effect has more parameters and simulates what it was fitted to no worse. It is
taken where it fits the records clearly better and simulates halves that were left out clearly
better as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.arm.equations import FrictionModel
from flexarm_ident.arm.simulation_error import LAST_STEPS, Part, descend

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.arm.equations import FlexibleArm
    from flexarm_ident.arm.simulation_error import SimulationError
    from flexarm_ident.fitting.levenberg_marquardt import Minimum

_EFFECTS = (FrictionModel.STRIBECK, FrictionModel.LOAD)
# Costs are squares of errors: an error on what was left out has to fall by 5 %.
_LEFT_OUT_PAYS = 0.9
_FIT_PAYS = 0.95
# A smaller part of the level is not friction, whatever an error says that is next to nothing.
_RELEVANT = 0.1
# Starts of a search: rise by the level, speeds by the RMS speed, load by the input.
_RISE = 0.3
_SPEEDS = (0.05, 0.3)
_LOAD = 0.1
_STEPS = 100
_MOTION_STEPS = 20


class Fit(NamedTuple):
    """Minima of a simulation error, the lowest first."""

    problem: SimulationError
    minima: tuple[Minimum, ...]

    @property
    def friction_model(self) -> FrictionModel:
        """What the friction depends on."""
        return self.problem.arm.friction_model

    @property
    def own(self) -> FloatArray:
        """Parameters of the arm at the lowest minimum, without those of first motions."""
        return self.minima[0].theta[: self.problem.arm.parameters]


@dataclass(frozen=True, eq=False)
class FrictionChoice:
    """Friction model that was chosen, and those that were tried.

    Attributes
    ----------
    whole : Fit
        Fit of the records.
    halves : tuple of Fit
        Fits of their first and second halves, which know nothing of each other.
    left_out : dict of FrictionModel to tuple of float
        Relative error of each half that was left out, by friction model.
    """

    whole: Fit
    halves: tuple[Fit, ...]
    left_out: dict[FrictionModel, tuple[float, ...]]

    @property
    def friction_model(self) -> FrictionModel:
        """What the friction depends on."""
        return self.whole.friction_model


def choose_friction(problem: SimulationError, minima: Sequence[Minimum]) -> FrictionChoice:
    """Add effects to the friction as long as they pay.

    Parameters
    ----------
    problem : SimulationError
        Simulation error of an arm with Coulomb friction.
    minima : sequence of Minimum
        Its minima, the lowest first.
    """
    here = _judged(Fit(problem, tuple(minima)), _halves(problem, minima[0].theta))
    while missing := [effect for effect in _EFFECTS if effect not in here.friction_model]:
        tried = [
            _judged(
                _with_effect(here.whole, effect),
                tuple(_with_effect(half, effect) for half in here.halves),
            )
            for effect in missing
        ]
        best = min(tried, key=lambda each: sum(np.square(each.left_out[each.friction_model])))
        left_out = here.left_out | {
            each.friction_model: each.left_out[each.friction_model] for each in tried
        }
        pays = _pays(here, best)
        here = replace(best if pays else here, left_out=left_out)
        if not pays:
            break
    return here


def _pays(here: FrictionChoice, higher: FrictionChoice) -> bool:
    fit = higher.whole.minima[0].cost <= _FIT_PAYS * here.whole.minima[0].cost
    before, after = (
        np.array(here.left_out[here.friction_model]),
        np.array(higher.left_out[higher.friction_model]),
    )
    left_out = np.sum(after**2) <= _LEFT_OUT_PAYS * np.sum(before**2)
    relevant = np.any(
        _part_of_level(higher.whole, higher.friction_model & ~here.friction_model) > _RELEVANT
    )
    return bool(fit and left_out and relevant and np.all(after < before))


def _part_of_level(fit: Fit, effect: FrictionModel) -> FloatArray:
    """Return the size of an effect as a part of the Coulomb level, (inputs,)."""
    levels, rises, _, loads = fit.problem.arm.laws(fit.own).T
    if effect == FrictionModel.STRIBECK:
        return np.asarray(rises / levels)
    sizes = np.vstack([part.sizes for part in fit.problem.parts])
    return np.asarray(loads * np.sqrt(np.mean(sizes**2, axis=0)) / levels)


def _judged(whole: Fit, halves: tuple[Fit, ...]) -> FrictionChoice:
    """Return the fits with the error of each half under the arm of the other half.

    The first motion of a half is fitted to that half: it is not a property of the arm.
    """
    errors = []
    for half, other in (halves, halves[::-1]):
        theta = np.concatenate([half.own, other.minima[0].theta[len(other.own) :]])
        motions = np.arange(len(half.own), len(theta))
        found = descend(other.problem, theta, iterations=_MOTION_STEPS, free=motions)
        errors.append(float(np.sqrt(found.cost / other.problem.arm.outputs)))
    return FrictionChoice(whole, halves, {whole.friction_model: tuple(errors)})


def _with_effect(fit: Fit, effect: FrictionModel) -> Fit:
    arm = replace(fit.problem.arm, friction_model=fit.friction_model | effect)
    problem = replace(fit.problem, arm=arm)
    found = [descend(problem, start, iterations=_STEPS) for start in _starts(fit, arm)]
    return Fit(problem, tuple(sorted(found, key=lambda each: each.cost)))


def _starts(fit: Fit, higher: FlexibleArm) -> Iterator[FloatArray]:
    """Yield parameters with one more effect: those of the fit, and guesses for what is new."""
    lower, theta = fit.problem.arm, fit.minima[0].theta
    new = [name for name, place in higher.blocks.items() if place.stop > place.start]
    new = [name for name in new if not len(theta[lower.blocks[name]])]
    for pace in _SPEEDS if "log_speed" in new else _SPEEDS[:1]:
        guesses = {
            "log_rise": np.log(_RISE * lower.levels(theta)),
            "log_speed": np.log(pace * fit.problem.usual_speed),
            "log_load": np.full(lower.inputs, np.log(_LOAD)),
        }
        start = np.zeros(higher.parameters)
        for name, place in higher.blocks.items():
            start[place] = guesses[name] if name in new else theta[lower.blocks[name]]
        yield np.concatenate([start, theta[lower.parameters :]])


def _halves(problem: SimulationError, theta: FloatArray) -> tuple[Fit, ...]:
    """Return fits of the records' first and second halves."""
    own, count = theta[: problem.arm.parameters], problem.arm.motions
    first, second, motions = [], [], []
    for part, x in zip(problem.parts, problem.states(theta), strict=True):
        middle = len(x) // 2
        first.append(Part(*(each[:middle] for each in part)))
        second.append(Part(*(each[middle:] for each in part)))
        motions.append(x[middle, :count])
    problems = [replace(problem, parts=tuple(parts)) for parts in (first, second)]
    starts = [theta, np.concatenate([own, *motions])]
    return tuple(
        # Until nothing is left of what the start knows of the other half.
        Fit(half, (descend(half, start, iterations=LAST_STEPS),))
        for half, start in zip(problems, starts, strict=True)
    )
