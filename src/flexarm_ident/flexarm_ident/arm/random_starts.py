"""Random starts of the fit of an arm with dry friction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from flexarm_core.arrays import FloatArray
    from flexarm_ident.arm.simulation_error import Part, SimulationError

# Samples of a record's beginning that tell its first speeds: half a period.
_BEGINNING = 5


class RandomStarts:
    """Parameters of arms at random, around the scales of the records.

    Parameters
    ----------
    problem : SimulationError
        Records and family of models.
    band_hz : float
        Frequency below which the outputs' power lies.
    rng : numpy.random.Generator
        Source of the random numbers.
    """

    def __init__(self, problem: SimulationError, band_hz: float, rng: np.random.Generator) -> None:
        self._arm, self._rng, self._band_hz = problem.arm, rng, band_hz
        self._problem = problem
        driven = list(problem.arm.positions)
        u = np.vstack([part.u for part in problem.parts])
        speed = [np.gradient(part.y[:, driven], problem.dt_s, axis=0) for part in problem.parts]
        acceleration = np.vstack([np.gradient(v, problem.dt_s, axis=0) for v in speed])
        self._u = np.sqrt(np.mean(u**2, axis=0))
        self._speed = problem.usual_speed
        self._acceleration = np.sqrt(np.mean(acceleration**2, axis=0))
        y = np.vstack([part.y for part in problem.parts])
        self._y = np.sqrt(np.mean(y**2, axis=0))
        self._motions = [self._motion(part) for part in problem.parts]

    def start(self) -> FloatArray:
        """Return parameters of an arm and the first motion of each record."""
        arm, r, e = self._arm, self._arm.inputs, len(self._arm.elastic)
        n = r + e
        # Elastic coordinates move by about one, their stiffness is one.
        gain = self._spread(1.0 / self._u, 0.0, 3.0)
        mass = gain * self._spread(self._u / self._acceleration, -2.0, 1.0)
        frequency_hz = self._spread(np.full(e, self._band_hz), -2.0, 0.0)
        diagonal = np.sqrt(np.concatenate([mass, (2.0 * np.pi * frequency_hz) ** -2.0]))
        mixed = self._rng.normal(size=(n, n + 1))
        mixed = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
        viscous = gain * self._spread(self._u / self._speed, -3.0, -1.0)
        damping = np.sqrt(np.concatenate([viscous, 0.04 * diagonal[r:]]))
        theta = np.zeros(arm.parameters)
        lower = np.tril_indices(n)
        root = np.linalg.cholesky(mixed @ mixed.T * np.outer(diagonal, diagonal))
        theta[arm.blocks["mass"]] = root[lower]
        theta[arm.blocks["damping"]] = np.diag(damping)[lower]
        theta[arm.blocks["log_gain"]] = np.log(gain)
        # Gauges of the outputs' size: `_motion` rests on them.
        theta[arm.blocks["gauges"]] = np.diag(self._y[list(arm.elastic)]).ravel()
        bandwidth = 2.0 * np.pi * self._spread(np.full(e, self._band_hz), -1.0, 1.0)
        theta[arm.blocks["log_bandwidth"]] = np.log(bandwidth)
        theta[arm.blocks["log_level"]] = np.log(self._spread(self._u, -1.5, 0.5))
        return np.concatenate([theta, *self._motions])

    def _motion(self, part: Part) -> FloatArray:
        """Return coordinates and speeds at the beginning of a record."""
        times_s = self._problem.dt_s * np.arange(_BEGINNING)
        speed, place = np.polyfit(times_s, part.y[:_BEGINNING], 1)
        elastic = list(self._arm.elastic)
        for change in (place, speed):
            change[elastic] = np.divide(
                change[elastic],
                self._y[elastic],
                out=np.zeros(len(elastic)),
                where=self._y[elastic] > 0.0,
            )
        order = [*self._arm.positions, *elastic]
        motion = np.concatenate([place[order], speed[order]])
        return np.where(self._problem.undetermined(part), 0.0, motion)

    def _spread(self, scale: FloatArray, low: float, high: float) -> FloatArray:
        return np.asarray(scale * np.exp(self._rng.uniform(low, high, len(scale))))
