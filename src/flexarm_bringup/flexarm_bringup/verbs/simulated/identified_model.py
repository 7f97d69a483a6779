"""Model that was identified in a run, for the terminal and the results of the verbs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

from flexarm_bringup.console import terminal
from flexarm_ident.records.iodata import ARM_OUTPUTS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from flexarm_ident.models.modes import Mode


class IdentifiedModel(NamedTuple):
    """Identified model of the arm.

    Attributes
    ----------
    text : str
        Verdict, orders and time in one line.
    modes : sequence of Mode
        Modes of the full model; those of the reduced one are marked as kept.
    dmv, left_out, sfv : sequence of float
        Errors of the outputs and their mean: data matching, on blocks left out of the fit,
        set-point following. The last two may be empty.
    parameters : mapping
        The model as flat parameters `models.<name>.*`.
    warnings : sequence of str
        Facts that a user should know.
    folder : Path
        Folder of the model and its report.
    """

    text: str
    modes: Sequence[Mode]
    dmv: Sequence[float]
    left_out: Sequence[float]
    sfv: Sequence[float]
    parameters: Mapping[str, Any]
    warnings: Sequence[str]
    folder: Path

    @property
    def order(self) -> int:
        """States of the full model."""
        return sum(len(mode.states) for mode in self.modes)

    @property
    def reduced_order(self) -> int:
        """States of the reduced model."""
        return sum(len(mode.states) for mode in self.modes if mode.kept)

    def show(self) -> None:
        """Print modes, errors and warnings."""
        terminal.CONSOLE.print(f"  {self.text}")
        terminal.show_model(
            terminal.ShownModel(
                modes=self.modes,
                outputs=ARM_OUTPUTS,
                dmv=self.dmv,
                left_out=self.left_out,
                sfv=self.sfv,
                parameters=self.parameters,
                warnings=self.warnings,
            )
        )

    def kept_modes_hz(self, known_modes_hz: Sequence[float]) -> list[float]:
        """Return the reduced model's flexible modes, one for each known one; none without pairs."""
        pairs = [mode for mode in self.modes if mode.kept and mode.is_pair]
        if not pairs:
            return []
        return [
            min(pairs, key=lambda mode: abs(math.log(mode.frequency_hz / known))).frequency_hz
            for known in known_modes_hz
        ]
