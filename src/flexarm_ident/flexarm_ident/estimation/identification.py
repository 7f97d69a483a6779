"""Result of an identification: the model, its origin, and the findings about it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from flexarm_core.errors import DataError, IdentificationError
from flexarm_core.labels import label_and_unit
from flexarm_ident.diagnostics.quality import assess, graded
from flexarm_ident.diagnostics.stabilisation import (
    Criteria,
    stabilisation,
    subspace_matrices,
)
from flexarm_ident.diagnostics.uncertainty import (
    frequency_response_uncertainty,
    jackknife,
    mode_uncertainty,
)
from flexarm_ident.estimation.cross_validation import (
    cross_validate,
    cross_validate_likelihood,
    without_blocks,
)
from flexarm_ident.estimation.physical_modes import judged_modes
from flexarm_ident.estimation.plots import plot_response, plot_stabilisation
from flexarm_ident.fitting.blas import one_thread
from flexarm_ident.friction.dry_friction import net_records
from flexarm_ident.models.modes import frequency_grid, mode_table, ranked_modes
from flexarm_ident.records.data_warning import Grade
from flexarm_ident.records.preprocess import output_scale
from flexarm_ident.subspace.methods import METHODS, Data
from flexarm_ident.subspace.order import candidate_orders, stable_orders, suggest_order

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.diagnostics.stabilisation import Stabilisation
    from flexarm_ident.diagnostics.uncertainty import (
        Jackknife,
        ResponseUncertainty,
    )
    from flexarm_ident.estimation.cross_validation import CrossValidation
    from flexarm_ident.estimation.physical_modes import JudgedMode
    from flexarm_ident.estimation.weighing import WeighedModel
    from flexarm_ident.friction.dry_friction import DryFriction
    from flexarm_ident.friction.levels import CoulombEstimate
    from flexarm_ident.likelihood.maximum_likelihood import LikelihoodFit
    from flexarm_ident.models.modes import Mode, ModeUncertainty
    from flexarm_ident.records.data_warning import DataWarning
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.subspace.gram import BlockGram
    from flexarm_ident.subspace.subspace_protocol import StateMatrices, Subspace


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """Identified model with its origin and diagnostics.

    Attributes
    ----------
    model : control.StateSpace
        Discrete model with named inputs and outputs; from the net input when there is `friction`.
    x0 : tuple of ndarray, (states,)
        Initial state of each record.
    order : int
        Number of states.
    method : str
        Method that was used: one of `METHODS`, or 'arm' for an arm with dry friction.
    block_rows : int
        Block rows of the Hankel matrices, q of (2-18).
    singular_values : ndarray
        Singular values of (2-21), descending.
    fit_error : ndarray, (outputs,)
        Relative simulation error of each output over the records (2-25).
    stable : bool
        Whether unstable eigenvalues were to be moved into the unit circle.
    moved_eigenvalues : int
        Number of those that were.
    notes : tuple of str
        Changes and compromises that the estimation made.
    gram : BlockGram
        Products of the data.
    subspace : Subspace
        Source of models of other orders.
    records : tuple of IoData
        The records that were fitted; of streamed ones a leading part.
    samples : tuple of int
        Length of each record that was fitted.
    choice : str
        Choice of 'auto' and its reason, in one sentence; empty when the method was given.
    weighed : tuple of WeighedModel
        Models that method and order were chosen from, the best score first; empty where they were
        given, or where the first model misses nothing but noise.
    start_error : ndarray, (outputs,) or None
        `fit_error` of the subspace model that a model fitted by simulation replaced. Both leave out
        samples without a working sensor.
    likelihood : LikelihoodFit or None
        Fit of maximum likelihood that gave the model.
    friction : DryFriction or None
        Dry friction at the model's inputs.
    coulomb : CoulombEstimate or None
        Coulomb levels by regression, when requested and the data allow it.
    """

    model: control.StateSpace
    x0: tuple[FloatArray, ...]
    order: int
    method: str
    block_rows: int
    singular_values: FloatArray
    fit_error: FloatArray
    stable: bool
    moved_eigenvalues: int
    notes: tuple[str, ...]
    gram: BlockGram = field(repr=False)
    subspace: Subspace = field(repr=False)
    records: tuple[IoData, ...] = field(repr=False)
    samples: tuple[int, ...] = field(repr=False)
    choice: str = ""
    weighed: tuple[WeighedModel, ...] = ()
    start_error: FloatArray | None = None
    likelihood: LikelihoodFit | None = None
    friction: DryFriction | None = None
    coulomb: CoulombEstimate | None = None

    def __repr__(self) -> str:
        errors = " ".join(f"{error:.3f}" for error in self.fit_error)
        return f"<{type(self).__name__} order {self.order} by {self.method}, errors {errors}>"

    def _repr_html_(self) -> str:
        figures = zip(self.model.output_labels, self.fit_error, strict=True)
        errors = ", ".join(f"{label_and_unit(name)[0]} {error:.3f}" for name, error in figures)
        title = f"Order {self.order} by {self.method}. Relative errors: {errors}."
        return mode_table(title, self.modes, self.model.dt, self.known_deviations)

    def plot_response(self, axes: Axes | None = None) -> Axes:
        """Plot the gain (2-4) of every output with a band of two standard deviations.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Axes to draw on. None: a new figure.
        """
        grid_hz = frequency_grid(self.model, 1.0 / (self.samples[0] * self.model.dt))
        known = self.response_uncertainty(grid_hz)
        return plot_response(self.model, grid_hz, known.deviation if known else None, axes)

    def plot_stabilisation(self, axes: Axes | None = None) -> Axes:
        """Plot the modes of all orders over their frequency; those of the plant are marked.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Axes to draw on. None: a new figure.
        """
        return plot_stabilisation(self.diagram, self.recurring_modes, self.order, axes)

    @property
    def title(self) -> str:
        """Name of the method in reports."""
        if self.friction is not None:
            return "flexible arm with dry friction, fitted by simulation error"
        return METHODS[self.method].title

    @property
    def at_rest(self) -> bool:
        """Whether the method takes the records to start from rest."""
        return self.friction is None and METHODS[self.method].at_rest

    @cached_property
    @one_thread()
    def data_warnings(self) -> tuple[DataWarning, ...]:
        """Defects of the records, each with its code and figures."""
        feedthrough = bool(np.any(self.model.D))
        return assess(self.records, self.gram, feedthrough=feedthrough, order=self.order)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines of `data_warnings` and `notes` with their grades, the heaviest first."""
        return graded(self.data_warnings, ((Grade.INFORMATION, note) for note in self.notes))

    @cached_property
    def linear_records(self) -> tuple[IoData, ...]:
        """`records` with the input of the linear model, without friction."""
        if self.friction is None:
            return self.records
        return net_records(self.model, self.friction, self.x0, self.records)

    @cached_property
    def modes(self) -> tuple[Mode, ...]:
        """Modes with frequency, damping, MSV and MRM over the records."""
        return ranked_modes(self.model, self.linear_records, output_scale(self.records))

    @cached_property
    def mode_uncertainty(self) -> tuple[ModeUncertainty, ...]:
        """Standard deviations of `modes`, in their order.

        It is empty for records that are too short or streamed, and for an arm with friction.
        """
        if self.likelihood is not None:
            return self.likelihood.modes
        found = self._jackknife
        return mode_uncertainty(found, self.model) if found else ()

    @property
    def known_deviations(self) -> tuple[ModeUncertainty, ...]:
        """`mode_uncertainty` where the errors are noise, else empty.

        The bias of friction, of a closed loop or of what the model lacks is larger than the scatter
        there, and no part of the data shows it.
        """
        return self.mode_uncertainty if self.likelihood is not None else ()

    def response_uncertainty(self, frequencies_hz: FloatArray) -> ResponseUncertainty | None:
        """Return the frequency response (2-4) with its standard deviation.

        Parameters
        ----------
        frequencies_hz : ndarray, (frequencies,)
            Frequencies.

        Returns
        -------
        ResponseUncertainty or None
            None where `mode_uncertainty` is empty.
        """
        if self.likelihood is not None:
            return self.likelihood.response_uncertainty(frequencies_hz)
        if self._jackknife is None:
            return None
        direct = bool(np.any(self.model.D))
        return frequency_response_uncertainty(
            self._jackknife, self.records, frequencies_hz, feedthrough=direct
        )

    @cached_property
    @one_thread()
    def cross_validation(self) -> CrossValidation | None:
        """Errors on blocks of the records that were left out of the fit.

        None for records that are too short or streamed, for models that were fitted by simulation
        error, and where a model without a block cannot be simulated.
        """
        if not self._is_in_memory:
            return None
        if self.start_error is not None and self.likelihood is None:
            return None
        try:
            if self.likelihood is not None:
                return cross_validate_likelihood(
                    self.records, self.gram.block_rows, self.likelihood
                )
            return cross_validate(
                self.records,
                without_blocks(self.records, self.gram.block_rows, self._estimate),
                lambda matrices: matrices,
                METHODS[self.method].ways if self.stable else (),
                feedthrough=bool(np.any(self.model.D)),
                noise_weighted=METHODS[self.method].noise_weighted,
            )
        except (DataError, IdentificationError):
            return None

    @cached_property
    @one_thread()
    def _jackknife(self) -> Jackknife[StateMatrices] | None:
        if self.friction is not None or not self._is_in_memory:
            return None
        try:
            return jackknife(self.records, self.gram.block_rows, self._estimate)
        except (DataError, IdentificationError):  # too little is left without a segment
            return None

    @property
    def _is_in_memory(self) -> bool:
        return self.samples == tuple(map(len, self.records))

    def _estimate(self, gram: BlockGram) -> StateMatrices:
        data = Data(gram, self.records, bool(np.any(self.model.D)), self.order)
        return METHODS[self.method].build(data).matrices(self.order)

    @cached_property
    @one_thread()
    def diagram(self) -> Stabilisation:
        """Stabilisation diagram: the modes that recur over the orders."""
        space = self.subspace
        return stabilisation(subspace_matrices(space), space.output_scale, self.model.dt)

    @cached_property
    @one_thread()
    def recurring_modes(self) -> tuple[JudgedMode, ...]:
        """Modes of `diagram` with their weights, and whether they are physical."""
        return judged_modes(
            self.diagram,
            self.subspace,
            self.linear_records,
            feedthrough=bool(np.any(self.model.D)),
            largest_damping=Criteria().largest_damping,
        )

    @cached_property
    def stable_orders(self) -> tuple[int, ...]:
        """Orders whose model is stable before any eigenvalue is moved (Tables 2-1 to 2-4)."""
        return stable_orders(self.subspace, candidate_orders(self.subspace))

    @property
    def suggested_order(self) -> int:
        """Order before the widest gap of the singular values (2-22)."""
        return suggest_order(self.singular_values, candidate_orders(self.subspace)[-1])
