"""Results of an identification job: the model, its folder, and its figures for a reader."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flexarm_ident.fitting.validation import mean_error

if TYPE_CHECKING:
    from pathlib import Path

    from flexarm_core.arrays import FloatArray
    from flexarm_ident.models.model_parameters import ParameterValue
    from flexarm_ident.workflow.outcome import Outcome


@dataclass(frozen=True, eq=False)
class Results:
    """An identified model and its folder.

    Attributes
    ----------
    name : str
        Name of the model.
    folder : Path
        Folder of the files.
    outcome : Outcome
        The identification.
    parameters : dict
        The model as flat parameters `models.<name>.*`.
    """

    name: str
    folder: Path
    outcome: Outcome
    parameters: dict[str, ParameterValue]

    @property
    def dmv(self) -> tuple[float, ...]:
        """Data matching errors (2-25) of the outputs, and their mean."""
        return _with_mean(self.outcome.dmv_errors)

    @property
    def left_out(self) -> tuple[float, ...]:
        """Errors on blocks that were left out of the fit, likewise; empty where there are none."""
        found = self.outcome.cross_validation
        return () if found is None else _with_mean(found.error)

    @property
    def frequency_std_hz(self) -> tuple[float, ...]:
        """Standard deviations of the modes' frequencies, where the errors are noise."""
        known = self.outcome.identification.known_deviations
        return tuple(each.frequency_std_hz for each in known)

    @property
    def sfv(self) -> tuple[float, ...]:
        """Set-point following errors, likewise; empty without a recorded reference."""
        found = self.outcome.sfv
        return () if found is None else _with_mean(found.error)

    def text(self, elapsed_s: float) -> str:
        """Return the identification in one line, with the time that it took."""
        outcome = self.outcome
        order, states = outcome.identification.order, outcome.model.nstates
        return (
            f"{outcome.verdict} {self.name}: order {order}"
            + (f" reduced to {states}" if states < order else "")
            + (" with dry friction" if outcome.friction else "")
            + f", relative error {self.dmv[-1]:.4f} (DMV), {elapsed_s:.1f} s"
            + (f"; {outcome.identification.choice}" if outcome.identification.choice else "")
        )


def _with_mean(errors: FloatArray) -> tuple[float, ...]:
    return (*errors.tolist(), mean_error(errors))
