"""Modes of an identified model, their shapes and contributions (2-26 .. 2-28), (3-1 .. 3-8).

An oscillating mode is the sum of a complex pair; its part in the outputs is the column of C in
modal coordinates (2-27), whose magnitudes are the amplitudes and whose angles are the phases.
Ewins, "Modal Testing", chapter 2 (2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from flexarm_core.labels import DEADBEAT, ENDLESS_SAMPLES, decay, with_deviation
from flexarm_core.showing.tables import html_table
from flexarm_ident.models.state_space import BlockSimulation

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control
    from numpy.typing import NDArray

    from flexarm_core.arrays import ComplexArray, FloatArray
    from flexarm_ident.records.iodata import IoData

# Its exponential is still a double.
_LARGEST_LOG = 700.0
_PERSISTENT = 1e-12
_DEFECTIVE_CONDITION = 1e8
_GRID_POINTS = 400
# The responses of this many samples fit into a core's own cache.
_CHUNK = 8192
_HEADER = ("states", "frequency, Hz", "damping", "MRM", "rank", "MSV", "rank", "kept")


@dataclass(frozen=True)
class Mode:
    """Complex pair, or one real eigenvalue.

    Attributes
    ----------
    eigenvalue : complex
        Discrete-time eigenvalue, of a pair the one with positive imaginary part.
    frequency_hz : float
        Natural frequency (2-28); 0 for a positive real eigenvalue, which does not oscillate.
    damping_ratio : float
        Damping ratio (2-28), negative for an unstable mode. A positive real eigenvalue has 1 when
        it decays, -1 when it grows, and 0 on the unit circle.
    states : tuple of int
        Numbers of its states in the modal form, from 0: two for a pair.
    msv, mrm : float
        Mode singular value (3-4) and modal response magnitude (3-8).
    msv_rank, mrm_rank : int
        Rank among all modes, 1 for the largest.
    kept : bool
        Whether the mode is part of the reduced model.
    """

    eigenvalue: complex
    frequency_hz: float
    damping_ratio: float
    states: tuple[int, ...]
    msv: float
    mrm: float
    msv_rank: int
    mrm_rank: int
    kept: bool = True

    @property
    def is_pair(self) -> bool:
        """Whether the mode is a complex pair."""
        return len(self.states) > 1

    @property
    def label(self) -> str:
        """Number of the mode as in Table 3-1a: ``3/4`` for a pair, ``17`` for a real one."""
        return "/".join(str(state + 1) for state in self.states)


class ModeUncertainty(NamedTuple):
    """Frequency and damping ratio of a mode with their standard deviations."""

    frequency_hz: float
    damping_ratio: float
    frequency_std_hz: float
    damping_std: float


@dataclass(frozen=True)
class ModalForm:
    """Model in modal coordinates (3-3), complex pairs grouped and first (2-27).

    Pairs are ordered by falling frequency and real eigenvalues by rising value, as in Table 3-1a.

    Attributes
    ----------
    eigenvalues : ndarray, (states,)
        Diagonal of the state matrix; a conjugate follows its partner.
    vectors : ndarray, (states, states)
        Eigenvectors, Psi of (3-1).
    B : ndarray, (states, inputs)
        Modal input matrix.
    C : ndarray, (outputs, states)
        Modal output matrix.
    dt_s : float
        Sampling period.
    """

    eigenvalues: ComplexArray
    vectors: ComplexArray
    B: ComplexArray
    C: ComplexArray
    dt_s: float

    @property
    def groups(self) -> list[tuple[int, ...]]:
        """States of each mode: two for a pair, one for a real eigenvalue."""
        upper = np.flatnonzero(self.eigenvalues.imag >= 0.0)
        return [
            (int(i), int(i) + 1) if self.eigenvalues[i].imag > 0.0 else (int(i),) for i in upper
        ]


def is_defective(vectors: ComplexArray | FloatArray) -> bool:
    """Return whether eigenvectors, (states, states), are too close to each other for a basis."""
    return bool(np.linalg.cond(vectors) > _DEFECTIVE_CONDITION)


def modal_form(model: control.StateSpace) -> ModalForm:
    """Return a discrete model in modal coordinates (2-26), (3-1 .. 3-3).

    Its A must have a full set of eigenvectors.
    """
    eigenvalues, vectors = np.linalg.eig(np.asarray(model.A, dtype=np.float64))
    eigenvalues, vectors = eigenvalues.astype(complex), vectors.astype(complex)
    upper = np.flatnonzero(eigenvalues.imag > 0.0)
    # Stable sorts, so that equal eigenvalues keep the order LAPACK gave them.
    frequency = np.abs(np.log(eigenvalues[upper]))
    pairs = upper[np.argsort(-frequency, kind="stable")]
    real = np.flatnonzero(eigenvalues.imag == 0.0)
    real = real[np.argsort(eigenvalues[real].real, kind="stable")]
    lam = np.concatenate(
        [np.ravel([(eigenvalues[i], eigenvalues[i].conj()) for i in pairs]), eigenvalues[real]]
    )
    columns = [v for i in pairs for v in (vectors[:, i], vectors[:, i].conj())]
    psi = np.stack([*columns, *(vectors[:, i] for i in real)], axis=1)
    B = np.linalg.solve(psi, model.B.astype(complex))
    # Rounding makes the halves of a pair differ slightly.
    for i in range(0, 2 * len(pairs), 2):
        B[i + 1] = B[i].conj()
    return ModalForm(lam, psi, B, model.C @ psi, float(model.dt))


def frequency_and_damping(eigenvalue: complex, dt_s: float) -> tuple[float, float]:
    """Return natural frequency in hertz and damping ratio of a discrete eigenvalue (2-28).

    A positive real eigenvalue has frequency 0 and damping ratio 1, or -1 outside the unit circle.
    One that is zero or an integrator but for rounding has damping ratio 1, whatever its side.
    """
    if abs(eigenvalue) <= DEADBEAT:
        return 0.0, 1.0
    rate = complex(np.log(complex(eigenvalue)))
    if rate.imag == 0.0:
        return 0.0, 1.0 if rate.real * ENDLESS_SAMPLES <= 1.0 else -1.0
    return abs(rate) / (2.0 * np.pi * dt_s), -rate.real / abs(rate)


def nearest(own: ComplexArray, others: ComplexArray) -> NDArray[np.intp]:
    """Return the place of the other eigenvalue next to each own one, each used once, (own,).

    There are as many others or more. The sum of the distances is the least.
    """
    distance = np.abs(np.subtract.outer(own, others))
    # A distance of zero would be no edge of the graph. scipy.optimize takes long to import.
    graph = scipy.sparse.csr_array(distance + distance.max() + 1.0)
    places = scipy.sparse.csgraph.min_weight_full_bipartite_matching(graph)[1]
    return np.asarray(places, dtype=np.intp)


def modal_response(form: ModalForm, group: tuple[int, ...], u: FloatArray) -> FloatArray:
    """Return the response of one mode to the input from rest, (samples, outputs) (3-6), (3-7).

    The mode is one of `ModalForm.groups`. The responses of all modes, with a single one for a pair,
    add up to that of the model (3-5).
    """
    return _simulation(form, [group]).advance(u) @ _shape(form, group).T


def modal_response_magnitudes(
    form: ModalForm, records: Sequence[IoData], output_scale: FloatArray
) -> FloatArray:
    """Return the MRM of each mode (3-8), (modes,), over all samples of all records.

    It is the mean magnitude of the modal response in the output where that is largest. The factors
    of the outputs, (outputs,), make them comparable.
    """
    samples = sum(len(record) for record in records)
    with np.errstate(over="ignore", invalid="ignore"):
        total = np.sum([_magnitudes(form, record.u) for record in records], axis=0)
        largest = np.max(total / samples * output_scale, axis=1)
    return np.where(np.isfinite(largest), largest, np.finfo(float).max)


def _magnitudes(form: ModalForm, u: FloatArray) -> FloatArray:
    """Return the sum of the magnitudes of each mode's response, (modes, outputs)."""
    groups = form.groups
    shapes = [_shape(form, group) for group in groups]
    ends = np.cumsum([len(group) for group in groups])
    simulation = _simulation(form, groups)
    total = np.zeros((len(groups), len(form.C)))
    for first in range(0, len(u), _CHUNK):
        parts = np.split(simulation.advance(u[first : first + _CHUNK]).T, ends[:-1])
        for mode, (shape, state) in enumerate(zip(shapes, parts, strict=True)):
            response = shape @ state
            total[mode] += np.abs(response, out=response).sum(axis=1)
    return total


def _shape(form: ModalForm, group: tuple[int, ...]) -> FloatArray:
    """Return the map from the state of one mode, in its parts, to the outputs."""
    column = form.C[:, group[0]]
    return len(group) * np.stack([column.real, -column.imag], axis=1)[:, : len(group)]


def _simulation(form: ModalForm, groups: Sequence[tuple[int, ...]]) -> BlockSimulation:
    """Return a simulation of the states of some modes: of a pair its real and imaginary part."""
    A, B = [], []
    for group in groups:
        size, value, drive = len(group), form.eigenvalues[group[0]], form.B[group[0]]
        turn = np.array([[value.real, -value.imag], [value.imag, value.real]])
        A.append(turn[:size, :size])
        B.append(np.stack([drive.real, drive.imag])[:size])
    drives = np.vstack(B)
    states, inputs = drives.shape
    still = np.zeros((states, inputs))
    return BlockSimulation(scipy.linalg.block_diag(*A), drives, np.eye(states), still)


def mode_singular_values(form: ModalForm, samples: int, output_scale: FloatArray) -> FloatArray:
    """Return the MSV of each mode (3-4), (modes,); of a pair, that of one of its eigenvalues.

    `samples` is the length K of the pulse response (3-4), and the outputs are multiplied by their
    factors, (outputs,). A value beyond the range of a double is given as about 1e304.
    """
    first = [group[0] for group in form.groups]
    gain = np.linalg.norm(form.C[:, first] * output_scale[:, np.newaxis], axis=0)
    gain = gain * np.linalg.norm(form.B[first], axis=1)
    sums = np.array([_log_geometric_sum(abs(form.eigenvalues[i]), samples - 1) for i in first])
    with np.errstate(divide="ignore"):
        return np.asarray(np.exp(np.minimum(0.5 * (np.log(gain) + sums), _LARGEST_LOG)))


def ranked_modes(
    model: control.StateSpace, records: Sequence[IoData], output_scale: FloatArray
) -> tuple[Mode, ...]:
    """Return the modes of a model with both indices and their ranks, as in Table 3-1a.

    They stand in the order of the modal form. Both indices compare numbers across channels and
    therefore refer to outputs scaled as in section 2.5, with which the thesis identified its
    models.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    records : sequence of IoData
        Records whose input drives the modes.
    output_scale : ndarray, (outputs,)
        Factors of the outputs, of `preprocess.output_scale`.
    """
    form = modal_form(model)
    msv = mode_singular_values(form, max(len(record) for record in records), output_scale)
    mrm = modal_response_magnitudes(form, records, output_scale)
    msv_rank, mrm_rank = _ranks(msv), _ranks(mrm)
    modes = []
    for i, group in enumerate(form.groups):
        eigenvalue = complex(form.eigenvalues[group[0]])
        frequency_hz, damping_ratio = frequency_and_damping(eigenvalue, form.dt_s)
        weights = float(msv[i]), float(mrm[i]), msv_rank[i], mrm_rank[i]
        modes.append(Mode(eigenvalue, frequency_hz, damping_ratio, group, *weights))
    return tuple(modes)


class RankTable(NamedTuple):
    """The same modes in two orders, the most significant one first.

    Attributes
    ----------
    by_msv : tuple of Mode
        By falling mode singular value (3-4).
    by_mrm : tuple of Mode
        By falling modal response magnitude (3-8).
    """

    by_msv: tuple[Mode, ...]
    by_mrm: tuple[Mode, ...]


def rank_table(modes: Sequence[Mode]) -> RankTable:
    """Return the modes of one model in the order of either index."""
    return RankTable(
        by_msv=tuple(sorted(modes, key=lambda mode: mode.msv_rank)),
        by_mrm=tuple(sorted(modes, key=lambda mode: mode.mrm_rank)),
    )


def _log_geometric_sum(radius: float, terms: int) -> float:
    """Return the logarithm of 1 + radius + ... + radius^(terms - 1)."""
    if abs(radius - 1.0) < _PERSISTENT:
        return float(np.log(max(terms, 1)))
    if radius == 0.0:
        return 0.0
    growth = terms * np.log(radius)
    if growth > _LARGEST_LOG:
        return float(growth - np.log(radius - 1.0))
    return float(np.log(np.expm1(growth) / (radius - 1.0)))


def _ranks(index: FloatArray) -> list[int]:
    """Return ranks from 1, for the largest; equal values rank in their order."""
    return [int(place) + 1 for place in np.argsort(np.argsort(-index, kind="stable"))]


def frequency_grid(model: control.StateSpace, lowest_hz: float) -> FloatArray:
    """Return a logarithmic grid of frequencies in Hz, refined around each mode by its own width.

    It goes from `lowest_hz` to the Nyquist frequency of the discrete model.
    """
    nyquist_hz = 0.5 / model.dt
    grid = [np.geomspace(min(lowest_hz, 0.1 * nyquist_hz), nyquist_hz, _GRID_POINTS)]
    for eigenvalue in np.linalg.eigvals(model.A):
        frequency_hz, damping_ratio = frequency_and_damping(complex(eigenvalue), model.dt)
        if eigenvalue.imag > 0.0:
            width = min(abs(damping_ratio), 0.1)
            grid.append(frequency_hz * (1.0 + width * np.linspace(-4.0, 4.0, 17)))
    merged = np.unique(np.concatenate(grid))
    return np.asarray(merged[(merged >= grid[0][0]) & (merged <= nyquist_hz)])


def mode_table(
    title: str, modes: Sequence[Mode], dt_s: float, deviations: Sequence[ModeUncertainty] = ()
) -> str:
    """Return modes by rising frequency in HTML, as Tables 3-1a to 3-3a.

    Real modes have their time constant in its place.

    Parameters
    ----------
    title : str
        Caption.
    modes : sequence of Mode
        Modes.
    dt_s : float
        Sampling period.
    deviations : sequence of ModeUncertainty
        Their standard deviations in the same order; none when they are not known.
    """
    known = sorted(zip_longest(modes, deviations), key=lambda each: each[0].frequency_hz)
    rows = [
        (
            mode.label,
            decay(mode.eigenvalue, dt_s)
            or with_deviation(mode.frequency_hz, spread and spread.frequency_std_hz),
            with_deviation(mode.damping_ratio, (spread and spread.damping_std) or None, decimals=4),
            f"{mode.mrm:.4g}",
            str(mode.mrm_rank),
            f"{mode.msv:.4g}",
            str(mode.msv_rank),
            "yes" if mode.kept else "no",
        )
        for mode, spread in known
    ]
    return html_table(title, _HEADER, rows)


@dataclass(frozen=True, eq=False)
class ModeShape:
    """Shape of an oscillating mode.

    Attributes
    ----------
    frequency_hz : float
        Natural frequency.
    damping_ratio : float
        Damping ratio.
    values : ndarray, (outputs,)
        Complex amplitudes of the scaled outputs; that of the output that moves most is 1.
    """

    frequency_hz: float
    damping_ratio: float
    values: ComplexArray

    @property
    def magnitude(self) -> FloatArray:
        """Amplitude of each output, (outputs,), from 0 to 1."""
        return np.asarray(np.abs(self.values))

    @property
    def phase_deg(self) -> FloatArray:
        """Phase of each output, (outputs,), before the one that moves most; -180 to 180."""
        return np.asarray(np.degrees(np.angle(self.values)))


def mode_shapes(model: control.StateSpace, output_scale: FloatArray) -> tuple[ModeShape, ...]:
    """Return the shapes of the oscillating modes that any output shows, by rising frequency.

    Parameters
    ----------
    model : control.StateSpace
        Discrete model.
    output_scale : ndarray, (outputs,)
        Factors that make the outputs comparable, such as one over their RMS.
    """
    form = modal_form(model)
    found = []
    for group in form.groups:
        seen = form.C[:, group[0]] * output_scale
        largest = seen[np.argmax(np.abs(seen))]
        if len(group) > 1 and largest != 0.0:
            figures = frequency_and_damping(complex(form.eigenvalues[group[0]]), form.dt_s)
            found.append(ModeShape(*figures, seen / largest))
    return tuple(sorted(found, key=lambda shape: shape.frequency_hz))
