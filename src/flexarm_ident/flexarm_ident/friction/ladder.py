"""Ladder of friction: Coulomb and viscous, higher at standstill after Stribeck, higher under load.

A higher rung has more parameters, so it simulates what it was fitted to no worse. It is taken where
it fits the records clearly better and simulates halves that were left out clearly better as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.fitting.levenberg_marquardt import Minimum, minimise
from flexarm_ident.friction.arm import Rung
from flexarm_ident.friction.arm_error import Part
from flexarm_ident.friction.some_parameters import minimise_some

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.friction.arm import FlexibleArm
    from flexarm_ident.friction.arm_error import SimulationError

_EFFECTS = (Rung.STRIBECK, Rung.LOAD)
# Costs are squares of errors: an error on what was left out has to fall by 5 %.
_LEFT_OUT_PAYS = 0.9
_FIT_PAYS = 0.95
# Starts of a search: rise by the level, speeds by the RMS speed, load by the input.
_RISE = 0.3
_SPEEDS = (0.05, 0.3)
_LOAD = 0.1
_STEPS = 60
_MOTION_STEPS = 20


@dataclass(frozen=True, eq=False)
class Climb:
    """Rung that was reached, and those that were tried.

    Attributes
    ----------
    problem : SimulationError
        Simulation error of the arm with the friction of that rung.
    minima : tuple of Minimum
        Its minima, the lowest first.
    left_out : dict of Rung to float
        Relative errors of halves that were left out of the fit, by rung.
    """

    problem: SimulationError
    minima: tuple[Minimum, ...]
    left_out: dict[Rung, float]

    @property
    def rung(self) -> Rung:
        """What the friction depends on."""
        return self.problem.arm.rung


def climb(problem: SimulationError, minima: Sequence[Minimum]) -> Climb:
    """Add effects to the friction as long as they pay.

    Parameters
    ----------
    problem : SimulationError
        Simulation error of an arm with Coulomb friction.
    minima : sequence of Minimum
        Its minima, the lowest first.
    """
    here = Climb(problem, tuple(minima), {Rung.COULOMB: _left_out(problem, minima[0].theta)})
    while missing := [effect for effect in _EFFECTS if effect not in here.rung]:
        tried = [_with_effect(here, effect) for effect in missing]
        left_out = here.left_out | {each.rung: each.left_out[each.rung] for each in tried}
        here = replace(here, left_out=left_out)
        best = min(tried, key=lambda each: left_out[each.rung])
        if not _pays(here, best):
            break
        here = replace(best, left_out=left_out)
    return here


def _pays(here: Climb, higher: Climb) -> bool:
    fit = higher.minima[0].cost <= _FIT_PAYS * here.minima[0].cost
    before, after = here.left_out[here.rung], higher.left_out[higher.rung]
    return bool(fit and after**2 <= _LEFT_OUT_PAYS * before**2)


def _with_effect(here: Climb, effect: Rung) -> Climb:
    arm = replace(here.problem.arm, rung=here.rung | effect)
    problem = replace(here.problem, arm=arm)
    found = [
        minimise(start, problem.cost, problem.normal, iterations=_STEPS)
        for start in _starts(here, arm)
    ]
    found.sort(key=lambda each: each.cost)
    return Climb(problem, tuple(found), {arm.rung: _left_out(problem, found[0].theta)})


def _starts(here: Climb, higher: FlexibleArm) -> Iterator[FloatArray]:
    """Yield parameters on a higher rung: those of here, and guesses for what is new."""
    lower, theta = here.problem.arm, here.minima[0].theta
    speeds = np.vstack([x @ lower.speed.T for x in here.problem.states(theta)])
    rms = np.sqrt(np.mean(speeds**2, axis=0))
    new = [name for name, place in higher.blocks.items() if place.stop > place.start]
    new = [name for name in new if not len(theta[lower.blocks[name]])]
    for pace in _SPEEDS if "log_speed" in new else _SPEEDS[:1]:
        guesses = {
            "log_rise": np.log(_RISE * lower.levels(theta)),
            "log_speed": np.log(pace * rms),
            "log_load": np.full(lower.inputs, np.log(_LOAD)),
        }
        start = np.zeros(higher.parameters)
        for name, place in higher.blocks.items():
            start[place] = guesses[name] if name in new else theta[lower.blocks[name]]
        yield np.concatenate([start, theta[lower.parameters :]])


def _left_out(problem: SimulationError, theta: FloatArray) -> float:
    """Return the error of each half of the records under the parameters of the other half.

    The first motion of a half is fitted to that half: it is no property of the arm.
    """
    arm, halves = problem.arm, _halves(problem, theta)
    motions = np.arange(arm.parameters, len(theta))
    cost = 0.0
    for (own, start), (other, there) in (halves, halves[::-1]):
        found = minimise(start, own.cost, own.normal, iterations=_STEPS)
        joined = np.concatenate([found.theta[: arm.parameters], there[arm.parameters :]])
        cost += minimise_some(other, joined, motions, iterations=_MOTION_STEPS).cost
    return float(np.sqrt(cost / arm.outputs))


def _halves(
    problem: SimulationError, theta: FloatArray
) -> list[tuple[SimulationError, FloatArray]]:
    """Return the problems of the records' first and second halves, each with its parameters."""
    own, count = theta[: problem.arm.parameters], problem.arm.motions
    first, second, motions = [], [], []
    for part, x in zip(problem.parts, problem.states(theta), strict=True):
        middle = len(x) // 2
        first.append(Part(*(each[:middle] for each in part)))
        second.append(Part(*(each[middle:] for each in part)))
        motions.append(x[middle, :count])
    return [
        (replace(problem, parts=tuple(first)), theta),
        (replace(problem, parts=tuple(second)), np.concatenate([own, *motions])),
    ]
