"""Steps of a servo on twins of its model, with friction, noise, limits and the loop's delay."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_control.design.criteria import unit_step_figures
from flexarm_control.servo.controller import Law, Memory, advance, new_memory
from flexarm_control.servo.regulator import loop_plant
from flexarm_control.servo.robustness import vibrations, with_modes
from flexarm_core.compilation import compiled
from flexarm_ident.models.state_space import with_matrices
from flexarm_ident.models.stick_slip import friction_force

if TYPE_CHECKING:
    import control

    from flexarm_control.servo.controller import Servo
    from flexarm_core.arrays import FloatArray

TWINS = 50
SETTLED = 0.02
"""Part of a step within which an output is settled."""
_LAST = 0.2
_GAIN, _DAMPING, _FRICTION = 1.25, 2.0, 1.5


@dataclass(frozen=True, eq=False)
class Twin:
    """Plant of a loop.

    Attributes
    ----------
    model : control.StateSpace
        Model of the plant.
    levels : ndarray, (inputs,)
        Coulomb friction at the inputs; 0 for none.
    speed : ndarray, (inputs, states)
        Map from the state to the speeds that it opposes.
    noise : ndarray, (outputs,)
        Standard deviation of each output's noise.
    delay_s : float
        Delay of the loop, s.
    """

    model: control.StateSpace
    levels: FloatArray
    speed: FloatArray
    noise: FloatArray
    delay_s: float = 0.0


class Run(NamedTuple):
    """Outputs without noise, (samples, outputs), and commands, (samples, inputs), of a step."""

    y: FloatArray
    u: FloatArray


class StepResult(NamedTuple):
    """Figures of a step of one tracked output.

    Attributes
    ----------
    output : str
        Its name.
    overshoot : float
        Most that it goes beyond, as a part of the step.
    settling_s : float
        Time from which it stays within 2 % of the step, s; infinite for never.
    steady_error : float
        Mean error over the last fifth, as a part of the step.
    """

    output: str
    overshoot: float
    settling_s: float
    steady_error: float


def step_run(servo: Servo, twin: Twin, steps: FloatArray, seconds: float, *, seed: int) -> Run:
    """Step all tracked outputs of a twin from rest.

    Parameters
    ----------
    servo : Servo
        Controller; its own state stays.
    twin : Twin
        The plant.
    steps : ndarray, (tracked,)
        Set-points from the first sample on.
    seconds : float
        Length.
    seed : int
        Seed of the noise.
    """
    samples = max(2, round(seconds * servo.rate_hz))
    plant = loop_plant(twin.model, twin.delay_s)
    noise = np.random.default_rng(seed).standard_normal((samples, plant.noutputs))
    held = plant.nstates - twin.model.nstates
    force = np.vstack([twin.model.B, np.zeros((held, plant.ninputs))])
    speed = np.hstack([twin.speed, np.zeros((plant.ninputs, held))])
    A, B, C, force, speed = map(np.ascontiguousarray, (plant.A, plant.B, plant.C, force, speed))
    levels = np.asarray(twin.levels, dtype=np.float64)
    world = _Plant(A, B, C, force, speed, levels, noise * twin.noise)
    memory = new_memory(servo.law, servo.gains.windows)
    y, u = _run(world, servo.law, memory, np.asarray(steps, dtype=np.float64))
    return Run(y, u)


def perturbed(twin: Twin, seed: int, spread: float) -> Twin:
    """Return a twin with other frequencies, dampings, gains and friction.

    Frequencies of vibrations lie within the spread, dampings within a factor of 2, gains of the
    inputs within 1.25, friction within half of its level. Damped pairs stay: in an identified model
    they cancel each other, and apart they would be another plant.
    """
    rng = np.random.default_rng(seed)
    factors = {}
    for value in vibrations(twin.model):
        speed = np.log(value)
        damped = complex(speed.real * _DAMPING ** rng.uniform(-1.0, 1.0), speed.imag)
        factors[value] = (1.0 + spread * rng.uniform(-1.0, 1.0)) * damped / speed
    gains = _GAIN ** rng.uniform(-1.0, 1.0, twin.model.ninputs)
    changed = with_matrices(with_modes(twin.model, factors), B=twin.model.B * gains)
    levels = twin.levels * rng.uniform(2.0 - _FRICTION, _FRICTION, twin.model.ninputs)
    return replace(twin, model=changed, levels=levels)


def step_results(servo: Servo, run: Run, steps: FloatArray) -> tuple[StepResult, ...]:
    """Return the figures of a step of every tracked output."""
    results = []
    time_s = np.arange(len(run.y)) / servo.rate_hz
    for name, place, step in zip(servo.tracked, servo.law.places, steps, strict=True):
        progress = run.y[:, place] / step
        overshoot, settling_s, _ = unit_step_figures(time_s, progress, SETTLED)
        steady_error = float(np.mean(progress[-max(1, round(_LAST * len(progress))) :] - 1.0))
        results.append(StepResult(name, overshoot, settling_s, steady_error))
    return tuple(results)


class _Plant(NamedTuple):
    """A plant as compiled code takes it: with the forces of friction, and the noise of a run."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    force: FloatArray
    speed: FloatArray
    levels: FloatArray
    noise: FloatArray


@compiled
def _run(
    plant: _Plant, law: Law, memory: Memory, steps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Close the loop of a plant with friction and a servo; return outputs and commands."""
    samples, inputs = len(plant.noise), plant.B.shape[1]
    y, u = np.empty((samples, len(plant.C))), np.zeros((samples, inputs))
    x, wanted = np.zeros(len(plant.A)), np.zeros(len(steps))
    gain = plant.speed @ plant.force
    for k in range(samples):
        y[k] = plant.C @ x
        # The loop takes its rest from the first sample.
        if k > 0:
            wanted[:] = steps
        advance(law, memory, y[k] + plant.noise[k], wanted, u[k])
        after = plant.A @ x + plant.B @ u[k]
        x = after - plant.force @ friction_force(plant.speed @ after, gain, plant.levels)
    return y, u
