"""Servo controller as it runs: one sample after the other, without ROS and without allocation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_core.compilation import compiled

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from flexarm_core.arrays import FloatArray

PLAN_ROWS = 7
"""Slope, mean over one window, over both, that once and twice late, and two differences."""


@dataclass(frozen=True, eq=False)
class ServoGains:
    """Everything that a servo computes with.

    Attributes
    ----------
    inputs, outputs, tracked : tuple of str
        Names of the commands, of the measured outputs, and of those with a set-point.
    rate_hz, bandwidth_hz, disk_margin : float
        Sampling rate, bandwidth, and the worst disk margin of the design.
    limits : ndarray, (inputs,)
        Largest commands; infinite for none.
    A, B, C : ndarray
        Model with disturbances: (states, states), (states, inputs), (outputs, states).
    feedback : ndarray, (inputs, states)
        Gain on what the estimated state differs from the planned one.
    correction : ndarray, (states, outputs)
        Gain of the filter.
    deviation : ndarray, (states, states)
        Transition of what the estimated state differs from the planned one.
    planning : ndarray, (inputs, states)
        Gain on the planned state.
    forward : ndarray, (3, inputs, tracked)
        Gains on the planned set-points and on their differences.
    rest : ndarray, (states, tracked)
        State at rest for unit tracked outputs.
    slopes : ndarray, (tracked,)
        Largest change of a planned set-point in one sample.
    windows : ndarray of int, (2,)
        Samples of the two averages of the plan.
    levels : ndarray, (inputs,)
        Friction that is compensated while the plan moves; 0 for none.
    onsets : ndarray, (inputs, tracked)
        Part of the level for a planned change of 1 a sample; no more than all of it counts.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    tracked: tuple[str, ...]
    rate_hz: float
    bandwidth_hz: float
    disk_margin: float
    limits: FloatArray
    A: FloatArray
    B: FloatArray
    C: FloatArray
    feedback: FloatArray
    correction: FloatArray
    deviation: FloatArray
    planning: FloatArray
    forward: FloatArray
    rest: FloatArray
    slopes: FloatArray
    windows: NDArray[np.int64]
    levels: FloatArray
    onsets: FloatArray


class Law(NamedTuple):
    """Gains of `ServoGains` as compiled code takes them, and the places of tracked outputs."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    feedback: FloatArray
    correction: FloatArray
    deviation: FloatArray
    planning: FloatArray
    forward: FloatArray
    rest: FloatArray
    slopes: FloatArray
    limits: FloatArray
    levels: FloatArray
    onsets: FloatArray
    places: NDArray[np.int64]


ARRAYS = Law._fields[:-1]
"""Names of the gains among the fields of `Law`."""


class Memory(NamedTuple):
    """What a servo knows from one sample to the next.

    Attributes
    ----------
    state : ndarray, (2, states)
        Predicted and planned state.
    plan : ndarray, (PLAN_ROWS, tracked)
        Planned set-points on the way through the windows.
    long, short : ndarray, (samples, tracked)
        Both windows.
    progress : ndarray of int, (3,)
        Places in both windows, and whether the loop has begun.
    """

    state: FloatArray
    plan: FloatArray
    long: FloatArray
    short: FloatArray
    progress: NDArray[np.int64]


class Servo:
    """Controller for one loop.

    Parameters
    ----------
    gains : ServoGains
        From a design or its file.

    Attributes
    ----------
    inputs, outputs, tracked : list of str
        Names, in the order in which `step` gives and takes them.
    rate_hz : float
        Rate at which `step` is to be called.
    law : Law
        Argument of `advance`.

    Examples
    --------
    ::

        controller = load_controller("out/design/controller.yaml")
        controller.reset()
        u = controller.step(y, r)
    """

    def __init__(self, gains: ServoGains) -> None:
        self.gains = gains
        self.inputs = list(gains.inputs)
        self.outputs = list(gains.outputs)
        self.tracked = list(gains.tracked)
        self.rate_hz = gains.rate_hz
        arrays = {
            name: np.ascontiguousarray(getattr(gains, name), dtype=np.float64) for name in ARRAYS
        }
        places = np.array([self.outputs.index(name) for name in gains.tracked])
        memory = new_memory(Law(**arrays, places=places), gains.windows)
        # One array is handed over to compiled code in a tenth of the time of twenty.
        parts = [*arrays.values(), memory.state, memory.plan, memory.long, memory.short]
        self._packed = np.concatenate([np.ravel(part) for part in parts])
        counts = (len(gains.A), len(self.inputs), len(self.outputs), len(self.tracked))
        self._sizes = np.array([*counts, *map(int, gains.windows)])
        self.law, self._memory = _unpacked(self._packed, self._sizes, places, memory.progress)
        self._y, self._r = np.zeros(len(self.outputs)), np.zeros(len(self.tracked))
        self._u = np.zeros(len(self.inputs))
        # The first call compiles, or loads what was compiled.
        self.step(self._y, self._r)
        self.reset()

    def reset(self) -> None:
        """Forget the past: the next step takes the plant for at rest where it then is."""
        self._memory.progress[:] = 0

    def step(self, y: ArrayLike, r: ArrayLike) -> list[float]:
        """Return the commands of one sample.

        Parameters
        ----------
        y : sequence of float
            Measured outputs, in the order of `outputs`.
        r : sequence of float
            Set-points, in the order of `tracked`.

        Returns
        -------
        list of float
            Commands within the limits, in the order of `inputs`.

        Raises
        ------
        ValueError
            When there are not as many outputs or set-points as the controller has.
        """
        self._y[:] = y
        self._r[:] = r
        _advance_packed(
            self._packed,
            self._sizes,
            self.law.places,
            self._memory.progress,
            self._y,
            self._r,
            self._u,
        )
        return self._u.tolist()

    def hear(self, applied: Sequence[float]) -> None:
        """Tell the commands that were applied in the place of those of the last step.

        The filter then knows what a limiter or a person made of them.

        Parameters
        ----------
        applied : sequence of float
            Commands in force until the next sample.
        """
        changed = np.asarray(applied, dtype=np.float64) - self._u
        self._memory.state[0] += self.law.B @ changed
        self._u[:] = applied

    def memory(self) -> dict[str, list[float]]:
        """Return what the next steps follow from, by the names of its groups."""
        groups = {name: np.ravel(each).tolist() for name, each in self._memory._asdict().items()}
        return {**groups, "commands": self._u.tolist()}

    def remember(self, memory: Mapping[str, Sequence[float]]) -> None:
        """Go on from a memory of the same controller; `memory` may have further groups."""
        for name, each in self._memory._asdict().items():
            each[...] = np.reshape(memory[name], each.shape)
        self._u[:] = memory["commands"]


def new_memory(law: Law, windows: NDArray[np.int64]) -> Memory:
    """Return the memory of a servo before its first sample."""
    tracked = len(law.places)
    long, short = (np.zeros((int(window), tracked)) for window in windows)
    return Memory(
        np.zeros((2, len(law.B))),
        np.zeros((PLAN_ROWS, tracked)),
        long,
        short,
        np.zeros(3, dtype=np.int64),
    )


@compiled
def advance(law: Law, memory: Memory, y: FloatArray, r: FloatArray, u: FloatArray) -> None:
    """Advance a servo by one sample; `c_code` says the same in C.

    The outputs `y` and set-points `r` are read, the commands `u` written.
    """
    if memory.progress[2] == 0:
        _begin(law, memory, y)
    _plan(law, memory, r)
    now = memory.state[0].copy()
    for k in range(len(y)):
        error = y[k]
        for i in range(len(now)):
            error -= law.C[k, i] * memory.state[0, i]
        for i in range(len(now)):
            now[i] += law.correction[i, k] * error
    wanted, net = np.zeros(len(u)), np.zeros(len(u))
    for i in range(len(u)):
        for k in range(3):
            for j in range(len(r)):
                wanted[i] += law.forward[k, i, j] * memory.plan[4 + k, j]
        for j in range(len(now)):
            wanted[i] -= law.planning[i, j] * memory.state[1, j]
        total = wanted[i]
        for j in range(len(now)):
            total -= law.feedback[i, j] * (now[j] - memory.state[1, j])
        friction = _friction(law, memory, i)
        u[i] = min(max(total + friction, -law.limits[i]), law.limits[i])
        net[i] = u[i] - friction
    _predict(law, memory, now, net, wanted)


@compiled
def _advance_packed(  # noqa: PLR0917 (compiled code has no keyword arguments)
    packed: FloatArray,
    sizes: NDArray[np.int64],
    places: NDArray[np.int64],
    progress: NDArray[np.int64],
    y: FloatArray,
    r: FloatArray,
    u: FloatArray,
) -> None:
    """Advance a servo whose gains and memory stand in one array."""
    law, memory = _unpacked(packed, sizes, places, progress)
    advance(law, memory, y, r, u)


@compiled
def _unpacked(
    packed: FloatArray,
    sizes: NDArray[np.int64],
    places: NDArray[np.int64],
    progress: NDArray[np.int64],
) -> tuple[Law, Memory]:
    """Return gains and memory as views of one array, in the order of their fields."""
    n, inputs, outputs, tracked, long, short = sizes
    A, end = _part(packed, 0, (n, n))
    B, end = _part(packed, end, (n, inputs))
    C, end = _part(packed, end, (outputs, n))
    feedback, end = _part(packed, end, (inputs, n))
    correction, end = _part(packed, end, (n, outputs))
    deviation, end = _part(packed, end, (n, n))
    planning, end = _part(packed, end, (inputs, n))
    forward, end = _part(packed, end, (3, inputs, tracked))
    rest, end = _part(packed, end, (n, tracked))
    slopes, end = _part(packed, end, (tracked,))
    limits, end = _part(packed, end, (inputs,))
    levels, end = _part(packed, end, (inputs,))
    onsets, end = _part(packed, end, (inputs, tracked))
    gains = (A, B, C, feedback, correction, deviation, planning, forward, rest, slopes, limits)
    law = Law(*gains, levels, onsets, places)
    state, end = _part(packed, end, (2, n))
    plan, end = _part(packed, end, (PLAN_ROWS, tracked))
    long_window, end = _part(packed, end, (long, tracked))
    short_window, _ = _part(packed, end, (short, tracked))
    memory = Memory(state, plan, long_window, short_window, progress)
    return law, memory


@compiled
def _part(packed: FloatArray, start: int, shape: tuple[int, ...]) -> tuple[FloatArray, int]:
    """Return the part of an array with a shape, and where it ends."""
    size = 1
    for side in shape:
        size *= side
    return packed[start : start + size].reshape(shape), start + size


@compiled
def _begin(law: Law, memory: Memory, y: FloatArray) -> None:
    """Take the plant for at rest where the tracked outputs are."""
    memory.progress[2] = 1
    memory.state[:] = 0.0
    for j in range(len(law.places)):
        start = y[law.places[j]]
        memory.plan[:, j] = start
        memory.long[:, j] = start
        memory.short[:, j] = start
        for i in range(memory.state.shape[1]):
            memory.state[:, i] += law.rest[i, j] * start


@compiled
def _plan(law: Law, memory: Memory, r: FloatArray) -> None:
    """Move the plan by one sample."""
    plan = memory.plan
    for j in range(len(r)):
        plan[4, j] = plan[3, j]
        plan[3, j] = plan[2, j]
        plan[0, j] += min(max(r[j] - plan[0, j], -law.slopes[j]), law.slopes[j])
    _average(plan, 0, memory.long, memory.progress)
    _average(plan, 1, memory.short, memory.progress)
    for j in range(len(r)):
        plan[5, j] = plan[3, j] - plan[4, j]
        plan[6, j] = plan[2, j] - 2.0 * plan[3, j] + plan[4, j]


@compiled
def _friction(law: Law, memory: Memory, i: int) -> float:
    """Return the friction of an input that the planned motion meets."""
    part = 0.0
    for j in range(memory.plan.shape[1]):
        part += law.onsets[i, j] * memory.plan[5, j]
    return float(law.levels[i] * min(max(part, -1.0), 1.0))


@compiled
def _average(plan: FloatArray, row: int, window: FloatArray, progress: NDArray[np.int64]) -> None:
    """Write the mean of a row of the plan over a window to the next row."""
    place = progress[row]
    size = len(window)
    for j in range(plan.shape[1]):
        plan[row + 1, j] += (plan[row, j] - window[place, j]) / size
        window[place, j] = plan[row, j]
    progress[row] = (place + 1) % size
    if progress[row] == 0:
        # Sums of differences drift by their rounding: now and then, the mean is formed anew.
        for j in range(plan.shape[1]):
            total = 0.0
            for k in range(size):
                total += window[k, j]
            plan[row + 1, j] = total / size


@compiled
def _predict(
    law: Law, memory: Memory, now: FloatArray, net: FloatArray, wanted: FloatArray
) -> None:
    """Write what the filter and the plan expect at the next sample."""
    states, inputs = law.B.shape
    planned = memory.state[1].copy()
    for i in range(states):
        total, ahead = 0.0, 0.0
        for j in range(states):
            total += law.deviation[i, j] * (now[j] - planned[j])
            ahead += law.A[i, j] * planned[j]
        total += ahead
        for j in range(inputs):
            total += law.B[i, j] * net[j]
            ahead += law.B[i, j] * wanted[j]
        memory.state[0, i] = total
        memory.state[1, i] = ahead
