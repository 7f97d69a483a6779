"""Output least squares in modal or Schur coordinates, without forming all regressors.

In modal coordinates each of the thesis's regressors (2-14), (3-14) is one scalar filter times a
column of C. The normal matrix is therefore the elementwise product of the scalar signals' Gram and
the output matrix's products. The signals' Gram itself is lifted: inside a block of samples every
signal is a fixed linear function of its value at the block's start and of the block's inputs. Of
the record only the products of these are summed; each mode's powers make the signals' of them.

A pair of conjugate modes has one complex signal. Its real and imaginary part stand side by side, so
that all operations over the samples are real.

An A without a full set of eigenvectors has its real Schur form: with ``A = Z T Z'`` the coordinates
are orthonormal, so the transformation loses nothing, however close to each other the eigenvalues
are. T is not diagonal, so each input drives a matrix of responses, ``R' = T R + u I``, and the
regressors (2-14) are ``C Z R``. R is stepped over blocks of samples. Inside a block the regressors
follow by products of matrices. Householder reflections reduce them to one triangle per output, and
nothing else is kept.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flexarm_core.arrays import BoolArray, ComplexArray, FloatArray
    from flexarm_ident.records.source import Samples

_BLOCK = 32
# The lifted rows of this many samples fit into a core's own cache.
_CHUNK = 256 * _BLOCK
# Rounding of a sum over all samples, in units of the sum of its terms' magnitudes.
_ROUNDING = 1e-14
_WANTED = 1e-6
_SCHUR_CHUNK = 32 * _BLOCK


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

    A and C do not enter, so models that have modes in common share these signals. They stand by
    their source, each input and last the initial state; the signals of a source are those of the
    modes, then the conjugates of the complex ones, and with feedthrough the input itself, which is
    zero for the initial state.

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
        self.direct = int(feedthrough)
        pairs = np.flatnonzero(modes.imag > 0.0)
        self._eigenvalues = np.concatenate([modes, modes[pairs].conj()])
        self.count = len(self._eigenvalues) + self.direct
        """Signals of one source."""
        # From the real and imaginary parts of the modes, and the input itself, to the signals.
        self._parts = 2 * len(modes)
        self._pair = np.zeros((self.count, self._parts + self.direct), dtype=complex)
        for signal, mode in enumerate([*range(len(modes)), *pairs]):
            sign = 1.0 if signal < len(modes) else -1.0
            self._pair[signal, 2 * mode : 2 * mode + 2] = 1.0, 1.0j * sign
        self._pair[len(self._eigenvalues) :, self._parts :] = np.eye(self.direct)
        # Of each signal at the samples of a block: the part of its start, and of the inputs.
        steps = np.arange(_BLOCK)
        powers = modes ** steps[:, np.newaxis]
        self._drive = np.ascontiguousarray(powers[::-1]).view(float)
        self._free = np.zeros((_BLOCK, self.count), dtype=complex)
        self._free[:, : len(self._eigenvalues)] = np.hstack([powers, powers[:, pairs].conj()])
        # An input acts from the next sample on.
        ago = steps[:, np.newaxis] - 1 - steps
        by_part = powers.T.copy().view(float).reshape(len(modes), _BLOCK, 2).transpose(0, 2, 1)
        self._driven = np.zeros((self._parts + self.direct, _BLOCK, _BLOCK))
        self._driven[: self._parts] = by_part.reshape(-1, _BLOCK)[:, ago] * (ago >= 0)
        self._driven[self._parts :] = np.eye(_BLOCK)

    @property
    def _starts(self) -> int:
        """Columns of a lift's row that hold signals at the start."""
        return self._parts * (self.inputs + 1)

    def places(self, eigenvalues: ComplexArray) -> NDArray[np.intp]:
        """Return the places of eigenvalues among the signals of a source, (states,)."""
        distance = np.abs(self._eigenvalues - eigenvalues[:, np.newaxis])
        return np.asarray(distance.argmin(axis=1))

    def products(self, record: Samples) -> Products:
        """Return the products of one record's signals and outputs."""
        return self._summed(self._lifted(record))

    def residual_products(self, record: Samples, weights: ComplexArray) -> Products:
        """Return the products of signals and what a combination of them misses in the outputs.

        `weights` are those of the signals by output, (outputs, sources * signals).
        """
        response = self._response(weights)
        return self._summed(
            Lift(rows, y - rows @ response, part_rows, part_y - part_rows @ response)
            for rows, y, part_rows, part_y in self._lifted(record)
        )

    def _summed(self, lifts: Iterator[Lift]) -> Products:
        """Return the products of signals and outputs over the chunks of a record."""
        width = self._starts + _BLOCK * self.inputs
        gram, cross = np.zeros((width, width)), np.zeros((width, _BLOCK * self.outputs))
        power = np.zeros(_BLOCK * self.outputs)
        size = (self.inputs + 1) * self.count
        part = np.zeros((size, size), dtype=complex)
        for lift in lifts:
            gram += lift.rows.T @ lift.rows
            cross += lift.rows.T @ lift.y
            power += np.einsum("bi,bi->i", lift.y, lift.y)
            known = ~np.isnan(lift.part_y)
            for row, samples in zip(lift.part_rows, known[:, :: self.outputs], strict=True):
                signals = self._in_block(row, samples)
                part += signals.conj() @ signals.T
            y = np.where(known, lift.part_y, 0.0)
            cross += lift.part_rows.T @ y
            power += np.einsum("bi,bi->i", y, y)
        return Products(
            self._signal_gram(gram) + part,
            self._signal_cross(cross),
            power.reshape(-1, self.outputs).sum(axis=0),
        )

    def _lifted(self, record: Samples) -> Iterator[Lift]:
        """Yield a record in blocks; its initial state is one more input, a pulse at the start."""
        r, modes, starts_end = self.inputs, len(self.modes), self._starts
        step = self.modes**_BLOCK
        # No longer than the record: what grows would overflow after its end.
        decay = np.cumprod(np.tile(step, (min(_CHUNK, len(record)) // _BLOCK, 1)), axis=0)
        # Of the inputs, and of the initial state.
        start = np.zeros((r, modes), dtype=complex)
        dying = np.ones(modes, dtype=complex)
        for u, y in record.chunks(_CHUNK):
            blocks, samples = len(u) // _BLOCK, len(u) // _BLOCK * _BLOCK
            rows = np.zeros((blocks + 1, starts_end + _BLOCK * r))
            u_rows = rows[:, starts_end:]
            u_rows[:blocks] = u[:samples].reshape(blocks, _BLOCK * r)
            u_rows[blocks, : (len(u) - samples) * r] = u[samples:].ravel()
            states = np.empty((blocks + 1, r, modes), dtype=complex)
            states[0] = start
            for source in range(r):
                states[1:, source] = (u_rows[:blocks, source::r] @ self._drive).view(complex)
            _accumulate(states, step)
            free = np.vstack([dying, decay[:blocks] * dying])
            start, dying = states[blocks], free[blocks]
            rows[:, : r * self._parts] = states.reshape(blocks + 1, r * modes).view(float)
            rows[:, r * self._parts : starts_end] = free.view(float)
            last = slice(blocks, blocks + min(len(u) - samples, 1))
            y_rows = y[:samples].reshape(blocks, _BLOCK * self.outputs)
            y_last = np.full((last.stop - last.start, _BLOCK * self.outputs), np.nan)
            y_last[:, : (len(u) - samples) * self.outputs] = y[samples:].ravel()
            if not np.isnan(y.min(initial=0.0)):
                yield Lift(rows[:blocks], y_rows, rows[last], y_last)
                continue
            y_rows = np.concatenate([y_rows, y_last])
            known = ~np.isnan(y_rows)
            whole = known.all(axis=1)
            part = known.any(axis=1) & ~whole
            rows = rows[: len(y_rows)]
            yield Lift(rows[whole], y_rows[whole], rows[part], y_rows[part])

    def _at_start(self, parts: FloatArray | ComplexArray) -> ComplexArray:
        """Return the signals at a block's start from their parts, (sources, signals, ...)."""
        rows = parts[: self._starts].reshape(self.inputs + 1, self._parts, -1)
        return np.asarray(self._pair[:, : self._parts] @ rows)

    def _in_block(self, row: FloatArray, samples: BoolArray) -> ComplexArray:
        """Return the signals at some samples of the block of a row, (signals of all, samples)."""
        signals = self._at_start(row) * self._free.T
        inputs = row[self._starts :].reshape(_BLOCK, self.inputs)
        signals[: self.inputs] += self._pair @ (self._driven @ inputs).transpose(2, 0, 1)
        return signals.reshape(-1, _BLOCK)[:, samples]

    def _response(self, weights: ComplexArray) -> FloatArray:
        """Return the map from a lift's row to the outputs of its block, (row, samples * outputs).

        The outputs are combinations of the signals with `weights`, (outputs, sources * signals).
        """
        r, m, count = self.inputs, self.outputs, self.count
        by_source = weights.reshape(m, r + 1, 1, count)
        free = (by_source * self._free) @ self._pair[:, : self._parts]
        starts = free.real.transpose(1, 3, 2, 0).reshape(self._starts, -1)
        of_parts = (by_source[:, :r, 0] @ self._pair).real
        driven = of_parts @ self._driven.reshape(len(self._driven), -1)
        inputs = driven.reshape(m, r, _BLOCK, _BLOCK).transpose(3, 1, 2, 0)
        return np.vstack([starts, inputs.reshape(_BLOCK * r, _BLOCK * m)])

    def _signal_gram(self, gram: FloatArray) -> ComplexArray:
        """Return the signals' products, conjugate by plain, from those of the lift's rows."""
        r, count, free = self.inputs, self.count, self._free
        starts = self._at_start(gram).reshape(-1, len(gram)).conj()
        both = self._at_start(starts.T).reshape(r + 1, count, r + 1, count)
        # Starts with starts, starts with inputs, and inputs with inputs.
        total = both.transpose(2, 3, 0, 1) * (free.conj().T @ free)[:, np.newaxis]
        by_sample = self._driven.transpose(1, 0, 2).reshape(_BLOCK, -1)
        answer = (free.conj().T @ by_sample).reshape(count, -1, _BLOCK)
        by_inputs = starts[:, self._starts :].reshape(r + 1, count, _BLOCK, r)
        mixed = (self._pair @ (answer @ by_inputs)).transpose(0, 1, 3, 2)
        total[:, :, :r] += mixed
        total[:r] += mixed.conj().transpose(2, 3, 0, 1)
        inputs = gram[self._starts :, self._starts :].reshape(_BLOCK, r, _BLOCK, r)
        driven = self._driven.reshape(len(self._driven), -1)
        for i in range(r):
            for j in range(r):
                passed = (self._driven @ inputs[:, i, :, j]).reshape(driven.shape)
                total[i, :, j] += self._pair.conj() @ (passed @ driven.T) @ self._pair.T
        return np.asarray(total.reshape((r + 1) * count, -1))

    def _signal_cross(self, cross: FloatArray) -> ComplexArray:
        """Return the products of signals and outputs from those of the lift's rows."""
        r, count = self.inputs, self.count
        starts = self._at_start(cross).reshape(r + 1, count, _BLOCK, self.outputs)
        total = np.einsum("te,seto->seo", self._free, starts)
        inputs = cross[self._starts :].reshape(_BLOCK, r, _BLOCK, self.outputs)
        ordered = inputs.transpose(1, 2, 0, 3).reshape(r, _BLOCK * _BLOCK, self.outputs)
        total[:r] += self._pair @ (self._driven.reshape(len(self._driven), -1) @ ordered)
        return np.asarray(total.reshape((r + 1) * count, -1))


class Products(NamedTuple):
    """Products of the signals with themselves and with the outputs, summed over a record.

    Attributes
    ----------
    signals : ndarray, (signals, signals)
        Products of the conjugate signals with the signals.
    cross : ndarray, (signals, outputs)
        Products of signals and outputs.
    power : ndarray, (outputs,)
        Sum of each output's squares.
    """

    signals: ComplexArray
    cross: ComplexArray
    power: FloatArray


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
        r = self.inputs = signals.inputs
        self.outputs, states = C.shape
        direct = np.repeat(np.eye(self.outputs), r * signals.direct, axis=1)
        self._columns = np.hstack([np.tile(C, r), direct, C])
        self.shared = self._columns.shape[1] - states
        self._signals = (r + 1) * signals.count
        sources = signals.count * np.arange(r + 1)[:, np.newaxis]
        modes = sources + signals.places(eigenvalues)
        inputs = np.tile(sources[:r, 0] + signals.count - 1, self.outputs * signals.direct)
        self._places = np.concatenate([modes[:r].ravel(), inputs, modes[r]])

    def of_parameters(self, products: Products) -> Products:
        """Return the products of the signals that belong to the parameters."""
        places = self._places
        signals = products.signals[np.ix_(places, places)]
        return Products(signals, products.cross[places], products.power)

    def signal_weights(self, parameters: ComplexArray) -> ComplexArray:
        """Return the outputs as combinations of the signals, (outputs, signals)."""
        weights = np.zeros((self._signals, self.outputs), dtype=complex)
        np.add.at(weights, self._places, (self._columns * parameters).T)
        return weights.T

    def normal(self, products: Products, weight: FloatArray) -> ComplexArray:
        """Return one record's normal matrix (2-17), for a weight of each output's squared error."""
        outputs = (self._columns.conj().T * weight) @ self._columns
        return np.asarray(outputs * products.signals)

    def right(self, products: Products, weight: FloatArray) -> ComplexArray:
        """Return one record's right side (2-17), for a weight of each output's squared error."""
        return np.asarray(np.conj(self._columns.T * products.cross) @ weight)

    def missed(self, products: Products, parameters: ComplexArray) -> Missed:
        """Return the squared error of each output of one record."""
        weights = self._columns * parameters
        # The sum over pairs of conjugate modes is real.
        explained = np.sum((weights.conj() @ products.signals) * weights, axis=1).real
        answered = np.sum(weights.T * products.cross, axis=0).real
        left = products.power - 2.0 * answered + explained
        terms = np.abs(weights) @ np.sqrt(np.diag(products.signals).real.clip(min=0.0))
        rounding = _ROUNDING * (products.power + terms**2)
        return Missed(left.clip(min=0.0), bool(np.any(left < rounding / _WANTED)))


def _accumulate(states: ComplexArray, step: ComplexArray) -> None:
    """Turn drives into states, ``x_{b+1} = step x_b + drive_b``, in place: (blocks, inputs, modes).

    Every turn doubles the number of past blocks in the sum.
    """
    distance = 1
    while distance < len(states):
        states[distance:] += step * states[:-distance]
        step, distance = step * step, 2 * distance


class SchurRegression:
    """Linear regression of the outputs on B, the initial state and D, for one A and C.

    The parameters of one output of one record stand in the order B by input, initial state, the
    output's row of D (if `feedthrough`).

    Parameters
    ----------
    A : ndarray, (states, states)
        State matrix.
    C : ndarray, (outputs, states)
        Output matrix.
    inputs : int
        Number of inputs.
    feedthrough : bool
        Whether D is a parameter.
    """

    def __init__(self, A: FloatArray, C: FloatArray, inputs: int, *, feedthrough: bool) -> None:
        T, self.basis = scipy.linalg.schur(A, output="real")
        self.states, self.inputs, self.outputs = len(A), inputs, len(C)
        self.direct = inputs if feedthrough else 0
        powers = [np.eye(self.states)]
        for _ in range(_BLOCK):
            powers.append(T @ powers[-1])
        self._powers = np.array(powers)
        # Outputs of each state over a block: samples, outputs, states.
        self._observe = C @ self.basis @ self._powers[:_BLOCK]

    def triangles(self, record: Samples) -> FloatArray:
        """Return one record's triangles, (outputs, columns + 1, columns + 1), by QR per output.

        The last column belongs to the output itself.
        """
        n, r, m = self.states, self.inputs, self.outputs
        columns = n * (r + 1) + self.direct + 1
        triangles = np.zeros((m, columns, columns))
        start = np.zeros((n, r + 1, n))
        start[:, r] = np.eye(n)
        for u, y in record.chunks(_SCHUR_CHUNK):
            rows = np.empty((m, len(u), columns))
            free, start = self._responses(u, start)
            rows[:, :, : n * (r + 1)] = free
            rows[:, :, n * (r + 1) : -1] = u[:, : self.direct]
            rows[:, :, -1] = y.T
            usable = ~np.isnan(y).any(axis=1)
            for output in range(m):
                stacked = np.vstack([triangles[output], rows[output, usable]])
                triangles[output] = scipy.linalg.qr(stacked, mode="r")[0][:columns]
        return triangles

    def _responses(self, u: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (outputs, samples, states of all inputs and of the start), and the next start."""
        n, r, m = self.states, self.inputs, self.outputs
        blocks = -(-len(u) // _BLOCK)
        padded = np.zeros((blocks * _BLOCK, r))
        padded[: len(u)] = u
        inputs = padded.reshape(blocks, _BLOCK, r).transpose(0, 2, 1)
        # Effect of a block's inputs on the state at its end, (blocks, states, inputs, states).
        drive = np.tensordot(inputs, self._powers[_BLOCK - 1 :: -1], axes=1).transpose(0, 2, 1, 3)
        states = np.empty((blocks, n, r + 1, n))
        for block in range(blocks):
            states[block] = start
            start = np.tensordot(self._powers[_BLOCK], start, axes=1)
            start[:, :r] += drive[block]
        responses = np.tensordot(states, self._observe, axes=([1], [2]))
        # Now (blocks, inputs and start, states, samples, outputs).
        responses[:, :r] += self._driven(inputs)
        ordered = responses.transpose(4, 0, 3, 1, 2).reshape(m, blocks * _BLOCK, (r + 1) * n)
        return ordered[:, : len(u)], start

    def _driven(self, inputs: FloatArray) -> FloatArray:
        """Return a block's response to its own inputs, (blocks, inputs, states, samples, m)."""
        n, m = self.states, self.outputs
        pulses = np.zeros((_BLOCK, n, _BLOCK, m))
        for sample in range(_BLOCK - 1):
            # An input acts from the next sample on.
            later = self._observe[: _BLOCK - 1 - sample].transpose(2, 0, 1)
            pulses[sample, :, sample + 1 :] = later
        return np.asarray(np.tensordot(inputs, pulses, axes=1))
