"""Outcome of an identification: the validated model and all results on the way to it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from flexarm_ident.diagnostics.closed_loop import FEEDBACK
from flexarm_ident.diagnostics.excitation import FEW_VALUES
from flexarm_ident.diagnostics.instability import is_unstable, short_samples
from flexarm_ident.diagnostics.quality import kinds
from flexarm_ident.diagnostics.spectra import spectra
from flexarm_ident.diagnostics.verdict import (
    CROSS_VALIDATED,
    ESTIMATION_DATA,
    HELD_OUT,
    missed_shares,
    verdict,
)
from flexarm_ident.fitting.residuals import residual_correlations
from flexarm_ident.fitting.validation import about_mean, fit_percent, relative_errors
from flexarm_ident.records.data_warning import Grade
from flexarm_ident.subspace.feedback import reaches_inputs

if TYPE_CHECKING:
    import control

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.diagnostics.spectra import Spectra
    from flexarm_ident.diagnostics.verdict import Verdict
    from flexarm_ident.estimation.cross_validation import CrossValidation
    from flexarm_ident.estimation.identification import Identification
    from flexarm_ident.fitting.residuals import Residuals
    from flexarm_ident.fitting.validation import Dmv, Sfv
    from flexarm_ident.friction.dry_friction import DryFriction
    from flexarm_ident.models.modes import Mode
    from flexarm_ident.records.iodata import IoData
    from flexarm_ident.reduction.modal import Reduction
    from flexarm_ident.workflow.request import Request


@dataclass(frozen=True, eq=False)
class Outcome:
    """A validated model with all results on the way to it.

    Attributes
    ----------
    request : Request
        The request.
    records : tuple of IoData
        The preprocessed records; of streamed ones a leading part.
    samples : tuple of int
        Length of each record.
    fitted : tuple of int
        Length of its leading part that was fitted.
    identification : Identification
        The full model.
    reduction : Reduction or None
        The reduced model, when one was requested.
    friction : DryFriction or None
        Dry friction at the inputs of `model`, which is then driven by the net input.
    full_dmv, dmv : tuple of Dmv
        Data matching of the full model and of `model`, one per record.
    full_dmv_errors, dmv_errors : ndarray, (outputs,)
        Errors of the full model and of `model` over all records together, relative to the
        deviation of each record about its mean.
    sfv : Sfv or None
        Set-point following of `model` on the first record; None without a recorded reference.
    warnings : tuple of str
        Facts that a user should know before using the model.
    """

    request: Request
    records: tuple[IoData, ...]
    samples: tuple[int, ...]
    fitted: tuple[int, ...]
    identification: Identification
    reduction: Reduction | None
    friction: DryFriction | None
    full_dmv: tuple[Dmv, ...]
    dmv: tuple[Dmv, ...]
    full_dmv_errors: FloatArray
    dmv_errors: FloatArray
    sfv: Sfv | None
    warnings: tuple[str, ...]

    @property
    def model(self) -> control.StateSpace:
        """The reduced model if there is one, else the full one."""
        return self.reduction.model if self.reduction else self.identification.model

    @property
    def cross_validation(self) -> CrossValidation | None:
        """Errors of the full model's estimator and order on blocks left out of the fit."""
        return self.identification.cross_validation

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Modes of the full model; those of the reduced one are marked as kept."""
        return self.reduction.modes if self.reduction else self.identification.modes

    @cached_property
    def verdict(self) -> Verdict:
        """Verdict on `model`: its level, its two figures and the next step."""
        errors, validation = self._validated_errors()
        defects = [
            warning.code
            for warning in self.identification.data_warnings
            # A loop is not a defect that could be fixed.
            if warning.grade != Grade.INFORMATION and warning.code != FEEDBACK
        ]
        return verdict(
            errors,
            missed_shares(
                self.records,
                [each.y for each in self.dmv],
                reached=reaches_inputs(self.identification.gram),
            ),
            self.records[0].outputs,
            validation=validation,
            defects=[kinds()[code].title.lower() for code in defects],
            few_values=FEW_VALUES in defects,
            keep_s=self._keep_s(),
        )

    @cached_property
    def fit_percent(self) -> FloatArray:
        """Fit of each output over all records in percent: 100 (1 - NRMSE), the mean removed."""
        pairs = [
            (record.y_measured[: len(each.y)], each.y[: len(record)])
            for record, each in zip(self.records, self.dmv, strict=True)
        ]
        measured, simulated = (np.vstack(each) for each in zip(*pairs, strict=True))
        return fit_percent(measured, simulated)

    @cached_property
    def residuals(self) -> Residuals:
        """Correlations of measured less simulated outputs, in time and with the inputs."""
        return residual_correlations(self.records, [each.y for each in self.dmv])

    @cached_property
    def spectra(self) -> Spectra | None:
        """Nonparametric frequency response and coherence of the records; None for short ones."""
        return spectra(self.records)

    def _keep_s(self) -> float:
        """Return the time in which an unstable plant's model can be kept; 0 if it is as it was."""
        found = self.identification
        if not (found.moved_eigenvalues and found.stable):
            return 0.0
        raw = found.subspace.matrices(found.order)
        if not is_unstable(raw.A, raw.C, self.records):
            return 0.0
        return short_samples(raw.A) * self.records[0].dt_s

    def _validated_errors(self) -> tuple[FloatArray, str]:
        """Return errors of `model`, of data that were left out of its fit if there are any."""
        if self.fitted != self.samples:
            if self.samples == tuple(len(record) for record in self.records):
                return self._held_out_errors(), HELD_OUT
        elif self.cross_validation is not None:
            # They are those of the full model; a reduced one is no better there than on all data.
            worse = np.maximum(self.cross_validation.error, self.dmv_errors)
            return np.asarray(worse), CROSS_VALIDATED
        return self.dmv_errors, ESTIMATION_DATA

    def _held_out_errors(self) -> FloatArray:
        parts = [
            (record.y_measured[fitted:], each.y[fitted:])
            for record, fitted, each in zip(self.records, self.fitted, self.dmv, strict=True)
        ]
        measured, simulated = (np.vstack(each) for each in zip(*parts, strict=True))
        return about_mean(relative_errors(measured, simulated), measured)
