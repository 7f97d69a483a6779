"""Normal equations of the output least squares in modal coordinates, without forming regressors.

In modal coordinates each of the thesis's regressors (2-14), (3-14) is one scalar filter times a
column of C. The normal matrix is therefore the elementwise product of the scalar signals' Gram and
the output matrix's products. The signals' Gram itself is lifted: inside a block of samples every
signal is a fixed linear function of its value at the block's start and of the block's inputs.

A pair of conjugate modes has one complex signal. Its real and imaginary part stand side by side, so
that all operations over the samples are real.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

if TYPE_CHECKING:
    from collections.abc import Iterator

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.records.source import Samples

_BLOCK = 32
# The lifted rows of this many samples fit into a core's own cache.
_CHUNK = 256 * _BLOCK
# Rounding of a sum over all samples, in units of the sum of its terms' magnitudes.
_ROUNDING = 1e-14
_WANTED = 1e-6


class Missed(NamedTuple):
    """Sum of each output's squared errors, (outputs,), and whether it is mostly rounding."""

    power: FloatArray
    is_rounding: bool


class Lift(NamedTuple):
    """Chunk of a record in blocks, complete ones and those with missing samples.

    `rows` holds for each block the signals at its start, of each input and of the initial state,
    and then its inputs, and `y` its outputs. `part_rows` and `part_y` are the same for the blocks
    with holes and the last one, whose inputs are padded with zeros; missing outputs are NaN.
    """

    rows: FloatArray
    y: FloatArray
    part_rows: FloatArray
    part_y: FloatArray


class ModalSignals:
    """Scalar signals of modes: the answer of each to the inputs and to an initial state.

    A and C do not enter, so models that have modes in common share these signals.

    Parameters
    ----------
    modes : ndarray, (modes,)
        Eigenvalues, of conjugates the upper one.
    inputs, outputs : int
        Numbers of channels.
    feedthrough : bool
        Whether each input itself is a signal.
    """

    def __init__(
        self, modes: ComplexArray, inputs: int, outputs: int, *, feedthrough: bool
    ) -> None:
        self.modes, self.inputs, self.outputs = modes, inputs, outputs
        self.direct = inputs if feedthrough else 0
        self.parts = 2 * len(modes)
        self._map, self._drive = self._lift_maps()

    def products(self, record: Samples) -> Products:
        """Return the products of one record's signals and outputs."""
        products = Products(self._map, self.outputs)
        for piece in self._lifted(record):
            products.add(piece)
        return products

    def residual_products(self, record: Samples, weights: FloatArray) -> Products:
        """Return the products of signals and what a combination of them misses in the outputs.

        `weights` are those of the signals by output, (outputs, signals).
        """
        products = Products(self._map, self.outputs)
        signals, _, width = self._map.shape
        response = weights @ self._map.reshape(signals, -1)
        by_row = response.reshape(self.outputs, _BLOCK, width).transpose(2, 1, 0)
        lifted = by_row.reshape(width, -1)
        for rows, y, part_rows, part_y in self._lifted(record):
            products.add(Lift(rows, y - rows @ lifted, part_rows, part_y - part_rows @ lifted))
        return products

    def _lifted(self, record: Samples) -> Iterator[Lift]:
        """Yield a record in blocks; its initial state is one more input, a pulse at the start."""
        r, modes, starts_end = self.inputs, len(self.modes), (self.inputs + 1) * self.parts
        step = self.modes**_BLOCK
        decay = np.cumprod(np.tile(step, (_CHUNK // _BLOCK, 1)), axis=0)
        start = np.zeros((r + 1, modes), dtype=complex)
        start[r] = 1.0
        for u, y in record.chunks(_CHUNK):
            blocks = len(u) // _BLOCK
            rows = np.zeros((blocks + 1, starts_end + _BLOCK * r))
            u_rows = rows[:, starts_end:]
            u_rows[:blocks] = u[: blocks * _BLOCK].reshape(blocks, _BLOCK * r)
            rest = u[blocks * _BLOCK :].ravel()
            u_rows[blocks, : len(rest)] = rest
            states = np.empty((blocks + 1, r + 1, modes), dtype=complex)
            states[0] = start
            states[1:, :r] = (u_rows[:blocks] @ self._drive).view(complex).reshape(blocks, r, modes)
            _accumulate(states[:, :r], step)
            states[1:, r] = decay[:blocks] * start[r]
            start = states[blocks]
            rows[:, :starts_end] = states.reshape(blocks + 1, -1).view(float)
            y_rows = np.full((blocks + 1, _BLOCK * self.outputs), np.nan)
            y_rows.reshape(-1, self.outputs)[: len(y)] = y
            if not np.isnan(y.min(initial=0.0)):
                last = slice(blocks, blocks + min(len(y) % _BLOCK, 1))
                yield Lift(rows[:blocks], y_rows[:blocks], rows[last], y_rows[last])
                continue
            known = ~np.isnan(y_rows)
            whole = known.all(axis=1)
            part = known.any(axis=1) & ~whole
            yield Lift(rows[whole], y_rows[whole], rows[part], y_rows[part])

    def _lift_maps(self) -> tuple[FloatArray, FloatArray]:
        """Return the maps from a lift's row to all signals in its block, and to the block's drive.

        The first is (signals, samples, row), the second (inputs of the row, signals of inputs).
        """
        r, parts, steps = self.inputs, self.parts, np.arange(_BLOCK + 1)
        inputs_at = (r + 1) * parts
        at_inputs = inputs_at + r * np.arange(_BLOCK)
        powers = self.modes ** steps[:, np.newaxis]
        rotations = np.zeros((len(self.modes), 2, _BLOCK + 1, len(self.modes), 2))
        for mode, power in enumerate(powers.T):
            rotations[mode, 0, :, mode] = np.stack([power.real, -power.imag], axis=1)
            rotations[mode, 1, :, mode] = np.stack([power.imag, power.real], axis=1)
        free = rotations.reshape(parts, _BLOCK + 1, parts)
        # An input acts from the next sample on.
        ago = steps[:, np.newaxis] - 1 - np.arange(_BLOCK)
        pulse = np.where(ago >= 0, powers.T[:, ago.clip(min=0)], 0.0)
        driven = np.stack([pulse.real, pulse.imag], axis=1).reshape(parts, _BLOCK + 1, _BLOCK)
        total = np.zeros((inputs_at + self.direct, _BLOCK + 1, inputs_at + r * _BLOCK))
        for source in range(r + 1):
            # The initial state follows D.
            first = source * parts + (self.direct if source == r else 0)
            total[first : first + parts, :, source * parts : (source + 1) * parts] = free
            if source < r:
                total[first : first + parts, :, at_inputs + source] = driven
        for j in range(self.direct):
            total[r * parts + j, np.arange(_BLOCK), at_inputs + j] = 1.0
        drive = total[: r * parts, _BLOCK, inputs_at:].T
        return np.ascontiguousarray(total[:, :_BLOCK]), np.ascontiguousarray(drive)


class ModalRegression:
    """Linear regression of the outputs on B, D and the initial state, for one A and C.

    The parameters of one record stand in the order B by input, D by output and input (if there is
    feedthrough), initial state. The thesis puts D first (2-16), and has B alone in (3-16).

    Parameters
    ----------
    signals : ModalSignals
        Signals of the modes of A, and perhaps of others.
    eigenvalues : ndarray, (states,)
        Eigenvalues of A, conjugates side by side, the upper one first.
    C : ndarray, (outputs, states)
        Modal output matrix (3-3).
    """

    def __init__(self, signals: ModalSignals, eigenvalues: ComplexArray, C: ComplexArray) -> None:
        self.inputs = signals.inputs
        self.outputs, states = C.shape
        direct = np.repeat(np.eye(self.outputs), signals.direct, axis=1)
        self._columns = np.hstack([np.tile(C, self.inputs), direct, C])
        self.shared = self._columns.shape[1] - states
        self._expand = _expansion(signals, eigenvalues)

    def signal_weights(self, parameters: ComplexArray) -> FloatArray:
        """Return the outputs as combinations of the signals, (outputs, signals)."""
        # The sum over pairs of conjugate modes is real.
        return np.asarray(((self._columns * parameters) @ self._expand).real)

    def normal(self, products: Products, weight: FloatArray) -> ComplexArray:
        """Return one record's normal matrix (2-17), for a weight of each output's squared error."""
        outputs = (self._columns.conj().T * weight) @ self._columns
        return np.asarray(outputs * (self._expand.conj() @ products.signals @ self._expand.T))

    def right(self, products: Products, weight: FloatArray) -> ComplexArray:
        """Return one record's right side (2-17), for a weight of each output's squared error."""
        return np.asarray(np.conj(self._columns.T * (self._expand @ products.cross)) @ weight)


def _expansion(signals: ModalSignals, eigenvalues: ComplexArray) -> ComplexArray:
    """Return the map from the signals to those of the parameters' columns."""
    states, r, m = len(eigenvalues), signals.inputs, signals.outputs
    modes = np.zeros((states, signals.parts), dtype=complex)
    for state in np.flatnonzero(eigenvalues.imag >= 0.0):
        first = 2 * int(np.flatnonzero(signals.modes == eigenvalues[state])[0])
        modes[state, first : first + 2] = 1.0, 1.0j
        if eigenvalues[state].imag > 0.0:
            modes[state + 1, first : first + 2] = 1.0, -1.0j
    direct = np.tile(np.eye(signals.direct), (m, 1))
    return np.asarray(scipy.linalg.block_diag(*[modes] * r, direct, modes))


class Products:
    """Products of the signals with themselves and with the outputs, summed over a record.

    Parameters
    ----------
    signal_map : ndarray, (signals, samples, row)
        Map from a lift's row to all signals in its block.
    outputs : int
        Number of outputs.
    """

    def __init__(self, signal_map: FloatArray, outputs: int) -> None:
        signals, length, width = signal_map.shape
        self._map = signal_map
        self._gram = np.zeros((width, width))
        self._cross = np.zeros((width, length * outputs))
        self._part = np.zeros((signals, signals))
        self._power = np.zeros(length * outputs)
        self._outputs = outputs

    def add(self, lift: Lift) -> None:
        """Add the next samples."""
        self._gram += lift.rows.T @ lift.rows
        self._cross += lift.rows.T @ lift.y
        self._power += np.einsum("bi,bi->i", lift.y, lift.y)
        known = ~np.isnan(lift.part_y)
        for row, samples in zip(lift.part_rows, known[:, :: self._outputs], strict=True):
            signals = (self._map @ row)[:, samples]
            self._part += signals @ signals.T
        y = np.where(known, lift.part_y, 0.0)
        self._cross += lift.part_rows.T @ y
        self._power += np.einsum("bi,bi->i", y, y)

    @cached_property
    def signals(self) -> FloatArray:
        """Gram matrix of the signals."""
        signals, _, width = self._map.shape
        lifted = self._map.reshape(-1, width) @ self._gram
        return np.asarray(
            lifted.reshape(signals, -1) @ self._map.reshape(signals, -1).T + self._part
        )

    @cached_property
    def cross(self) -> FloatArray:
        """Products of signals and outputs, (signals, outputs)."""
        signals, length, width = self._map.shape
        by_sample = self._cross.reshape(width, length, self._outputs).transpose(1, 0, 2)
        return np.asarray(self._map.reshape(signals, -1) @ by_sample.reshape(length * width, -1))

    @property
    def power(self) -> FloatArray:
        """Sum of each output's squares, (outputs,)."""
        return np.asarray(self._power.reshape(-1, self._outputs).sum(axis=0))

    def missed(self, weights: FloatArray) -> Missed:
        """Return the squared error of each output, for weights of the signals by output."""
        explained = np.sum(weights @ self.signals * weights, axis=1)
        left = self.power - 2.0 * np.sum(weights.T * self.cross, axis=0) + explained
        terms = np.abs(weights) @ np.sqrt(np.diag(self.signals).clip(min=0.0))
        rounding = _ROUNDING * (self.power + terms**2)
        return Missed(left.clip(min=0.0), bool(np.any(left < rounding / _WANTED)))


def _accumulate(states: ComplexArray, step: ComplexArray) -> None:
    """Turn drives into states, ``x_{b+1} = step x_b + drive_b``, in place: (blocks, inputs, modes).

    Every turn doubles the number of past blocks in the sum.
    """
    distance = 1
    while distance < len(states):
        states[distance:] += step * states[:-distance]
        step, distance = step * step, 2 * distance
