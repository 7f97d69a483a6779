"""Distance of the estimators from the Cramer-Rao bound, for coloured noise.

The synthetic arm is identified from outputs with AR(1) noise. The reference is the output error
model in modal form, of the true order, fitted by Gauss-Newton to data whitened by the true filter
of the noise, with each output weighted by its true noise, and started at the truth: the maximum
likelihood estimate, which attains the Cramer-Rao bound. It knows what no estimator can know.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import click
import numpy as np
from scipy import signal

from bench.ident.plant import AR1_POLE, DT_S, error, plant, trial
from bench.tools import (
    count_option,
    first_seed_option,
    json_option,
    make_table,
    run_trials,
    write_json,
)
from flexarm_bringup.console import terminal
from flexarm_ident import IoData, identify
from flexarm_ident.models.modes import modal_form
from flexarm_ident.models.state_space import simulate
from flexarm_ident.subspace.methods import AUTO, METHODS

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray
    from rich.table import Table

    from bench.ident.plant import Trial

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

ORDER, LENGTHS = 18, (6_000, 60_000)
_STEPS, _HALVINGS = 8, 8
_COLUMNS = (*METHODS, "auto", "refined")


@dataclass(frozen=True, eq=False)
class ModalModel:
    """Poles with positive imaginary part or real, and their residues: y = sum of residue x state.

    Attributes
    ----------
    poles : ndarray, (modes,)
        Poles.
    residues : ndarray, (outputs, modes)
        Residues, real for a real pole.
    """

    poles: Complex
    residues: Complex

    @property
    def paired(self) -> NDArray[np.bool_]:
        """Which poles stand for a pair."""
        return np.asarray(self.poles.imag > 0.0)

    def states(self, u: Array, power: int = 1) -> Complex:
        """Return the modal states, (samples, modes); of power 2 their derivatives by the poles."""
        columns = []
        for pole in self.poles:
            x = u.astype(complex)
            for _ in range(power):
                x = signal.lfilter([0.0, 1.0], [1.0, -pole], x)
            columns.append(x)
        return np.stack(columns, axis=1)

    def response(self, u: Array) -> Array:
        """Return the outputs from rest."""
        weight = np.where(self.paired, 2.0, 1.0)
        return np.real(self.states(u) * weight @ self.residues.T)


def maximum_likelihood(start: ModalModel, u: Array, y: Array, deviation: Array) -> ModalModel:
    """Fit poles and residues to outputs with white noise of known deviation, by Gauss-Newton."""
    model = start
    for _ in range(_STEPS):
        missed = (y - model.response(u)) / deviation
        step = _step(model, u, missed, deviation)
        for halving in range(_HALVINGS):
            new = _moved(model, 0.5**halving * step)
            if np.abs(new.poles).max() < 1.0:
                left = (y - new.response(u)) / deviation
                if np.sum(left**2) <= np.sum(missed**2):
                    model = new
                    break
    return model


def _parts(model: ModalModel, values: Complex) -> Array:
    """Return the real directions of complex columns: both of a pair, one of a real pole."""
    pair = model.paired
    return np.hstack(
        [2.0 * values[:, pair].real, -2.0 * values[:, pair].imag, values[:, ~pair].real]
    )


def _step(model: ModalModel, u: Array, missed: Array, deviation: Array) -> Array:
    states, slopes = model.states(u), model.states(u, 2)
    outputs, size = len(deviation), model.poles.size + int(model.paired.sum())
    normal = np.zeros((size * (1 + outputs),) * 2)
    right = np.zeros(len(normal))
    for i in range(outputs):
        poles = _parts(model, slopes * model.residues[i])
        columns = np.hstack([poles, _parts(model, states)]) / deviation[i]
        rows = [*range(size), *range(size * (1 + i), size * (2 + i))]
        normal[np.ix_(rows, rows)] += columns.T @ columns
        right[rows] += columns.T @ missed[:, i]
    scale = np.sqrt(np.diag(normal))
    return np.asarray(
        np.linalg.lstsq(normal / np.outer(scale, scale), right / scale, rcond=None)[0] / scale
    )


def _moved(model: ModalModel, step: Array) -> ModalModel:
    pair, count = model.paired, int(model.paired.sum())
    moves = np.zeros((1 + len(model.residues), len(pair)), dtype=complex)
    real, imaginary, alone = np.split(step.reshape(len(moves), -1), [count, 2 * count], axis=1)
    moves[:, pair], moves[:, ~pair] = real + 1j * imaginary, alone
    return ModalModel(model.poles + moves[0], model.residues + moves[1:])


def errors(case: tuple[int, int]) -> list[float]:
    """Return the error of the reference and of each method for one record."""
    samples, seed = case
    given = trial(samples, "ar1", seed)
    model = plant(np.random.default_rng(seed))
    form = modal_form(model)
    first = [group[0] for group in form.groups]
    start = ModalModel(form.eigenvalues[first], form.C[:, first] * form.B[first, 0])
    noise = _whitened(given.y - simulate(model, given.u))
    best = maximum_likelihood(
        start, _whitened(given.u)[:, 0], _whitened(given.y), noise.std(axis=0)
    )
    outputs = tuple(f"y{channel}" for channel in range(given.y.shape[1]))
    data = IoData(given.u, given.y, dt_s=DT_S, inputs=("u",), outputs=outputs)
    found = [identify(data, order=ORDER, method=method).model for method in METHODS]
    found += [identify(data, method=AUTO, refine=refine).model for refine in (False, True)]
    return [
        _relative(best.response(given.fresh_u[:, 0]), given),
        *(error((each.A, each.B, each.C, each.D), given) for each in found),
    ]


def _whitened(x: Array) -> Array:
    return np.asarray(signal.lfilter([1.0, -AR1_POLE], [1.0], x, axis=0))


def _relative(y: Array, given: Trial) -> float:
    relative = np.linalg.norm(y - given.truth, axis=0) / np.linalg.norm(given.truth, axis=0)
    return float(np.exp(np.mean(np.log(relative))))


@click.command()
@count_option("--seeds", 12)
@first_seed_option
@json_option
def main(*, seeds: int, first_seed: int, json_file: Path | None) -> None:
    """Print geometric means over the seeds, and write them to a file on request."""
    cases = list(product(LENGTHS, range(first_seed, first_seed + seeds)))
    found = np.log(run_trials(errors, cases)).reshape(len(LENGTHS), seeds, -1)
    means = np.exp(found.mean(axis=1))
    terminal.show_table(table(means, seeds))
    names = ("best", *_COLUMNS)
    rows = [
        {"k": k, "seeds": seeds} | dict(zip(names, row, strict=True))
        for k, row in zip(LENGTHS, means.tolist(), strict=True)
    ]
    write_json(json_file, rows)


def table(means: Array, seeds: int) -> Table:
    """Return the errors; in brackets as multiples of the reference."""
    title = (
        f"1000 x error, AR(1) noise, order {ORDER} but for auto, {seeds} seeds; (times the best)"
    )
    shown = make_table("K", "the best", *_COLUMNS, title=title, words=0)
    for samples, (best, *others) in zip(LENGTHS, means, strict=True):
        cells = (f"{1e3 * each:.2f} ({each / best:.2f})" for each in others)
        shown.add_row(str(samples), f"{1e3 * best:.2f}", *cells)
    return shown


if __name__ == "__main__":
    main()
