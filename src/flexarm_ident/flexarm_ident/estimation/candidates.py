"""Models of one estimator and order, fitted to records and judged by free simulation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm_ident.fitting.stable_fit import fit_stable
from flexarm_ident.fitting.validation import mean_error
from flexarm_ident.models.free_run import simulate
from flexarm_ident.models.state_space import state_space
from flexarm_ident.subspace.methods import METHODS

if TYPE_CHECKING:
    from collections.abc import Sequence

    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.fitting.output_fit import OutputFit
    from flexarm_ident.models.state_space import Way
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.records.source import Source
    from flexarm_ident.subspace.choice import Selection

_PARTS = 8


class Fitted(NamedTuple):
    """Model of one order with its fit, and how many eigenvalues were moved in which way."""

    model: control.StateSpace
    fit: OutputFit
    moved: int
    way: Way | None


@dataclass(frozen=True, eq=False)
class Candidate:
    """Model of one estimator and order, fitted to some records.

    Attributes
    ----------
    selection : Selection
        Estimator and its result.
    fitted : Fitted
        Model and fit.
    records : sequence of IoData
        The records.
    """

    selection: Selection
    fitted: Fitted
    records: Sequence[IoData]

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.fitted.model.nstates)

    @property
    def name(self) -> str:
        """Estimator and order in messages."""
        return f"{self.selection.method} of order {self.order}"

    @property
    def error(self) -> float:
        """Mean of the outputs' relative errors (2-25)."""
        return mean_error(self.fitted.fit.error)

    @cached_property
    def inflation(self) -> float:
        """Factor from the error to that expected of other data, infinite for too few of them.

        Akaike, "Fitting autoregressive models for prediction", Annals of the Institute of
        Statistical Mathematics 21 (1969): the final prediction error.
        """
        states, model = self.order, self.fitted.model
        parameters = states * (model.ninputs + model.noutputs + len(self.records))
        values = model.noutputs * sum(int(record.usable.sum()) for record in self.records)
        part = parameters / values
        return float(np.sqrt((1.0 + part) / (1.0 - part))) if part < 1.0 else np.inf

    @property
    def expected_error(self) -> float:
        """Mean relative error that is expected of other data."""
        return self.inflation * self.error

    @cached_property
    def parts(self) -> FloatArray:
        """Squared relative errors over parts of the records, (parts, outputs)."""
        model, starts = self.fitted.model, self.fitted.fit.x0
        missed = [
            (record.y - simulate(model, record.u, start))[record.usable]
            for record, start in zip(self.records, starts, strict=True)
        ]
        power = np.sum([np.sum(record.y[record.usable] ** 2, axis=0) for record in self.records], 0)
        parts = [np.sum(part**2, axis=0) for part in np.array_split(np.vstack(missed), _PARTS)]
        return np.asarray(parts / np.where(power > 0.0, power, 1.0))


def candidate(
    selection: Selection, order: int, records: Sequence[IoData], *, stable: bool, feedthrough: bool
) -> Candidate:
    """Return the model of one estimator and order, fitted by the errors that it is weighed by.

    Raises
    ------
    IdentificationError
        If the model is so unstable that its response overflows.
    """
    model = fitted(
        selection, order, records, stable=stable, feedthrough=feedthrough, noise_weighted=False
    )
    return Candidate(selection, model, records)


def fitted(
    found: Selection,
    order: int,
    records: Sequence[Source],
    *,
    stable: bool,
    feedthrough: bool,
    noise_weighted: bool,
) -> Fitted:
    """Return the model of one order, with B, D and the initial states fitted to records.

    Without `noise_weighted` the fit minimises the errors by which models are weighed.

    Raises
    ------
    IdentificationError
        If the model is so unstable that its response overflows.
    """
    raw = found.space.matrices(order)
    method = METHODS[found.method]
    A, fit, moved, way = fit_stable(
        *(raw.A, raw.C, records, method.ways if stable else ()),
        feedthrough=feedthrough,
        noise_weighted=noise_weighted,
        at_rest=method.at_rest,
    )
    first = records[0]
    model = state_space(
        A, fit.B, raw.C, fit.D, first.dt_s, inputs=first.inputs, outputs=first.outputs
    )
    return Fitted(model, fit, moved, way)
